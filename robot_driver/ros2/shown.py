"""Robots of CMR's world in ROS 2: odometry, tf, joints and scans out, velocities in. Independent of rclpy.

Only a virtual robot takes velocities, according to the bus: a robot that WORLD_STATE calls real, or has not contained
for a second, is not commanded.
"""

import math
from collections import Counter
from collections.abc import Callable
from typing import NamedTuple

from cmr.bus.claiming import Claim
from cmr.bus.message import Message
from cmr.bus.process import Outgoing
from cmr.bus.streams import COMMAND_CLAIM
from cmr.model.command_kinds import DUTY, VELOCITY
from cmr.msg import robot_state_t, world_state_t
from cmr.parameters.following import ParameterFollower
from cmr.recordings.arrivals import COMMANDS_OF
from cmr.recordings.commanding import command_of
from robot_driver.ros2.messages import Joints, Odometry, Placed, Velocity

WORLD_FRAME = "map"
JOINTS = ("wheel_left_joint", "wheel_right_joint")
PRESENT = 1_000_000  # us since a robot was in the world
COMMANDED = 1_000_000  # us since the last velocity for which a robot stays claimed
LONGEST_STEP = 500_000  # us between two states over which wheels are assumed to turn steadily
NAMES = {robot_state_t.REAL: "real", robot_state_t.VIRTUAL: "virtual", robot_state_t.TWIN: "a twin"}


class State(NamedTuple):
    """State of a robot to publish in ROS 2."""

    odometry: Odometry
    joints: Joints
    transform: Placed


class ShownRobot:
    """A robot of the world in ROS 2; `parameters` give its base width and the duties for its speeds.

    `sender` returns the name of this process under its commands. If it `is_commanded`, velocities move it.
    """

    def __init__(
        self, robot_id: int, parameters: ParameterFollower, sender: Callable[[], int], *, is_commanded: bool
    ) -> None:
        self.robot_id, self.name = robot_id, f"robot_{robot_id}"
        self.frame = f"{self.name}/base_link"
        self.odometry_frame = f"{self.name}/odom"
        self.refused: Counter[str] = Counter()
        self._parameters, self._is_commanded = parameters, is_commanded
        self._claim = Claim("cmr-ros2", robot_id, sender)
        self._seen: tuple[int, int] | None = None  # when it was last in the world [us by this host], and its origin
        self._last: int | None = None  # us; of the last state
        self._angles = [0.0, 0.0]
        self._velocity: tuple[int, Velocity] | None = None  # with its time of arrival [us]
        self._is_claimed = False

    def handle(self, utime: int, channel: str, message: Message) -> None:
        """Process parameters, and the owner of the robot."""
        self._parameters.handle(utime, channel, message)
        self._claim.handle(utime, channel, message)

    def state(self, world: world_state_t, now: int) -> State | None:
        """Return the robot's state from a message of the world; None if it is not in it, or without parameters."""
        at = next((k for k, one in enumerate(world.robot_id) if one == self.robot_id and self._is_it(world, k)), None)
        if at is None:
            return None
        self._seen = now, int(world.origin[at])
        body = self._parameters.parameters
        x, y, theta, left, right = (
            float(column[at]) for column in (world.x, world.y, world.theta, world.psi_left, world.psi_right)
        )
        if body is None or not body.has("wheel_radius", "base_width"):
            return None
        if not all(map(math.isfinite, (x, y, theta, left, right))):
            self.refused["states that are not finite"] += 1
            return None
        self._turn_wheels(world.utime, left, right)
        radius, width = body.value("wheel_radius"), body.value("base_width")
        v, omega = radius * (left + right) / 2.0, radius * (right - left) / width
        return State(
            Odometry(world.utime, self.odometry_frame, self.frame, x, y, theta, v, omega),
            Joints(world.utime, JOINTS, tuple(self._angles), (left, right)),
            Placed(world.utime, self.odometry_frame, self.frame, x, y, theta),
        )

    @property
    def anchor(self) -> Placed:
        """Pose of its odometry frame in the world: its odometry is the world's truth, and never drifts."""
        return Placed(0, WORLD_FRAME, self.odometry_frame, 0.0, 0.0, 0.0)

    def drive(self, velocity: Velocity, now: int) -> list[Outgoing]:
        """Process a velocity from ROS 2; return the messages for the bus."""
        if not all(map(math.isfinite, velocity)):
            self.refused["velocities that are not finite"] += 1
            return []
        self._velocity = now, velocity
        if self._objection(now) or self._claim.others(now):
            self.refused["velocities that do not move it"] += 1
            return []
        command = self._command(velocity, now)
        return [*self._claimed(now), command] if command is not None else []

    def turn(self, now: int) -> list[Outgoing]:
        """Return the messages due on the bus: the claim of a commanded robot, and its end."""
        self._parameters.poll()
        if self._velocity is not None and now - self._velocity[0] <= COMMANDED:
            return [] if self._objection(now) else self._claimed(now)
        return self.end(now)

    def end(self, now: int) -> list[Outgoing]:
        """Return the messages that stop the robot and release it."""
        if not self._is_claimed:
            return []
        self._is_claimed = False
        command = self._command(Velocity(0.0, 0.0), now)
        return [*([command] if command else []), (COMMAND_CLAIM, self.robot_id, self._claim.end(now))]

    def problem(self, now: int) -> str:
        """Return a sentence why the robot is not shown or does not follow; empty if it does."""
        if self._seen is None or now - self._seen[0] > PRESENT:
            return f"Robot {self.robot_id} is not in the world: cmr-sim publishes WORLD_STATE."
        if self._parameters.parameters is None:
            return f"No parameters of robot {self.robot_id}: --parameters names the folder of its file."
        if self._velocity is None or now - self._velocity[0] > COMMANDED:
            return ""
        others = self._claim.others(now)
        if others:
            return f"Robot {self.robot_id} is commanded by {others}; what comes on cmd_vel is refused."
        return self._objection(now)

    def _is_it(self, world: world_state_t, at: int) -> bool:
        """Return whether this entry is the robot itself: a real robot's twin is listed beside it."""
        return int(world.origin[at]) != robot_state_t.TWIN

    def _objection(self, now: int) -> str:
        """Return why the robot must not be commanded from ROS 2."""
        if not self._is_commanded:
            return f"Robot {self.robot_id} is only shown."
        if self._seen is None or now - self._seen[0] > PRESENT:
            return f"Robot {self.robot_id} is not in the world."
        if self._seen[1] != robot_state_t.VIRTUAL:
            return f"Robot {self.robot_id} is {NAMES.get(self._seen[1], 'not virtual')}: ROS 2 commands virtual ones."
        return ""

    def _command(self, velocity: Velocity, now: int) -> Outgoing | None:
        """Return the command for a velocity: directly, or as the duties for it at steady speed."""
        file = self._parameters.parameters
        if file is None:
            return None
        if file.has_velocity_controller:
            controller = file.velocity_controller
            assert controller is not None
            kind, duties = VELOCITY, controller.duties_of_body(*velocity)
        elif file.has("wheel_radius", "base_width", "k1"):
            radius, half = file.value("wheel_radius"), file.value("base_width") / 2.0
            k1, half = file.value("k1"), half * velocity.omega
            kind, controller = DUTY, None
            duties = _within(k1 * (velocity.v - half) / radius), _within(k1 * (velocity.v + half) / radius)
        else:
            return None
        message = command_of(kind, now, self.robot_id, (float(duties[0]), float(duties[1])), controller)
        return COMMANDS_OF[kind], self.robot_id, message

    def _claimed(self, now: int) -> list[Outgoing]:
        self._is_claimed = True
        claim = self._claim.message(now)
        return [] if claim is None else [(COMMAND_CLAIM, self.robot_id, claim)]

    def _turn_wheels(self, utime: int, left: float, right: float) -> None:
        passed = 0 if self._last is None else utime - self._last
        self._last = utime
        if 0 < passed <= LONGEST_STEP:
            self._angles = [angle + psi * passed / 1e6 for angle, psi in zip(self._angles, (left, right), strict=True)]


def _within(duty: float) -> float:
    """Return the duty clipped to its range."""
    return max(-1.0, min(1.0, duty))

"""Convert the readings of a ROS 2 robot to a driver's messages: feedback of its wheels, turn rate, pose."""

import math
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from itertools import pairwise

from cmr.bus.messages import make
from cmr.bus.process import Outgoing
from cmr.bus.streams import GYRO, MOTOR_FEEDBACK, POSE
from cmr.geometry.places import Pose as Place
from cmr.model.velocity_controller import VelocityController
from cmr.msg import gyro_t, motor_feedback_t, pose_xyt_t
from robot_driver.ros2.messages import (
    ODOMETRY,
    Joints,
    Placed,
    Ros,
    read_imu,
    read_joints,
    read_odometry,
    read_pose,
    read_transform,
)
from robot_driver.ros2.profile import Profile
from robot_driver.ros2.robot_clock import RobotClock

TURN = 2.0 * math.pi
LONGEST_GAP = 1_000_000  # us between two odometry messages over which wheels are assumed to have turned steadily
UNKNOWN = dict.fromkeys(
    ("applied_left", "applied_right", "current_left", "current_right", "battery_voltage", "temperature"), math.nan
)


class Readings:
    """Converts messages of one robot to those of the bus. Arrivals are in us.

    `status` returns the current STATUS constants. `refused` counts unusable messages by reason.
    """

    def __init__(self, robot_id: int, profile: Profile, status: Callable[[], int]) -> None:
        self.refused: Counter[str] = Counter()
        self.clock = RobotClock()
        self.heard: dict[str, int] = {}  # when [us] wheels, gyro and pose were last received
        self._robot_id, self._profile, self._status = robot_id, profile, status
        self._wheels = _OfOdometry(profile) if profile.wheels.type == ODOMETRY else _OfJoints(profile)
        self._chain = _Chain(profile.pose.chain) if profile.pose is not None and profile.pose.frames else None
        self._last: dict[str, int] = {}  # stamps by the robot's clock

    def wheels(self, message: Ros, arrival: int) -> list[Outgoing]:
        """Process a message with the wheels' angles and speeds, or with odometry in their place."""
        if not self._wheels.concerns(message):
            return []
        turned = self._wheels.take(message)
        utime = self._time("wheels", self._wheels.stamp(message), arrival)
        if utime is None or turned is None:
            return []
        if not all(map(math.isfinite, (*turned[0], *turned[1]))):
            return self._refuse("wheels that are not finite")
        (left, right), psi = turned
        feedback = make(
            motor_feedback_t,
            utime=utime,
            robot_id=self._robot_id,
            ticks_left=self._ticks(left),
            ticks_right=self._ticks(right),
            psi_left=psi[0],
            psi_right=psi[1],
            **UNKNOWN,
            status=self._status(),
            received_utime=arrival,
            applied_utime=0,
        )
        return [(MOTOR_FEEDBACK, self._robot_id, feedback)]

    def gyro(self, message: Ros, arrival: int) -> list[Outgoing]:
        """Process an Imu."""
        stamp, rate = read_imu(message)
        utime = self._time("gyro", stamp, arrival)
        if utime is None or self._profile.gyro is None:
            return []
        about = {"utime": utime, "robot_id": self._robot_id, "received_utime": arrival}
        valid = math.isfinite(rate)
        yaw_rate = self._profile.gyro.sign * rate if valid else math.nan
        return [(GYRO, self._robot_id, make(gyro_t, **about, yaw_rate=yaw_rate, valid=int(valid)))]

    def pose(self, message: Ros, arrival: int) -> list[Outgoing]:
        """Process a message with the pose in the world."""
        if self._profile.pose is not None and self._profile.pose.type == ODOMETRY:
            odometry = read_odometry(message)
            place = Place(odometry.x, odometry.y, odometry.theta)
            return self._placed(odometry.utime, place, arrival)
        placed = read_pose(message)
        return self._placed(placed.utime, Place(placed.x, placed.y, placed.theta), arrival)

    def transforms(self, messages: Sequence[Ros], arrival: int) -> list[Outgoing]:
        """Process transforms of tf; the robot's pose is that of the last frame of its chain, at the time of the
        last.
        """
        outgoing: list[Outgoing] = []
        for message in messages if self._chain is not None else ():
            assert self._chain is not None
            placed = read_transform(message)
            place = self._chain.take(placed)
            if place is not None:
                outgoing += self._placed(placed.utime, place, arrival)
        return outgoing

    def _placed(self, stamp: int, place: Place, arrival: int) -> list[Outgoing]:
        utime = self._time("pose", stamp, arrival)
        if utime is None:
            return []
        if not all(map(math.isfinite, place)):
            return self._refuse("poses that are not finite")
        about = {"utime": utime, "robot_id": self._robot_id}
        return [(POSE, self._robot_id, make(pose_xyt_t, **about, x=place.x, y=place.y, theta=place.theta))]

    def _time(self, what: str, stamp: int, arrival: int) -> int | None:
        """Return when something was measured; None if it is repeated, or the robot's clock is not known yet."""
        if stamp > 0 and stamp == self._last.get(what):
            self.refused[f"{what} repeated"] += 1
            return None
        self._last[what], self.heard[what] = stamp, arrival
        return self.clock.here(stamp, arrival)

    def _ticks(self, angle: float) -> int:
        return round(angle / TURN * self._profile.wheels.ticks_per_turn)

    def _refuse(self, why: str) -> list[Outgoing]:
        self.refused[why] += 1
        return []


Turned = tuple[tuple[float, float], tuple[float, float]]  # angles [rad] and speeds [rad/s], left and right


class _OfJoints:
    """Wheels by the joints of a JointState: the mean over each side, with angles relative to the first ones."""

    def __init__(self, profile: Profile) -> None:
        self._joints, self._sign, self._unit = profile.wheels.joints, profile.wheels.sign, profile.wheels.speed
        self._radius = profile.nominal.wheel_radius
        self._first: tuple[float, float] | None = None
        self._last: tuple[int, float, float] | None = None

    def concerns(self, message: Ros) -> bool:
        """Return whether the message has the wheels: other joints may be published on the same topic."""
        return all(name in message.name for side in self._joints for name in side)

    def stamp(self, message: Ros) -> int:
        """Return the stamp of a message [us]."""
        return read_joints(message).utime

    def take(self, message: Ros) -> Turned | None:
        """Return the wheels' angles and speeds; None if unknown."""
        joints = read_joints(message)
        angles = self._sides(joints, joints.positions)
        if angles is None:
            return None
        self._first = self._first or angles
        turned = angles[0] - self._first[0], angles[1] - self._first[1]
        if self._unit != "none":
            speeds = self._sides(joints, joints.velocities)
            scale = 1.0 / self._radius if self._unit == "m/s" else 1.0
            return None if speeds is None else (turned, (scale * speeds[0], scale * speeds[1]))
        last, self._last = self._last, (joints.utime, *turned)
        if last is None or joints.utime <= last[0]:
            return None
        seconds = (joints.utime - last[0]) / 1e6
        return turned, ((turned[0] - last[1]) / seconds, (turned[1] - last[2]) / seconds)

    def _sides(self, joints: Joints, values: Sequence[float]) -> tuple[float, float] | None:
        """Return the mean of each side's joints, forward positive."""
        if len(values) != len(joints.names):
            return None
        by_name: Mapping[str, float] = dict(zip(joints.names, map(float, values), strict=True))
        left, right = (sum(by_name[name] for name in side) / len(side) for side in self._joints)
        return self._sign * left, self._sign * right


class _OfOdometry:
    """Wheels by odometry: the wheel speeds that correspond to the body's velocity, integrated."""

    def __init__(self, profile: Profile) -> None:
        nominal = profile.nominal
        self._body = VelocityController(nominal.wheel_radius, profile.counted_width, nominal.top_wheel_speed)
        self._angles = [0.0, 0.0]
        self._last: int | None = None

    def concerns(self, _message: Ros) -> bool:
        """Return whether the message has the wheels."""
        return True

    def stamp(self, message: Ros) -> int:
        """Return the stamp of a message [us]."""
        return read_odometry(message).utime

    def take(self, message: Ros) -> Turned | None:
        """Return the wheels' angles and speeds."""
        odometry = read_odometry(message)
        psi = self._body.wheels_of_body(odometry.v, odometry.omega)
        passed = 0 if self._last is None else odometry.utime - self._last
        self._last = odometry.utime
        if 0 < passed <= LONGEST_GAP and all(map(math.isfinite, psi)):
            self._angles = [angle + speed * passed / 1e6 for angle, speed in zip(self._angles, psi, strict=True)]
        return (self._angles[0], self._angles[1]), psi


class _Chain:
    """The chain of frames from the world's to the robot's, as last published on tf."""

    def __init__(self, frames: Sequence[str]) -> None:
        self._links = list(pairwise(frames))
        self._known: dict[tuple[str, str], Place] = {}

    def take(self, placed: Placed) -> Place | None:
        """Store a transform; return the robot's pose if it is the last link of the chain and all others are known."""
        link = placed.parent.lstrip("/"), placed.child.lstrip("/")
        if link not in self._links:
            return None
        self._known[link] = Place(placed.x, placed.y, placed.theta)
        if link != self._links[-1] or len(self._known) < len(self._links):
            return None
        place = Place(0.0, 0.0, 0.0)
        for one in self._links:
            place = _beyond(place, self._known[one])
        return place


def _beyond(frame: Place, place: Place) -> Place:
    """Transform a pose given in a frame to the parent of that frame."""
    cosine, sine = math.cos(frame.theta), math.sin(frame.theta)
    x, y = frame.x + cosine * place.x - sine * place.y, frame.y + sine * place.x + cosine * place.y
    return Place(x, y, math.remainder(frame.theta + place.theta, TURN))

"""An emulated robot that speaks ROS 2: the independent plant behind cmd_vel, with the interface of its own software.

    python -m robot_driver.ros2.emulated --namespace /turtle

It takes cmd_vel (Twist) and publishes joint_states, imu, odom and pose, the last as motion capture would. It stops by
itself when no cmd_vel has come for 0.5 s.
"""

import argparse
import math
import signal
import sys
from collections.abc import Callable
from functools import partial
from pathlib import Path
from threading import Event
from typing import TYPE_CHECKING, TypeAlias

from cmr.bus.message import Message
from cmr.bus.messages import make
from cmr.bus.process import Outgoing
from cmr.bus.streams import VELOCITY_COMMAND
from cmr.cli.command_line import parser
from cmr.cli.errors import CommandError
from cmr.geometry.places import Pose as Place
from cmr.model.command_kinds import VELOCITY
from cmr.msg import gyro_t, motor_feedback_t, pose_xyt_t, velocity_command_t
from robot_driver.emulator.settings import Settings, SettingsError, load_settings
from robot_driver.emulator.speed_robot import SpeedRobot
from robot_driver.host import THIS_COMPUTER, Host
from robot_driver.ros2.messages import (
    IMU,
    JOINT_STATE,
    ODOMETRY,
    POSE_STAMPED,
    TWIST,
    Joints,
    Odometry,
    Placed,
    Ros,
    Velocity,
    read_twist,
    write_imu,
    write_joints,
    write_odometry,
    write_pose,
)
from robot_driver.ros2.network import RANGES, choose_network

if TYPE_CHECKING:
    from robot_driver.ros2.node import Node, Publisher

JOINTS = ("wheel_left_joint", "wheel_right_joint")
TURN = 0.002  # s between two polls of input
TWO_PI = 2.0 * math.pi
Reading: TypeAlias = Joints | tuple[int, float] | Odometry | Placed  # the pair is an Imu: time [us], turn rate [rad/s]


class EmulatedRobot:
    """The robot, switched on now. Independent of the node: `command` takes velocities, `readings` returns measurements.

    `ahead` [s] is the offset of its clock from this computer's.
    """

    def __init__(
        self, settings: Settings, pose_rate: float | None = 50.0, host: Host = THIS_COMPUTER, *, ahead: float = 0.0
    ) -> None:
        self._host = host
        self.robot = SpeedRobot(settings, 0, VELOCITY, pose_rate, host)
        self._ticks, self._ahead = settings.robot.ticks_per_turn, round(ahead * 1e6)
        self._radius, self._width = settings.robot.wheel_radius, settings.velocity_controller.command_base_width
        self._place, self._last = Place(0.0, 0.0, 0.0), 0

    def command(self, velocity: Velocity) -> None:
        """Set a velocity, which is in force for 0.5 s."""
        message = make(velocity_command_t, utime=self._host.utime(), robot_id=0, v=velocity.v, omega=velocity.omega)
        self.robot.handle(message.utime, VELOCITY_COMMAND.channel(0), message)

    def readings(self) -> list[Reading]:
        """Advance to the current time; return the measurements since the last call."""
        self.robot.turn()
        return [reading for outgoing in self.robot.outgoing() for reading in self._said(outgoing)]

    def _said(self, outgoing: Outgoing) -> list[Reading]:
        message: Message = outgoing[2]
        stamp = message.utime + self._ahead
        if isinstance(message, motor_feedback_t):
            angles = tuple(TWO_PI * ticks / self._ticks for ticks in (message.ticks_left, message.ticks_right))
            psi = message.psi_left, message.psi_right
            return [Joints(stamp, JOINTS, angles, psi), self._odometry(stamp, *psi)]
        if isinstance(message, gyro_t):
            return [(stamp, message.yaw_rate)]
        assert isinstance(message, pose_xyt_t)
        return [Placed(stamp, "map", "", message.x, message.y, message.theta)]

    def _odometry(self, stamp: int, left: float, right: float) -> Odometry:
        """Return dead reckoning from the wheels, with the robot's own nominal geometry."""
        v, omega = self._radius * (left + right) / 2.0, self._radius * (right - left) / self._width
        seconds, self._last = (stamp - self._last) / 1e6 if self._last else 0.0, stamp
        x, y, theta = self._place
        middle = theta + 0.5 * omega * seconds
        self._place = Place(
            x + v * seconds * math.cos(middle), y + v * seconds * math.sin(middle), theta + omega * seconds
        )
        return Odometry(stamp, "odom", "base_link", *self._place, v, omega)


class Publishing:
    """Publishes a robot's readings under its namespace, and passes cmd_vel to it."""

    def __init__(self, robot: EmulatedRobot, namespace: str, node: "Node", *, reliable: bool) -> None:
        self._robot = robot
        self._joints = node.publisher(f"{namespace}/joint_states", JOINT_STATE, reliable=reliable)
        self._imu = node.publisher(f"{namespace}/imu", IMU, reliable=reliable)
        self._odometry = node.publisher(f"{namespace}/odom", ODOMETRY, reliable=reliable)
        self._pose = node.publisher(f"{namespace}/pose", POSE_STAMPED, reliable=reliable)
        node.hear(f"{namespace}/cmd_vel", TWIST, self._take, reliable=True)

    def publish(self) -> None:
        """Publish the measurements since the last call."""
        for reading in self._robot.readings():
            if isinstance(reading, Joints):
                self._send(self._joints, partial(write_joints, joints=reading))
            elif isinstance(reading, Odometry):
                self._send(self._odometry, partial(write_odometry, odometry=reading))
            elif isinstance(reading, Placed):
                self._send(self._pose, partial(write_pose, placed=reading))
            else:
                utime, rate = reading
                self._send(self._imu, partial(write_imu, utime=utime, frame="imu_link", yaw_rate=rate))

    def _send(self, publisher: "Publisher", fill: Callable[[Ros], None]) -> None:
        message = publisher.empty()
        fill(message)
        publisher.publish(message)

    def _take(self, message: Ros, _arrival: int) -> None:
        self._robot.command(read_twist(message))


def main(arguments: list[str]) -> int:
    """Emulate robots until a signal arrives; return the exit code."""
    options = command_parser().parse_args(arguments)
    try:
        settings = load_settings(options.settings, seed=options.seed, ideal=options.ideal)
    except SettingsError as error:
        raise CommandError(str(error)) from error
    from robot_driver.ros2.node import Node

    choose_network(options.domain_id, options.range)
    over = Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda _number, _frame: over.set())
    with Node("emulated_robot", lambda: None) as node:
        names = options.namespace.split(",")
        robots = [EmulatedRobot(settings, options.pose_rate, ahead=options.clock_ahead) for _ in names]
        shown = [
            Publishing(robot, name.rstrip("/"), node, reliable=not options.best_effort)
            for robot, name in zip(robots, names, strict=True)
        ]
        print(f"emulated: {', '.join(name or '/' for name in names)} ready", flush=True)
        while not over.wait(TURN):
            for take, message, arrival in node.arrived():
                take(message, arrival)
            for one in shown:
                one.publish()
    return 0


def command_parser() -> argparse.ArgumentParser:
    """Return the command line."""
    options = parser(
        "robot_driver.ros2.emulated",
        "Emulate robots that speak ROS 2: physics behind cmd_vel; joint_states, imu, odom and pose out.",
        "python -m robot_driver.ros2.emulated --namespace /turtle",
    )
    options.add_argument(
        "--namespace", default="", metavar="/NAME,...", help="of the topics; several for several robots"
    )
    options.add_argument("--settings", type=Path, metavar="FILE", help="as of cmr-emulate --settings")
    options.add_argument("--ideal", action="store_true", help="without noise and imperfections")
    options.add_argument("--seed", type=int, metavar="N", help="of all random numbers")
    options.add_argument("--pose-rate", type=float, default=50.0, metavar="HZ", help="of the topic pose (50)")
    options.add_argument("--clock-ahead", type=float, default=0.0, metavar="S", help="of the robot's clock (0)")
    options.add_argument("--best-effort", action="store_true", help="publish as sensors do, where losses may happen")
    options.add_argument("--domain-id", type=int, metavar="N", help="ROS domain")
    options.add_argument("--range", choices=RANGES, default=RANGES[0], help="of discovery")
    return options


if __name__ == "__main__":
    from cmr.cli.start import run

    sys.exit(run("robot_driver.ros2.emulated"))

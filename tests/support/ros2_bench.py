"""An emulated ROS 2 robot and its bridge in simulated time, and the messages between them as ROS 2 carries them."""

from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

from rosbags.typesys import Stores, get_typestore

from cmr.bus.messages import make
from cmr.bus.streams import COMMAND_CLAIM, ESTOP, VELOCITY_COMMAND
from cmr.msg import command_claim_t, estop_t, motor_feedback_t, velocity_command_t
from cmr.parameters.file import ParameterFile
from robot_driver.command_gate import LISTENING_TIME
from robot_driver.emulator.settings import Settings
from robot_driver.ros2.bridge import RobotBridge
from robot_driver.ros2.emulated import EmulatedRobot
from robot_driver.ros2.messages import (
    IMU,
    JOINT_STATE,
    ODOMETRY,
    POSE_STAMPED,
    Joints,
    Odometry,
    Placed,
    Velocity,
    write_imu,
    write_joints,
    write_odometry,
    write_pose,
)
from robot_driver.ros2.profile import Profile
from tests.support.emulated_speed_robot import TURN, CommandedBench

STORE = get_typestore(Stores.ROS2_HUMBLE)
ZEROS = {"string": "", "bool": False, "float32": 0.0, "float64": 0.0}
EXAMPLE = Profile.load("example")


def empty(kind: str) -> Any:
    """Return a message of a type, such as geometry_msgs/msg/Twist, in which everything is zero."""
    _, fields = STORE.fielddefs[kind]
    return SimpleNamespace(**{name: _nothing(description) for name, description in fields})


def _nothing(description: Any) -> Any:
    node, what = description
    if isinstance(what, str):  # a message
        return empty(what)
    if isinstance(what[0], str):  # a number or a text
        return ZEROS.get(what[0], 0)
    inner, size = what
    return [_nothing(inner) for _ in range(size)] if node == 3 else []


def carried(kind: str, message: Any) -> Any:
    """Return the message as it comes out of the bytes that ROS 2 carries; coded by rosbags, which shares no code."""
    return STORE.deserialize_cdr(STORE.serialize_cdr(_as_rosbags(kind, message), kind), kind)


def _as_rosbags(kind: str, message: Any) -> Any:
    import numpy as np

    _, fields = STORE.fielddefs[kind]
    values = {}
    for name, (_, what) in fields:
        value = getattr(message, name)
        if isinstance(what, str):
            value = _as_rosbags(what, value)
        elif not isinstance(what[0], str) and isinstance(what[0][1], tuple) and what[0][1][0] != "string":
            value = np.array(value, what[0][1][0])
        values[name] = value
    return STORE.types[kind](**values)


class Bench(CommandedBench):
    """Robot 0. `sent` are the velocities that the robot was sent, with their times [s]."""

    def __init__(
        self, settings: Settings, profile: Profile = EXAMPLE, *, ahead: float = 0.0, is_deserted: bool = False
    ) -> None:
        super().__init__()
        self.bridge = RobotBridge(0, profile, self.clock)
        self.robot = EmulatedRobot(settings, host=self.clock, ahead=ahead)
        self._is_deserted = is_deserted  # nobody takes what is sent, or says anything: as far as that is not looked at
        self.sent: list[tuple[float, Velocity]] = []
        self.is_deaf = False  # the bus brings nothing any more
        self._waiting: list[tuple[str, Any, int | None]] = []
        self._due = 0.0

    def send(self, channel: str, message: Any, sender: int | None = None) -> None:
        """Publish a message, which the bridge takes at its next turn."""
        self._waiting.append((channel, message, sender))

    def velocity(self, v: float, omega: float = 0.0, *, age: float = 0.0, sender: int | None = None) -> None:
        """Command a velocity [m/s, rad/s], decided `age` [s] ago."""
        utime = self.clock.utime() - round(age * 1e6)
        message = make(velocity_command_t, utime=utime, robot_id=0, v=v, omega=omega)
        self.send(VELOCITY_COMMAND.channel(0), message, sender)

    def estop(self, engaged: bool, reason: str = "a test") -> None:
        """Engage or release the emergency stop."""
        about = {"utime": self.clock.utime(), "engaged": engaged, "source": "test"}
        self.send(ESTOP.channel(), make(estop_t, **about, reason=reason))

    def claim(self, sender: int, action: int = command_claim_t.CLAIM) -> None:
        """Claim the robot."""
        about = {"utime": self.clock.utime(), "robot_id": 0, "action": action}
        self.send(COMMAND_CLAIM.channel(0), make(command_claim_t, **about, claimant=f"pilot {sender}"), sender)

    def turn(self) -> None:
        """Let everything go round once, TURN later."""
        self.clock.time += TURN
        self.bridge.turn()
        waiting, self._waiting = self._waiting, []
        at_once = False
        for channel, message, sender in waiting:
            self.heard.append((channel, message))
            if not self.is_deaf:
                at_once |= self.bridge.handle(message.utime, channel, message, sender)
        is_due = self.clock.time >= self._due - 1e-9
        if is_due:  # at its rate, beside what is sent at once
            self._due += 1.0 / self.bridge.profile.command.rate
        if at_once or is_due:
            velocity = self.bridge.velocity()
            self.sent.append((self.clock.time, velocity))
            if not self._is_deserted:
                self.robot.command(velocity)
        for reading in () if self._is_deserted else self.robot.readings():
            self._take(reading)

    def start(self) -> None:
        """Wait until the bridge takes commands."""
        self.wait(LISTENING_TIME + 2.0 * TURN)

    @property
    def status(self) -> int:
        """The status of the last feedback."""
        return next(int(one.status) for _, one in reversed(self.heard) if isinstance(one, motor_feedback_t))

    def _take(self, reading: Any) -> None:
        readings = self.bridge.readings
        take: Callable[[Any, int], Any]
        if isinstance(reading, Joints):
            kind, take = JOINT_STATE, readings.wheels
            write_joints(message := empty(kind), reading)
        elif isinstance(reading, Odometry):
            kind, take = ODOMETRY, readings.wheels
            write_odometry(message := empty(kind), reading)
        elif isinstance(reading, Placed):
            kind, take = POSE_STAMPED, readings.pose
            write_pose(message := empty(kind), reading)
        else:
            kind, take = IMU, readings.gyro
            write_imu(message := empty(kind), reading[0], "imu_link", reading[1])
        if take != readings.wheels or kind == self.bridge.profile.wheels.type:
            for stream, robot_id, outgoing in take(carried(kind, message), self.clock.utime()):
                self.heard.append((stream.channel(robot_id), outgoing))


def messages_of(
    settings: Settings, nominal: ParameterFile, manoeuvre: str = "figure_eight", **options: Any
) -> list[tuple[str, Any]]:
    """Return the messages of a drive over the bridge, as (channel, message): as cmr-pilot commands a manoeuvre."""
    bench = Bench(settings, **options)
    bench.start()
    bench.wait(2.0)
    bench.follow(nominal, manoeuvre)
    return bench.heard


def profile_of(text: str, *changes: tuple[str, str]) -> Profile:
    """Return a profile from a text in which some words are replaced."""
    for before, after in changes:
        assert before in text, before
        text = text.replace(before, after)
    return Profile.parse(text)


def example_text() -> str:
    """Return the text of the profile to copy."""
    import robot_driver.ros2.profile as module

    return (Path(module.__file__).parent / "profiles" / "example.yaml").read_text(encoding="utf-8")

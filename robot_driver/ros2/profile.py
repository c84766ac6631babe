"""The profile of a ROS 2 robot: its topics, its own command timeout, and the source of that."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from cmr.documents.declared import Between, Word
from cmr.documents.document import DocumentError, Item, read, read_file
from cmr.documents.structure import structured
from cmr.model.duty_ramp import Limits
from robot_driver.ros2.messages import (
    IMU,
    JOINT_STATE,
    ODOMETRY,
    POSE_STAMPED,
    POSE_WITH_COVARIANCE,
    TWIST,
    TWIST_STAMPED,
)

SCHEMA = 1
FOLDER = Path(__file__).with_name("profiles")
COMMANDS, WHEELS, POSES = (
    (TWIST, TWIST_STAMPED),
    (JOINT_STATE, ODOMETRY),
    (POSE_STAMPED, POSE_WITH_COVARIANCE, ODOMETRY),
)
RELIABILITIES = ("reliable", "best_effort")
SPEED_UNITS = ("rad/s", "m/s", "none")
TOPIC = re.compile(r"[~/]?[A-Za-z][A-Za-z0-9_]*(/[A-Za-z][A-Za-z0-9_]*)*")
TF, TF_STATIC = "/tf", "/tf_static"


class ProfileError(DocumentError):
    """A profile cannot be used; the text names file, line and key."""

    after = " "
    empty = "is empty; 'cmr-ros2 --probe FILE' writes one to begin with"


@dataclass(frozen=True)
class Base:
    """The robot's own stop when commands end: `command_timeout` [s] after the last command; None: it has none.

    `source` is the source of this information.
    """

    source: str
    command_timeout: Annotated[float, Between(0.01, 60.0)] | None = None


@dataclass(frozen=True)
class Command:
    """How the robot is commanded: topic, type, and the largest speed [m/s] and turn rate [rad/s] that it is sent.

    `rate` [Hz] is the rate of sending. The ramps are in multiples of the largest speed per second.
    """

    topic: str
    speed: Annotated[float, Between(0.01, 20.0)]
    turn_rate: Annotated[float, Between(0.05, 60.0)]
    type: Annotated[str, Word(lambda: COMMANDS)] = TWIST
    frame: str = "base_link"
    rate: Annotated[float, Between(5.0, 200.0)] = 50.0
    speeding_up: Annotated[float, Between(0.1, 1000.0)] = 10.0
    slowing_down: Annotated[float, Between(0.1, 1000.0)] = 20.0

    def __post_init__(self) -> None:
        _check_topic(self.topic)
        self.ramp  # noqa: B018 - raises ValueError for an invalid ramp

    @property
    def ramp(self) -> Limits:
        """Ramp of the velocity sent, in shares of the largest speed and turn rate per second."""
        return Limits(self.speeding_up, self.slowing_down)


@dataclass(frozen=True)
class Wheels:
    """Source of the wheels' angles and speeds: joints by name, or for a robot without them its odometry.

    `speed` is the unit in which the joints' velocities are published; none: they are computed from the angles. A sign
    of -1 is for joints that turn backward when the robot drives forward. `reliability` of a driver that publishes for
    sensors is best_effort.
    """

    topic: str
    type: Annotated[str, Word(lambda: WHEELS)] = JOINT_STATE
    left: str = ""
    right: str = ""
    sign: Annotated[int, Between(-1, 1)] = 1
    speed: Annotated[str, Word(lambda: SPEED_UNITS)] = "rad/s"
    ticks_per_turn: Annotated[int, Between(8, 10**8)] = 65536
    reliability: Annotated[str, Word(lambda: RELIABILITIES)] = "best_effort"

    def __post_init__(self) -> None:
        _check_topic(self.topic)
        if not self.sign:
            raise ValueError("the sign must be 1 or -1")
        if self.type == JOINT_STATE and not (self.joints[0] and self.joints[1]):
            raise ValueError("joints need names: left and right, of several wheels a side with commas between them")

    @property
    def joints(self) -> tuple[list[str], list[str]]:
        """The names of the joints of the left and the right wheels."""
        return _names(self.left), _names(self.right)


@dataclass(frozen=True)
class Gyro:
    """Source of the turn rate; a sign of -1 is for an IMU mounted upside down."""

    topic: str
    type: Annotated[str, Word(lambda: (IMU,))] = IMU
    sign: Annotated[int, Between(-1, 1)] = 1
    reliability: Annotated[str, Word(lambda: RELIABILITIES)] = "best_effort"

    def __post_init__(self) -> None:
        _check_topic(self.topic)
        if not self.sign:
            raise ValueError("the sign must be 1 or -1")


@dataclass(frozen=True)
class Pose:
    """Source of the pose in the world: a topic, or the chain of tf frames from the world's to the robot's."""

    topic: str = ""
    type: Annotated[str, Word(lambda: POSES)] = POSE_STAMPED
    frames: str = ""
    reliability: Annotated[str, Word(lambda: RELIABILITIES)] = "best_effort"

    def __post_init__(self) -> None:
        if self.topic:
            _check_topic(self.topic)
        if bool(self.topic) == bool(self.frames):
            raise ValueError("needs either a topic or frames, such as 'map, odom, base_link'")
        if self.frames and len(self.chain) < 2:
            raise ValueError("frames are at least two, such as 'map, base_link'")

    @property
    def chain(self) -> list[str]:
        """The frames, from the world's to the robot's."""
        return _names(self.frames)


@dataclass(frozen=True)
class Nominal:
    """Nominal values before calibration, as in the robot's parameter file."""

    wheel_radius: Annotated[float, Between(0.001, 2.0)]
    base_width: Annotated[float, Between(0.001, 10.0)]
    response_time: Annotated[float, Between(1e-3, 1e2)]
    top_wheel_speed: Annotated[float, Between(1e-2, 1e4)]
    command_base_width: Annotated[float, Between(0.001, 10.0)] | None = None


@dataclass(frozen=True)
class Profile:
    """A kind of robot; `tried` names the real robot on which the profile was tested, empty if none."""

    name: str
    base: Base
    command: Command
    wheels: Wheels
    nominal: Nominal
    sources: Sequence[str] = ()
    tried: str = ""
    gyro: Gyro | None = None
    pose: Pose | None = None

    @classmethod
    def load(cls, name: str) -> "Profile":
        """Read a profile: a shipped one, by its name, or a file. Raises ProfileError."""
        path = shipped().get(name) or Path(name)
        if not path.exists():
            raise ProfileError(f"There is no profile {name}: shipped are {', '.join(shipped())}; else name a file.")
        return _profile(read_file(path, ProfileError))

    @classmethod
    def parse(cls, text: str) -> "Profile":
        """Read a profile from a text. Raises ProfileError."""
        return _profile(read(text, "profile", ProfileError))

    @property
    def counted_width(self) -> float:
        """The base width [m] with which the robot converts (v, omega) to wheel speeds."""
        return self.nominal.command_base_width or self.nominal.base_width


def shipped() -> Mapping[str, Path]:
    """Return the profiles that CMR ships, by name."""
    return {path.stem: path for path in sorted(FOLDER.glob("*.yaml"))}


KEYS = ("schema", "name", "sources", "tried", "base", "command", "wheels", "gyro", "pose", "nominal")


def _profile(root: Item) -> Profile:
    section = root.section(KEYS)
    if section.need("schema").whole(1, 10**6) != SCHEMA:
        raise section["schema"].place.error(f"is not {SCHEMA}, which is all that this version reads")
    tried, gyro, pose = (section.get(key) for key in ("tried", "gyro", "pose"))
    return Profile(
        section.need("name").text(),
        structured(section.need("base"), Base),
        structured(section.need("command"), Command),
        structured(section.need("wheels"), Wheels),
        structured(section.need("nominal"), Nominal),
        sources=[item.text() for item in section.need("sources").items()],
        tried="" if tried is None or tried.value is False else tried.text(),
        gyro=None if gyro is None else structured(gyro, Gyro),
        pose=None if pose is None else structured(pose, Pose),
    )


def _check_topic(topic: str) -> None:
    if not TOPIC.fullmatch(topic):
        raise ValueError(f"{topic!r} is no name of a topic, such as cmd_vel or /tb3/odom")


def _names(text: str) -> list[str]:
    return [name for name in (part.strip() for part in text.split(",")) if name]

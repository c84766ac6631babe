"""Data of a checked mapping: tables of the recording, the signals in them, and the messages made of them."""

from dataclasses import dataclass, field
from datetime import datetime

import numpy as np

from cmr.model.command_kinds import DUTY, VELOCITY, WHEEL_SPEED

CSV_TABLE = "the file"  # a CSV file is one table; a log has one for each channel, a bag one for each topic

# utime: of the message. event_time: arrival by the log, for an invalid utime. shifted_utime: utime of a clock with the
# right rate but a wrong offset, shifted to the log's clock.
CLOCKS = ("utime", "event_time", "shifted_utime")

# header: of the message. received: arrival at the recorder. published: publication by an MCAP file. shifted_header:
# header of a clock with the right rate but a wrong offset, shifted to the recorder's clock.
TOPIC_CLOCKS = ("header", "received", "published", "shifted_header")

# Seconds per unit of a CSV file's time.
TIME_UNITS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}

# kept: the first pose of a piece is used, unless it repeats the last one of the piece before.
FIRST_POSES = ("left_out", "kept")

FEEDBACK_PAIRS = {"ticks": "ticks", "psi": "wheel_speed", "applied": "drive", "current": "current"}
FEEDBACK_SINGLES = {"battery_voltage": "voltage", "temperature": "temperature"}
BODY = {"v": "speed", "omega": "turn_rate"}
# Blocks of commands, with the kind of each, and the contents of those of speeds.
COMMAND_BLOCKS = {"motor_command": DUTY, "wheel_speed_command": WHEEL_SPEED, "velocity_command": VELOCITY}
SPEEDS = {WHEEL_SPEED: {"psi_left": "wheel_speed", "psi_right": "wheel_speed"}, VELOCITY: BODY}


@dataclass(frozen=True)
class Signal:
    """One quantity in the recording: ours = gain × recorded + shift, in our unit.

    `table` is its file, channel or topic (CSV_TABLE if there is one file), `columns` its name there (in a bag a path,
    see ros_fields); of a heading from a quaternion they are the members w and z, or w, x, y and z. `unit` is the
    recorded one. A signal that `holds` keeps its value from its row until the next one.
    """

    table: str
    columns: tuple[str, ...]
    unit: str
    gain: float
    shift: float
    holds: bool = False


@dataclass(frozen=True)
class Group:
    """The signals that make one kind of message, by the message's field; all are sampled at the times of `table`."""

    table: str
    signals: dict[str, Signal]


@dataclass(frozen=True)
class Feedback(Group):
    """Wheels, individually or as the body's `v` and `omega`. `ticks_per_turn` counts make one turn of a wheel."""

    ticks_per_turn: float


@dataclass(frozen=True)
class Command(Group):
    """Drives, as `left` and `right` or as the body's `v` and `omega`; duty 1 is `full_scale` [rad/s] where declared.

    Of another `kind` of cmr.model.command_kinds they are speeds, for a robot with a velocity controller inside.
    Commands that `hold` were recorded where they changed; each is in force until the next one.
    """

    full_scale: float | None
    holds: bool = False
    kind: str = DUTY


@dataclass(frozen=True)
class Pose(Group):
    """External pose.

    If `only_changes` names columns, rows that repeat them are not new measurements. `first` is one of FIRST_POSES.
    """

    only_changes: tuple[str, ...]
    first: str


@dataclass(frozen=True)
class Channel:
    """Layout of the messages of a foreign LCM channel, and which of CLOCKS gives their time."""

    layout: np.dtype[np.void]
    clock: str


@dataclass(frozen=True)
class Topic:
    """Which of TOPIC_CLOCKS gives the time of a bag's topic; its type's .msg text, for bags that do not define it."""

    clock: str
    definition: str | None


@dataclass(frozen=True)
class File:
    """How a CSV file is read: `time_column`, in units of `time_unit` [s], counts from `start`.

    `header` names the columns if the file itself does not. The first `skipped_lines` lines are skipped.
    """

    time_column: str
    time_unit: float
    start: datetime
    header: tuple[str, ...] = ()
    skipped_lines: int = 0


@dataclass(frozen=True)
class Pieces:
    """When the value in `column` changes, a new piece begins, `gap` seconds after the one before."""

    column: str
    gap: float


@dataclass(frozen=True)
class Mapping:
    """A checked mapping; exactly one of `channels` (LCM log), `topics` (bag) and `files` (CSV) is given.

    `files` has CSV_TABLE alone where the recording is one file; else the names of its files, in which `*` stands for
    what the files of one recording have in common.
    """

    name: str
    about: str
    nominal: dict[str, float]
    channels: dict[str, Channel] = field(default_factory=dict)
    topics: dict[str, Topic] = field(default_factory=dict)
    files: dict[str, File] = field(default_factory=dict)
    pieces: Pieces | None = None
    feedback: Feedback | None = None
    command: Command | None = None
    gyro: Group | None = None
    pose: Pose | None = None

    @property
    def groups(self) -> tuple[Group, ...]:
        """The groups that the robot's recordings have."""
        return tuple(group for group in (self.feedback, self.command, self.gyro, self.pose) if group is not None)

    def columns(self, table: str) -> tuple[str, ...]:
        """Return the columns of a table that the signals need."""
        signals = [signal for group in self.groups for signal in group.signals.values() if signal.table == table]
        needed = [column for signal in signals for column in signal.columns]
        if self.pose is not None and self.pose.table == table:
            needed += self.pose.only_changes
        return tuple(dict.fromkeys(needed))

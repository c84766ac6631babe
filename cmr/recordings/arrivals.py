"""Messages of one robot as arrays, in the order of arrival.

The single definition of which messages become samples of a recording, for live messages and logs.
"""

from array import array
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import TypeAlias

import numpy as np

from cmr.bus.message import Message
from cmr.bus.streams import (
    GYRO,
    MOTOR_COMMAND,
    MOTOR_DUTY,
    MOTOR_FEEDBACK,
    POSE,
    VELOCITY_COMMAND,
    WHEEL_SPEED_COMMAND,
    Stream,
)
from cmr.model.command_kinds import DUTY, VELOCITY, WHEEL_SPEED
from cmr.msg import motor_command_t, parameters_t, velocity_command_t, wheel_speed_command_t
from cmr.parameters.file import ParameterFile, ParameterFileError, parse
from cmr.parameters.versions import Versions
from cmr.recordings.log_clock import LATEST_UTIME
from cmr.recordings.signal import Floats, Mask, Signal, Times, no_times

Command: TypeAlias = motor_command_t | wheel_speed_command_t | velocity_command_t
NOT_FINITE = "not a finite number"  # why a message is not a sample
# The stream of each kind of command.
COMMANDS_OF: dict[str, Stream[Command]] = {
    DUTY: MOTOR_COMMAND,
    WHEEL_SPEED: WHEEL_SPEED_COMMAND,
    VELOCITY: VELOCITY_COMMAND,
}
LAST_NUMBER = 2**63 - 1  # later than any message


@dataclass(frozen=True)
class Kept:
    """What a recording keeps of one stream.

    `fields` of the message after utime. A message is skipped if one of `finite` is not finite, or the field `flag` is
    0. `measured` marks streams that only a real robot has.
    """

    stream: Stream[Message]
    fields: tuple[str, ...]
    finite: tuple[str, ...]
    flag: str | None = None
    measured: bool = False

    @property
    def columns(self) -> tuple[str, ...]:
        """The columns to collect: the kept fields and the flag."""
        return self.fields if self.flag is None else (*self.fields, self.flag)


COMMANDS = Kept(MOTOR_COMMAND, ("left", "right"), finite=("left", "right"))
WHEEL_SPEED_COMMANDS = Kept(WHEEL_SPEED_COMMAND, ("psi_left", "psi_right"), finite=("psi_left", "psi_right"))
VELOCITY_COMMANDS = Kept(VELOCITY_COMMAND, ("v", "omega"), finite=("v", "omega"))
WHEELS = Kept(
    MOTOR_FEEDBACK,
    (
        "ticks_left",
        "ticks_right",
        "psi_left",
        "psi_right",
        "applied_left",
        "applied_right",
        "applied_utime",
        "received_utime",
        "status",
    ),
    finite=("ticks_left", "ticks_right", "psi_left", "psi_right"),
    measured=True,
)
DUTIES = Kept(MOTOR_DUTY, ("sent_left", "sent_right"), finite=("sent_left", "sent_right"))
GYRO_RATE = Kept(GYRO, ("yaw_rate",), finite=("yaw_rate",), flag="valid")
POSES = Kept(POSE, ("x", "y", "theta"), finite=("x", "y", "theta"), measured=True)

# The signals of a recording, by the name that Recording has for each.
KEPT: Mapping[str, Kept] = {
    "commands": COMMANDS,
    "wheels": WHEELS,
    "gyro": GYRO_RATE,
    "poses": POSES,
    "duties": DUTIES,
    "wheel_speed_commands": WHEEL_SPEED_COMMANDS,
    "velocity_commands": VELOCITY_COMMANDS,
}


COMMAND_SIGNALS = ("commands", "wheel_speed_commands", "velocity_commands")  # kinds of commands to robots


@dataclass(frozen=True)
class Arrivals:
    """All messages of one stream in the order of arrival.

    `utime` [us], `number` (increasing; the index among all messages of the log or drive) and the `columns`, in the
    units of the message type, are of shape (n,).
    """

    utime: Times
    number: Times
    columns: dict[str, Floats]

    @classmethod
    def none(cls, kept: Kept) -> "Arrivals":
        """Return empty arrivals."""
        return cls(no_times(), no_times(), {name: np.empty(0) for name in kept.columns})

    def where(self, keep: Mask) -> "Arrivals":
        """Return the messages at which `keep`, shape (n,), is true."""
        if keep.all():
            return self
        columns = {name: values[keep] for name, values in self.columns.items()}
        return Arrivals(self.utime[keep], self.number[keep], columns)

    def finite(self, kept: Kept) -> Mask:
        """Return which messages have finite numbers in all required fields, shape (n,)."""
        finite = np.ones(len(self.utime), np.bool_)
        for name in kept.finite:
            finite &= np.isfinite(self.columns[name])
        return finite

    def usable(self, kept: Kept) -> "Arrivals":
        """Return the messages that can be samples."""
        usable = self.finite(kept)
        return self.where(usable if kept.flag is None else usable & (self.columns[kept.flag] != 0.0))

    def signal(self, kept: Kept) -> Signal:
        """Return the samples, sorted by time; of repeated times the first is kept."""
        finite = int(np.count_nonzero(self.finite(kept)))
        usable = self.usable(kept)
        left_out = {NOT_FINITE: len(self.utime) - finite, "marked as not valid": finite - len(usable.utime)}
        utime, number, columns = usable.utime, usable.number, usable.columns
        if np.any(utime[1:] <= utime[:-1]):
            utime, first = np.unique(utime, return_index=True)
            number, columns = number[first], {name: values[first] for name, values in columns.items()}
        left_out["of a time that was there before"] = len(usable.utime) - len(utime)
        fields = {name: columns[name] for name in kept.fields}
        return Signal(utime, fields, number, {reason: count for reason, count in left_out.items() if count})


class Announcements:
    """The parameter files announced of a robot.

    `taken` holds, with the number of the message that brought it, each file newer than all before; broken ones are
    ignored. `utime` [us] and `number` are those of every announcement.
    """

    def __init__(self) -> None:
        self.utime, self.number = array("q"), array("q")
        self.taken: list[tuple[int, ParameterFile]] = []
        self._versions = Versions()
        self._newest = -1

    def take(self, number: int, channel: str, message: parameters_t) -> None:
        """Process one announcement, a parameters_t."""
        self.utime.append(message.utime)
        self.number.append(number)
        version = self._versions.of(message, message.utime if 0 <= message.utime < LATEST_UTIME else 0)
        if version <= self._newest:
            return
        try:
            parameters = parse(message.yaml, channel)
        except ParameterFileError:
            return  # a broken announcement does not make the recording useless
        self.taken.append((number, parameters))
        self._newest = version

    def newest(self, number: int) -> ParameterFile | None:
        """Return the newest parameter file received up to this message number, None without one."""
        return next((parameters for at, parameters in reversed(self.taken) if at <= number), None)


@dataclass(frozen=True)
class RobotMessages:
    """All messages of one robot, in the order of arrival.

    `arrivals` holds those of the signals in `KEPT`, by the same names. `rejected` counts by (channel, reason) the
    messages that could not be decoded, `damaged_bytes` the size of damaged parts of the log. Messages after number
    `last` are not included.
    """

    robot_id: int
    arrivals: Mapping[str, Arrivals]
    announcements: Announcements = field(default_factory=Announcements)
    rejected: Mapping[tuple[str, str], int] = field(default_factory=dict)
    damaged_bytes: int = 0
    last: int = LAST_NUMBER

    @property
    def measured(self) -> int:
        """The number of messages that only a real robot sends: motor feedback or poses."""
        return sum(
            int(np.count_nonzero(self.arrivals[name].finite(kept))) for name, kept in KEPT.items() if kept.measured
        )

    @property
    def parameters(self) -> ParameterFile | None:
        """The newest parameter file announced, None without one."""
        return self.announcements.newest(self.last)

    def latest_utime(self) -> tuple[Times, Times]:
        """Return the number of each message, increasing, and the latest utime [us] up to it, shape (n,)."""
        announced = np.array(self.announcements.number, np.int64), np.array(self.announcements.utime, np.int64)
        streams = [(stream.number, stream.utime) for stream in self.arrivals.values()]
        number, utime = (np.concatenate(column) for column in zip(announced, *streams, strict=True))
        order = np.argsort(number)
        order = order[: np.searchsorted(number[order], self.last, side="right")]
        return number[order], np.maximum.accumulate(utime[order])

    def until(self, number: int) -> "RobotMessages":
        """Return the messages up to this message number."""
        arrivals = {name: stream.where(stream.number <= number) for name, stream in self.arrivals.items()}
        return replace(self, arrivals=arrivals, last=min(number, self.last))

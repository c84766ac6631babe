"""One robot's recording: commands, wheels, gyro and poses, each with its own times."""

from array import array
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from operator import attrgetter
from pathlib import Path
from typing import Any

import numpy as np

from cmr.bus.message import Message
from cmr.bus.streams import PARAMETERS
from cmr.model.command_kinds import DUTY, VELOCITY, WHEEL_SPEED
from cmr.msg import parameters_t
from cmr.parameters.file import ParameterFile
from cmr.recordings.arrivals import KEPT, Announcements, Arrivals, Kept, RobotMessages
from cmr.recordings.batch import read_robots
from cmr.recordings.events import LogReader
from cmr.recordings.pieces import Pieces
from cmr.recordings.signal import SECONDS, Floats, Mask, Signal, Times, no_times

__all__ = [
    "Floats",
    "Recorder",
    "Recording",
    "RecordingError",
    "Signal",
    "Times",
    "choose_robot",
    "read_log",
    "read_messages",
]

ALL_THE_TIME = ("commands", "wheels", "gyro", "poses")  # signals that are sampled throughout
OLDEST_APPLIED = 0.5  # s before the wheels are read; no driver sends a duty that long before


class RecordingError(Exception):
    """The log cannot be used; the text says why and what to do."""


@dataclass(frozen=True, repr=False)
class Recording:
    """The recorded signals of one robot; a signal that was not recorded is empty.

    `commands` are duties. A robot with a velocity controller inside has `wheel_speed_commands` [rad/s] or
    `velocity_commands` [m/s, rad/s] in their place; once they are converted into duties (`with_duties`), these are the
    commands. `duties` are those sent by the driver that are not in its feedback messages (`wheels`). `parameters` is
    the newest parameter file announced in the recording, None without one. `rejected` counts by (channel, reason)
    messages of the log that could not be decoded, `damaged_bytes` the size of its damaged parts.
    """

    robot_id: int
    commands: Signal
    wheels: Signal
    gyro: Signal
    poses: Signal
    duties: Signal = field(default_factory=lambda: _nothing("sent_left", "sent_right"))
    wheel_speed_commands: Signal = field(default_factory=lambda: _nothing("psi_left", "psi_right"))
    velocity_commands: Signal = field(default_factory=lambda: _nothing("v", "omega"))
    parameters: ParameterFile | None = None
    rejected: Mapping[tuple[str, str], int] = field(default_factory=dict)
    damaged_bytes: int = 0
    converted_from: str = ""

    def __repr__(self) -> str:
        samples = ", ".join(f"{name} {len(signal)}" for name, signal in self.signals.items())
        return f"<{type(self).__name__} of robot {self.robot_id}: {samples}>"

    @classmethod
    def read(cls, path: Path | str, robot_id: int | None = None) -> "Recording":
        """Read the recording of a robot from an LCM event log; `robot_id` may be left out if there is one robot.

        Raises RecordingError when the log cannot be opened, holds no robot or several to choose from.
        """
        return cls.of(read_messages(path, robot_id))

    @classmethod
    def of(cls, messages: RobotMessages) -> "Recording":
        """Make the recording from messages."""
        signals = {name: messages.arrivals[name].signal(kept) for name, kept in KEPT.items()}
        return cls(
            messages.robot_id,
            **_arguments(signals),
            parameters=messages.parameters,
            rejected=messages.rejected,
            damaged_bytes=messages.damaged_bytes,
        )

    @property
    def command_kind(self) -> str:
        """The kind of commands: one of `cmr.model.command_kinds`; DUTY without commands.

        If several kinds were recorded, it is the one closest to the motors.
        """
        if self.converted_from or len(self.duty):
            return self.converted_from or DUTY
        if len(self.wheel_speed_commands):
            return WHEEL_SPEED
        return VELOCITY if len(self.velocity_commands) else DUTY

    def with_duties(self, left: Floats, right: Floats) -> "Recording":
        """Return the recording with duties, of the commands' shape, in place of commanded speeds."""
        kind = self.command_kind
        given = self.wheel_speed_commands if kind == WHEEL_SPEED else self.velocity_commands
        commands = replace(given, fields={"left": left, "right": right})
        return replace(self, commands=commands, converted_from=kind)

    @property
    def duty(self) -> Signal:
        """The drive of each side (fields left, right) [duty]: applied duties and their times, or else the commands.

        Applied duties also have the field status: the driver's condition, as in motor_feedback_t. If the driver does
        not report when it sent a duty, the time of the feedback is used.
        """
        sent = np.isfinite(self.wheels["applied_left"]) & np.isfinite(self.wheels["applied_right"])
        if not sent.any():
            return self.commands
        utime = np.maximum.accumulate(self._applied_utime[sent])
        new = np.diff(utime, prepend=utime[0] - 1) > 0
        fields = {side: self.wheels[f"applied_{side}"] for side in ("left", "right")}
        fields["status"] = self._of_feedback("status")
        reported = Signal(utime[new], {name: values[sent][new] for name, values in fields.items()})
        return _with_unreported(reported, self.duties) if len(self.duties) else reported

    @property
    def _applied_utime(self) -> Times:
        """The time [us] at which the duty of each feedback was sent; the feedback's own time if unknown."""
        utime, given = self.wheels.utime, self._of_feedback("applied_utime")
        known = (given > 0) & (given <= utime) & (utime - given < OLDEST_APPLIED / SECONDS)
        return np.where(known, np.where(known, given, 0.0).astype(np.int64), utime)

    @property
    def driven_on_the_bus(self) -> bool:
        """Whether the robot's driver takes MOTOR_COMMAND: only our driver reports when it applied duties, imports do
        not.
        """
        return len(self.duties) > 0 or bool(np.any(self._of_feedback("applied_utime") > 0))

    def _of_feedback(self, name: str) -> Floats:
        """A field of the feedback; 0 if it was not recorded."""
        return self.wheels.fields.get(name, np.zeros(len(self.wheels)))

    @property
    def signals(self) -> dict[str, Signal]:
        """The continuously recorded signals, by name: commands, wheels, gyro, poses."""
        return {name: getattr(self, name) for name in ALL_THE_TIME}

    @cached_property
    def pieces(self) -> Pieces:
        """The pieces between pauses of all signals."""
        return Pieces.of(self.signals.values())

    def between(self, first: int, last: int) -> "Recording":
        """Return the part from utime `first` to `last`, both included."""
        return self.with_signals({name: getattr(self, name).between(first, last) for name in KEPT})

    def where(self, keep: Mapping[str, Mask]) -> "Recording":
        """Return the samples at which `keep`, of shape (n,) for each signal named in it, is true."""
        return self.with_signals({name: self.signals[name].where(mask) for name, mask in keep.items()})

    def with_signals(self, signals: Mapping[str, Signal]) -> "Recording":
        """Return the recording with these signals, by name, replacing its own."""
        return replace(self, **_arguments(signals))


def _arguments(signals: Mapping[str, Signal]) -> dict[str, Any]:
    """Return signals as keyword arguments of Recording."""
    return dict(signals)


def _nothing(*names: str) -> Signal:
    return Signal(no_times(), {name: np.empty(0) for name in names})


def _with_unreported(reported: Signal, unreported: Signal) -> Signal:
    """Return the duties in feedback together with the others, in the order of sending."""
    utime = np.concatenate([reported.utime, unreported.utime])
    utime, first = np.unique(utime, return_index=True)
    more = {"left": unreported["sent_left"], "right": unreported["sent_right"], "status": np.zeros(len(unreported))}
    return Signal(utime, {name: np.concatenate([reported[name], more[name]])[first] for name in reported.fields})


class Recorder:
    """Collects the recording of one robot from messages, live or from a log."""

    def __init__(self, robot_id: int) -> None:
        self.robot_id = robot_id
        self._announcements = Announcements()
        self._announcing = PARAMETERS.channel(robot_id)
        self._columns = {kept.stream.channel(robot_id): _Columns(kept) for kept in KEPT.values()}
        self._number = 0

    def handle(self, _utime: int, channel: str, message: Message) -> None:
        """Handle one message; those of other robots and streams are ignored."""
        columns = self._columns.get(channel)
        if columns is not None:
            columns.add(self._number, message)
        elif isinstance(message, parameters_t) and channel == self._announcing:
            self._announcements.take(self._number, channel, message)
        self._number += 1

    def forget(self, before: int) -> None:
        """Drop samples before this utime [us]; parameters are kept."""
        for columns in self._columns.values():
            columns.forget(before)

    @property
    def measured(self) -> int:
        """The number of collected messages that only a real robot sends: motor feedback or poses."""
        return self.messages().measured

    @property
    def parameters(self) -> ParameterFile | None:
        """The newest parameter file announced, None without one."""
        return self._announcements.newest(self._number)

    def messages(self) -> RobotMessages:
        """Return all messages gathered so far, as arrays in the order of arrival."""
        arrivals = {name: self._columns[kept.stream.channel(self.robot_id)].arrivals() for name, kept in KEPT.items()}
        return RobotMessages(self.robot_id, arrivals, self._announcements, last=self._number)

    def recording(self) -> Recording:
        """Return what has been gathered so far."""
        return Recording.of(self.messages())


class _Columns:
    """Messages of one stream, gathered one by one: 16 bytes each and 8 for each field."""

    def __init__(self, kept: Kept) -> None:
        self._names = kept.columns
        self._fields: list[Callable[[Message], float]] = [attrgetter(name) for name in kept.columns]
        self._times, self._values = array("q"), array("d")

    def add(self, number: int, message: Message) -> None:
        self._times.extend((message.utime, number))
        self._values.extend([field(message) for field in self._fields])

    def arrivals(self) -> Arrivals:
        times = np.array(self._times, np.int64).reshape(-1, 2)
        values = np.array(self._values, np.float64).reshape(-1, len(self._names))
        columns = {name: values[:, column].copy() for column, name in enumerate(self._names)}
        return Arrivals(times[:, 0].copy(), times[:, 1].copy(), columns)

    def forget(self, before: int) -> None:
        times = np.array(self._times, np.int64).reshape(-1, 2)
        keep = times[:, 0] >= before
        values = np.array(self._values, np.float64).reshape(-1, len(self._names))
        self._times, self._values = array("q", times[keep].tobytes()), array("d", values[keep].tobytes())


def read_messages(path: Path | str, robot_id: int | None = None) -> RobotMessages:
    """Read a robot's messages from an LCM event log; `robot_id` may be omitted if there is only one robot.

    Raises RecordingError when the log cannot be opened, holds no robot, or several and none is chosen.
    """
    try:
        robots = read_robots(path)
    except OSError as error:
        raise _cannot_be_opened(path, error) from error
    return robots[choose_robot({robot: messages.measured for robot, messages in robots.items()}, robot_id, str(path))]


def read_log(path: Path | str) -> LogReader:
    """Open an event log to read it message by message.

    Raises RecordingError when it cannot be opened.
    """
    try:
        return LogReader(Path(path))
    except OSError as error:
        raise _cannot_be_opened(path, error) from error


def choose_robot(measured: dict[int, int], robot_id: int | None, source: str) -> int:
    """Return the selected robot: `robot_id`, or the only one with measurements; `measured` counts them by robot.

    Raises RecordingError when there is none, or a choice.
    """
    present = sorted(robot for robot, count in measured.items() if count)
    if robot_id is not None:
        if robot_id in present:
            return robot_id
        raise RecordingError(f"{source}: nothing measured of robot {robot_id}; it has {present or 'no robot'}")
    if len(present) == 1:
        return present[0]
    if not present:
        raise RecordingError(
            f"{source}: no MOTOR_FEEDBACK_N or POSE_N in it. Logs of other robots come in through cmr-import."
        )
    raise RecordingError(f"{source}: holds robots {present}; choose one with --robot")


def _cannot_be_opened(path: Path | str, error: OSError) -> RecordingError:
    return RecordingError(f"{path}: cannot be opened: {error.strerror}")

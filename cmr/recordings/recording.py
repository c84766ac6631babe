"""One robot's recording: commands, wheels, gyro and external pose, each on its own clocked time line."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cmr.bus.streams import GYRO, MOTOR_COMMAND, MOTOR_FEEDBACK, PARAMETERS, POSE, Stream, identify
from cmr.parameters.file import ParameterFile, ParameterFileError, parse
from cmr.recordings.log import LogReader

Floats = NDArray[np.float64]
Times = NDArray[np.int64]

# The fields that are kept of each stream, after utime.
COMMAND_FIELDS = ("left", "right")
WHEEL_FIELDS = ("ticks_left", "ticks_right", "psi_left", "psi_right", "applied_left", "applied_right")
GYRO_FIELDS = ("yaw_rate",)
POSE_FIELDS = ("x", "y", "theta")


class RecordingError(Exception):
    """The log cannot be used; the text says why and what to do."""


@dataclass(frozen=True)
class Signal:
    """What one sensor, or the commander, said over time.

    `utime` [us] is strictly increasing, shape (n,); `fields` holds one array of shape (n,) for each field of the
    message type, in its units.
    """

    utime: Times
    fields: dict[str, Floats]

    def __len__(self) -> int:
        return len(self.utime)

    def __getitem__(self, field: str) -> Floats:
        return self.fields[field]

    def between(self, first: int, last: int) -> "Signal":
        """Return the part from utime `first` to `last`, both included."""
        keep = (self.utime >= first) & (self.utime <= last)
        return Signal(self.utime[keep], {name: values[keep] for name, values in self.fields.items()})

    @classmethod
    def of(cls, rows: list[tuple[float, ...]], fields: tuple[str, ...]) -> "Signal":
        """Return the signal of rows (utime, fields...); sorted by time, the first of repeated times kept."""
        if not rows:
            return cls(np.empty(0, np.int64), {name: np.empty(0) for name in fields})
        utime, first = np.unique(np.array([row[0] for row in rows], np.int64), return_index=True)
        table = np.array([row[1:] for row in rows], np.float64)[first]
        return cls(utime, {name: table[:, column] for column, name in enumerate(fields)})


@dataclass(frozen=True)
class Recording:
    """All that was recorded of one robot; a signal that was not recorded is empty.

    `parameters` is the newest parameter file announced in the recording, None without one.
    """

    robot_id: int
    commands: Signal
    wheels: Signal
    gyro: Signal
    poses: Signal
    parameters: ParameterFile | None = None

    @classmethod
    def read(cls, path: Path | str, robot_id: int | None = None) -> "Recording":
        """Read the recording of a robot from an LCM event log; `robot_id` may be left out if there is one robot.

        Raises RecordingError when the log cannot be opened, holds no robot or several to choose from.
        """
        recorders: dict[int, Recorder] = {}
        for received in read_log(path):
            if received.robot_id is not None:
                recorder = recorders.setdefault(received.robot_id, Recorder(received.robot_id))
                recorder.handle(received.message.utime, received.channel, received.message)
        chosen = choose_robot({robot: recorder.measured for robot, recorder in recorders.items()}, robot_id, str(path))
        return recorders[chosen].recording()

    @property
    def duty(self) -> Signal:
        """The drive of each side (fields left, right) [duty]: what was really sent, else what was commanded."""
        sent = np.isfinite(self.wheels["applied_left"]) & np.isfinite(self.wheels["applied_right"])
        if not sent.any():
            return self.commands
        return Signal(
            self.wheels.utime[sent],
            {"left": self.wheels["applied_left"][sent], "right": self.wheels["applied_right"][sent]},
        )

    def between(self, first: int, last: int) -> "Recording":
        """Return the part from utime `first` to `last`, both included."""
        signals = ("commands", "wheels", "gyro", "poses")
        return replace(self, **{name: getattr(self, name).between(first, last) for name in signals})


class Recorder:
    """Gathers the recording of one robot from messages, live or from a log.

    `measured` counts messages that only a real robot has: feedback of its motors, or its pose.
    """

    def __init__(self, robot_id: int) -> None:
        self.robot_id = robot_id
        self.measured = 0
        self.parameters: ParameterFile | None = None
        self._sequence = -1
        self._rows: dict[str, list[tuple[float, ...]]] = {
            stream.name: [] for stream in (MOTOR_COMMAND, MOTOR_FEEDBACK, GYRO, POSE)
        }

    def handle(self, _utime: int, channel: str, message: Any) -> None:
        """Take one message; those of other robots and other streams are passed over."""
        stream, robot_id = identify(channel) or (None, None)
        if stream is None or robot_id != self.robot_id:
            return
        if stream is PARAMETERS:
            self._take_parameters(channel, message)
        elif stream is MOTOR_FEEDBACK:
            self._keep(stream, message, WHEEL_FIELDS, finite=4)
        elif stream is POSE:
            self._keep(stream, message, POSE_FIELDS, finite=3)
        elif stream is MOTOR_COMMAND:
            self._keep(stream, message, COMMAND_FIELDS, finite=2)
        elif stream is GYRO and message.valid:
            self._keep(stream, message, GYRO_FIELDS, finite=1)

    def forget(self, before: int) -> None:
        """Drop what was measured before this utime [us]; parameters stay."""
        for name, rows in self._rows.items():
            self._rows[name] = [row for row in rows if row[0] >= before]

    def recording(self) -> Recording:
        """Return what has been gathered so far."""
        return Recording(
            self.robot_id,
            commands=Signal.of(self._rows[MOTOR_COMMAND.name], COMMAND_FIELDS),
            wheels=Signal.of(self._rows[MOTOR_FEEDBACK.name], WHEEL_FIELDS),
            gyro=Signal.of(self._rows[GYRO.name], GYRO_FIELDS),
            poses=Signal.of(self._rows[POSE.name], POSE_FIELDS),
            parameters=self.parameters,
        )

    def _keep(self, stream: Stream, message: Any, fields: tuple[str, ...], finite: int) -> None:
        """Keep a message whose first `finite` fields are finite numbers."""
        row = tuple(getattr(message, name) for name in fields)
        if all(abs(value) < float("inf") for value in row[:finite]):
            self._rows[stream.name].append((message.utime, *row))
            self.measured += stream in (MOTOR_FEEDBACK, POSE)

    def _take_parameters(self, channel: str, message: Any) -> None:
        if message.sequence <= self._sequence:
            return
        try:
            self.parameters = parse(message.yaml, channel)
        except ParameterFileError:
            return  # a broken announcement does not make the recording useless
        self._sequence = message.sequence


def read_log(path: Path | str) -> LogReader:
    """Open an event log.

    Raises RecordingError when it cannot be opened.
    """
    try:
        return LogReader(Path(path))
    except OSError as error:
        raise RecordingError(f"{path}: cannot be opened: {error.strerror}") from error


def choose_robot(measured: dict[int, int], robot_id: int | None, source: str) -> int:
    """Return the robot meant: `robot_id`, or the only one with measurements; `measured` counts them by robot.

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

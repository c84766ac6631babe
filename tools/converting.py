"""Turn a foreign recording's tables into our messages, in the order of time."""

import heapq
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from datetime import datetime, timezone
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cmr.bus.messages import make
from cmr.bus.streams import GYRO, MOTOR_COMMAND, MOTOR_FEEDBACK, PARAMETERS, POSE, Stream
from cmr.parameters.file import ParameterFile, Value
from cmr.tools.mapping import FEEDBACK_PAIRS, FEEDBACK_SINGLES, Command, Feedback, Group, Mapping, Pose, Signal
from cmr.tools.quantities import TURN
from cmr.tools.sources import MICROSECONDS, Source, Table

Floats = NDArray[np.float64]

SIDES = ("left", "right")
COUNTED_WIDTH = "turn_rate_limit_base_width"  # what says so of a limit of the commanded turns
PIECE = 4096  # rows that are turned into messages at a time
DRIVE_TOLERANCE = 1e-6  # a duty of 1 that was stored as a 32-bit float may be a little more


class ConversionError(Exception):
    """The recording contradicts the mapping; the text says how and what to change."""


@dataclass(frozen=True)
class Event:
    """One message for the log, and the stream it belongs to."""

    stream: Stream
    message: Any


@dataclass(frozen=True)
class Batch:
    """All messages of one stream: a column for each field, the same `constants` in every message.

    The column `utime` does not decrease.
    """

    stream: Stream
    columns: dict[str, NDArray[Any]]
    constants: dict[str, int]

    @property
    def utime(self) -> NDArray[np.int64]:
        """Time of each message [us]."""
        return self.columns["utime"]

    def events(self) -> Iterator[Event]:
        """Yield the messages; they are made when they are asked for."""
        for start in range(0, len(self.utime), PIECE):
            piece = [values[start : start + PIECE].tolist() for values in self.columns.values()]
            for row in zip(*piece, strict=True):
                content = dict(zip(self.columns, row, strict=True))
                yield Event(self.stream, make(self.stream.message_type, **content, **self.constants))


class Conversion:
    """A recording as messages, to be iterated over in the order of time, the robot's nominal parameters first.

    What is kept are arrays: the messages of an hour would take ten times the memory.
    """

    def __init__(self, parameters: Event, batches: Sequence[Batch]) -> None:
        self._parameters = parameters
        self._batches = batches

    def __iter__(self) -> Iterator[Event]:
        yield self._parameters
        # At equal times commands stay before feedback, as the batches are.
        yield from heapq.merge(*(batch.events() for batch in self._batches), key=lambda event: event.message.utime)

    def times(self) -> list[tuple[Stream, NDArray[np.int64]]]:
        """Return each stream with the times of its messages [us], in the order in which they begin."""
        ordered = sorted(self._batches, key=lambda batch: int(batch.utime[0]))
        parameters = np.array([self._parameters.message.utime], np.int64)
        return [(self._parameters.stream, parameters), *((batch.stream, batch.utime) for batch in ordered)]


def convert(mapping: Mapping, source: Source, robot_id: int, provenance: dict[str, Any]) -> Conversion:
    """Return the recording's messages.

    What cannot be used is counted in `source.skipped`. Raises ConversionError when nothing is left, or a command is
    beyond full drive.
    """
    converter = _Converter(mapping, source, robot_id)
    batches = [batch for batch in converter.batches() if len(batch.utime)]
    if not batches:
        raise ConversionError("the recording holds no usable row of any signal")
    start = min(int(batch.utime[0]) for batch in batches)
    return Conversion(_parameters(mapping, robot_id, start, provenance), batches)


def _parameters(mapping: Mapping, robot_id: int, utime: int, provenance: dict[str, Any]) -> Event:
    """Return the nominal parameters, as old as the recording, so that whatever is calibrated later is newer.

    Where the body was commanded, they tell by which base width its turns became those of the wheels.
    """
    values = dict(mapping.nominal)
    if mapping.command is not None and "omega" in mapping.command.signals:
        values[COUNTED_WIDTH] = values["base_width"]
    parameter_file = ParameterFile(
        robot_id=robot_id,
        values={name: Value(value) for name, value in values.items()},
        provenance=provenance,
        written=datetime.fromtimestamp(utime // 1_000_000, timezone.utc),
    )
    message = parameter_file.announcement(sequence=utime)
    message.utime = utime
    return Event(PARAMETERS, message)


class _Converter:
    """The conversion of one recording."""

    def __init__(self, mapping: Mapping, source: Source, robot_id: int) -> None:
        self._mapping = mapping
        self._source = source
        self._robot_id = robot_id

    def batches(self) -> Iterator[Batch]:
        mapping = self._mapping
        if mapping.command is not None:
            yield self._commands(mapping.command)
        if mapping.feedback is not None:
            yield self._feedback(mapping.feedback)
        if mapping.gyro is not None:
            yield self._gyro(mapping.gyro)
        if mapping.pose is not None:
            yield self._poses(mapping.pose)

    def _commands(self, command: Command) -> Batch:
        table, values, _ = self._usable(MOTOR_COMMAND, command)
        if "omega" in values:
            values = self._wheel_drives(command, values["v"], values["omega"])
        largest = max((float(np.abs(values[side]).max(initial=0.0)) for side in SIDES), default=0.0)
        if largest > 1 + DRIVE_TOLERANCE:
            raise ConversionError(
                f"motor_command: the largest drive is {largest:.4g} of full drive; correct unit, scale or full_scale"
            )
        fields = {side: np.clip(values[side], -1.0, 1.0) for side in SIDES}
        return self._batch(MOTOR_COMMAND, table, fields)

    def _wheel_drives(self, command: Command, v: Floats, omega: Floats) -> dict[str, Floats]:
        """Return the drives that move the body at v [m/s] and omega [rad/s] by the nominal geometry."""
        radius, base = self._mapping.nominal["wheel_radius"], self._mapping.nominal["base_width"]
        assert command.full_scale is not None, "the mapping's check demands full_scale for a command of the body"
        left, right = ((v + sign * omega * base / 2) / radius / command.full_scale for sign in (-1, 1))
        return {"left": left, "right": right}

    def _feedback(self, feedback: Feedback) -> Batch:
        table, values, raw = self._usable(MOTOR_FEEDBACK, feedback)
        keep = np.ones(len(table.utime), bool)
        for side in SIDES:
            ticks, psi = f"ticks_{side}", f"psi_{side}"
            if ticks in values:
                values[ticks] = _counted(feedback.signals[ticks], values[ticks], raw[ticks])
            if psi not in values:
                values[psi] = _wheel_speed(table, values[ticks], feedback.ticks_per_turn)
                keep &= np.isfinite(values[psi])
            if ticks not in values:
                values[ticks] = np.rint(_turned(table, values[psi]) / TURN * feedback.ticks_per_turn)
        self._skip(MOTOR_FEEDBACK, "row that only starts the count, or is no later than the one before it", keep)
        unknown = np.full(len(table.utime), np.nan)
        names = [f"{name}_{side}" for name in FEEDBACK_PAIRS for side in SIDES] + list(FEEDBACK_SINGLES)
        fields: dict[str, NDArray[Any]] = {name: values.get(name, unknown) for name in names}
        for side in SIDES:
            fields[f"ticks_{side}"] = fields[f"ticks_{side}"].astype(np.int64)
        fields["received_utime"] = table.received_utime
        fields["applied_utime"] = np.zeros_like(table.received_utime)
        return self._batch(MOTOR_FEEDBACK, table, fields, keep, status=0)

    def _gyro(self, gyro: Group) -> Batch:
        table, values, _ = self._usable(GYRO, gyro)
        fields = values | {"received_utime": table.received_utime}
        return self._batch(GYRO, table, fields, valid=1)

    def _poses(self, pose: Pose) -> Batch:
        table, values, _ = self._usable(POSE, pose)
        keep = np.ones(len(table.utime), bool)
        if pose.only_changes:
            columns = np.stack([table.columns[name] for name in pose.only_changes])
            keep[1:] = (columns[:, 1:] != columns[:, :-1]).any(axis=0) | (table.segment[1:] != table.segment[:-1])
            self._skip(POSE, "row that repeats the pose before it", keep)
        return self._batch(POSE, table, values, keep)

    def _usable(self, stream: Stream, group: Group) -> tuple[Table, dict[str, Floats], dict[str, NDArray[Any]]]:
        """Return the group's rows with a number for every signal: table, signals in our units, and as recorded."""
        table = self._source.tables[group.table]
        raw = {name: self._recorded(signal, table, group) for name, signal in group.signals.items()}
        usable = np.ones(len(table.utime), bool)
        for values in raw.values():
            usable &= np.isfinite(values)
        self._skip(stream, "row without a number for each of its signals", usable)
        raw = {name: values[usable] for name, values in raw.items()}
        ours = {
            name: signal.gain * raw[name].astype(np.float64) + signal.shift for name, signal in group.signals.items()
        }
        return _rows(table, usable), ours, raw

    def _recorded(self, signal: Signal, table: Table, group: Group) -> NDArray[Any]:
        """Return a signal at the group's times; one that is on another channel is interpolated."""
        if signal.table == group.table:
            return table.columns[signal.column]
        other = self._source.tables[signal.table]
        values: Floats = np.interp(table.utime, other.utime, other.columns[signal.column], left=np.nan, right=np.nan)
        return values

    def _skip(self, stream: Stream, reason: str, keep: NDArray[np.bool_]) -> None:
        if not keep.all():
            self._source.skipped[stream.channel(self._robot_id), reason] += int((~keep).sum())

    def _batch(
        self,
        stream: Stream,
        table: Table,
        fields: dict[str, NDArray[Any]],
        keep: NDArray[np.bool_] | None = None,
        **constants: int,
    ) -> Batch:
        columns = fields | {"utime": table.utime}
        if keep is not None:
            columns = {name: values[keep] for name, values in columns.items()}
        return Batch(stream, columns, {"robot_id": self._robot_id, **constants})


def _rows(table: Table, keep: NDArray[np.bool_]) -> Table:
    columns = {name: values[keep] for name, values in table.columns.items()}
    return Table(table.utime[keep], table.received_utime[keep], table.segment[keep], columns)


def _counted(signal: Signal, ours: Floats, raw: NDArray[Any]) -> Floats:
    """Return the count since the first row, in whole ticks.

    A counter narrower than 64 bits may wrap around; differences in its own number type see through that.
    """
    if signal.unit == "ticks/row":
        return np.rint(np.cumsum(ours) - ours[:1])
    steps = np.diff(raw, prepend=raw[:1]).astype(np.float64)
    ticks: Floats = np.rint(np.cumsum(signal.gain * steps))
    return ticks


def _wheel_speed(table: Table, ticks: Floats, ticks_per_turn: float) -> Floats:
    """Return the mean speed since the row before [rad/s], NaN where there is none, or none at an earlier time."""
    seconds = np.diff(table.utime) / MICROSECONDS
    within = (np.diff(table.segment) == 0) & (seconds > 0)
    speed = np.full(len(ticks), np.nan)
    speed[1:][within] = np.diff(ticks)[within] / seconds[within] * TURN / ticks_per_turn
    return speed


def _turned(table: Table, psi: Floats) -> Floats:
    """Return the angle since the first row [rad] by the trapezoidal rule; between segments nothing turns."""
    seconds = np.where(np.diff(table.segment) == 0, np.diff(table.utime), 0) / MICROSECONDS
    return np.concatenate([[0.0], np.cumsum((psi[1:] + psi[:-1]) / 2 * seconds)])[: len(psi)]

"""Convert a foreign recording's tables to CMR's messages, in order of time."""

import heapq
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from datetime import datetime, timezone

import numpy as np
from numpy.typing import NDArray

from cmr.bus.message import Message
from cmr.bus.messages import MICROSECONDS, make
from cmr.bus.streams import GYRO, MOTOR_COMMAND, MOTOR_FEEDBACK, PARAMETERS, POSE, Stream
from cmr.model.command_kinds import DUTY
from cmr.parameters.file import ParameterFile, Value, sha256_of
from cmr.recordings.arrivals import COMMANDS_OF
from cmr_tools.importing.contradictions import speeds_against_ticks
from cmr_tools.importing.layout import Column
from cmr_tools.importing.mapping_types import (
    FEEDBACK_PAIRS,
    FEEDBACK_SINGLES,
    Command,
    Feedback,
    Group,
    Mapping,
    Pose,
    Signal,
)
from cmr_tools.importing.quantities import TURN
from cmr_tools.importing.sampling import SamplingError, in_force_again, recorded, rows_of
from cmr_tools.importing.sources import Source, Table

Floats = NDArray[np.float64]

SIDES = ("left", "right")
COUNTED_WIDTH = "turn_rate_limit_base_width"  # parameter for the base width with which commands are converted
A_SECOND = 1_000_000  # us
PIECE = 4096  # rows converted to messages at a time
STALE = "first pose of a piece, which may be older than the piece (first_of_piece: kept would use it)"
BODY_FEEDBACK = (
    "the wheel speeds follow from v and omega by wheel_radius {wheel_radius:.6g} m and base_width {base_width:.6g} m"
)
DRIVE_TOLERANCE = 1e-6  # a duty of 1 stored as a 32-bit float may be slightly larger


class ConversionError(Exception):
    """The recording contradicts the mapping; the text says how and what to change."""


@dataclass(frozen=True)
class Event:
    """One message for the log, and the stream it belongs to."""

    stream: Stream[Message]
    message: Message


@dataclass(frozen=True)
class Batch:
    """All messages of one stream: a column for each field, the same `constants` in every message.

    The column `utime` does not decrease.
    """

    stream: Stream[Message]
    columns: dict[str, Column]
    constants: dict[str, int | str]

    @property
    def utime(self) -> NDArray[np.int64]:
        """Time of each message [us]."""
        return self.columns["utime"]

    def events(self) -> Iterator[Event]:
        """Yield the messages; they are created one at a time."""
        for start in range(0, len(self.utime), PIECE):
            piece = [values[start : start + PIECE].tolist() for values in self.columns.values()]
            for row in zip(*piece, strict=True):
                content = dict(zip(self.columns, row, strict=True))
                yield Event(self.stream, make(self.stream.message_type, **content, **self.constants))


class Conversion:
    """A recording as messages, in order of time, the robot's nominal parameters first.

    It stores arrays: the messages of an hour would take ten times the memory.
    """

    def __init__(self, batches: Sequence[Batch]) -> None:
        self._batches = batches

    def __iter__(self) -> Iterator[Event]:
        # At equal times parameters stay before commands and these before feedback, as the batches are.
        yield from heapq.merge(*(batch.events() for batch in self._batches), key=lambda event: event.message.utime)

    def times(self) -> list[tuple[Stream[Message], NDArray[np.int64]]]:
        """Return each stream with the times of its messages [us], in the order in which they begin."""
        ordered = sorted(self._batches, key=lambda batch: int(batch.utime[0]))
        return [(batch.stream, batch.utime) for batch in ordered]


def convert(mapping: Mapping, source: Source, robot_id: int, provenance: dict[str, object]) -> Conversion:
    """Return the recording's messages.

    Unusable rows are counted in `source.skipped`. Raises ConversionError if nothing is left, or if a command exceeds
    full drive.
    """
    converter = _Converter(mapping, source, robot_id)
    batches = [batch for batch in converter.batches() if len(batch.utime)]
    if not batches:
        raise ConversionError("the recording holds no usable row of any signal")
    return Conversion([_parameters(mapping, robot_id, batches, provenance), *batches])


def _parameters(mapping: Mapping, robot_id: int, batches: Sequence[Batch], provenance: dict[str, object]) -> Batch:
    """Return the nominal parameters, as old as the recording, so that whatever is calibrated later is newer.

    They are repeated as on the bus, in each second in which something was recorded, so that any piece of the log holds
    them: a damaged stamp brings one more. Where the body was commanded, they say by which base width its turns became
    those of the wheels.
    """
    first = min(int(batch.utime[0]) for batch in batches)
    seconds = np.unique(np.concatenate([(batch.utime - first) // A_SECOND for batch in batches]))
    values = dict(mapping.nominal)
    if mapping.command is not None and mapping.command.kind == DUTY and "omega" in mapping.command.signals:
        values[COUNTED_WIDTH] = values["base_width"]
    text = ParameterFile(
        robot_id=robot_id,
        values={name: Value(value) for name, value in values.items()},
        provenance=provenance,
        written=datetime.fromtimestamp(first // A_SECOND, timezone.utc),
    ).to_yaml()
    constants: dict[str, int | str] = {"robot_id": robot_id, "sequence": first, "sha256": sha256_of(text), "yaml": text}
    return Batch(PARAMETERS, {"utime": first + seconds * A_SECOND}, constants)


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
        stream = COMMANDS_OF[command.kind]
        table, values, _ = self._usable(stream, command)
        if command.kind != DUTY:
            return self._batch(stream, table, dict(values))
        if "omega" in values:
            values = self._drives(command, values["v"], values["omega"])
        largest = max((float(np.abs(values[side]).max(initial=0.0)) for side in SIDES), default=0.0)
        if largest > 1 + DRIVE_TOLERANCE:
            raise ConversionError(
                f"motor_command: the largest drive is {largest:.4g} of full drive; correct unit, scale or full_scale"
            )
        fields = {side: np.clip(values[side], -1.0, 1.0) for side in SIDES}
        return self._batch(MOTOR_COMMAND, table, fields)

    def _drives(self, command: Command, v: Floats, omega: Floats) -> dict[str, Floats]:
        """Return the drives for a body at v [m/s] and omega [rad/s] by the nominal geometry."""
        full_scale = command.full_scale
        assert full_scale is not None, "the mapping's check demands full_scale for a command of the body"
        return {side: speed / full_scale for side, speed in self._wheel_speeds(v, omega).items()}

    def _wheel_speeds(self, v: Floats, omega: Floats) -> dict[str, Floats]:
        """Return each wheel's speed [rad/s] for a body at v [m/s] and omega [rad/s], by the nominal geometry."""
        radius, base = self._mapping.nominal["wheel_radius"], self._mapping.nominal["base_width"]
        return {side: (v + sign * omega * base / 2) / radius for side, sign in zip(SIDES, (-1, 1), strict=True)}

    def _feedback(self, feedback: Feedback) -> Batch:
        table, values, raw = self._usable(MOTOR_FEEDBACK, feedback)
        keep = np.ones(len(table.utime), bool)
        turned = _turned
        if "omega" in values:
            turned = _turned_since
            speeds = self._wheel_speeds(values["v"], values["omega"])
            values |= {f"psi_{side}": speed for side, speed in speeds.items()}
            self._source.notes.append(BODY_FEEDBACK.format(**self._mapping.nominal))
        self._compare(feedback, table, values, raw)
        for side in SIDES:
            ticks, psi = f"ticks_{side}", f"psi_{side}"
            if ticks in values:
                values[ticks] = _counted(feedback.signals[ticks], values[ticks], raw[ticks])
            if psi not in values:
                values[psi] = _wheel_speed(table, values[ticks], feedback.ticks_per_turn)
                keep &= np.isfinite(values[psi])
            if ticks not in values:
                values[ticks] = np.rint(turned(table, values[psi]) / TURN * feedback.ticks_per_turn)
        self._skip(MOTOR_FEEDBACK, "row that only starts the count, or is no later than the one before it", keep)
        unknown = np.full(len(table.utime), np.nan)
        names = [f"{name}_{side}" for name in FEEDBACK_PAIRS for side in SIDES] + list(FEEDBACK_SINGLES)
        fields: dict[str, Column] = {name: values.get(name, unknown) for name in names}
        for side in SIDES:
            fields[f"ticks_{side}"] = fields[f"ticks_{side}"].astype(np.int64)
        fields["received_utime"] = table.received_utime
        fields["applied_utime"] = np.zeros_like(table.received_utime)
        return self._batch(MOTOR_FEEDBACK, table, fields, keep, status=0)

    def _compare(self, feedback: Feedback, table: Table, values: dict[str, Floats], raw: dict[str, Column]) -> None:
        """Note it where the wheel speeds contradict the ticks."""
        signals = feedback.signals
        sides = [side for side in SIDES if {f"ticks_{side}", f"psi_{side}"} <= set(signals)]
        if sides:
            counted = [_counted(signals[name], values[name], raw[name]) for name in (f"ticks_{one}" for one in sides)]
            by_ticks = np.diff(counted).ravel() / feedback.ticks_per_turn * TURN
            by_speed = np.diff([_turned(table, values[f"psi_{side}"]) for side in sides]).ravel()
            unit, radius = signals[f"psi_{sides[0]}"].unit, self._mapping.nominal["wheel_radius"]
            if contradiction := speeds_against_ticks(by_speed, by_ticks, unit, feedback.ticks_per_turn, radius):
                self._source.notes.append(contradiction)

    def _gyro(self, gyro: Group) -> Batch:
        table, values, _ = self._usable(GYRO, gyro)
        fields = values | {"received_utime": table.received_utime}
        return self._batch(GYRO, table, fields, valid=1)

    def _poses(self, pose: Pose) -> Batch:
        table, values, _ = self._usable(POSE, pose)
        begins = np.append(True, table.segment[1:] != table.segment[:-1])[: len(table.utime)]
        keep = np.ones(len(table.utime), bool)
        if pose.only_changes:
            keep = ~_repeated([table.columns[name] for name in pose.only_changes]) | begins
            self._skip(POSE, "row that repeats the pose before it", keep)
        # If only changes are measurements, the age of a piece's first pose is unknown.
        stale = begins if pose.first == "left_out" else begins & _repeated(list(values.values()))
        self._skip(POSE, STALE, ~stale)
        return self._batch(POSE, table, values, keep & ~stale)

    def _usable(self, stream: Stream[Message], group: Group) -> tuple[Table, dict[str, Floats], dict[str, Column]]:
        """Return the group's rows with a number for every signal: table, signals in CMR's units, and as recorded."""
        tables = self._source.tables
        table = tables[group.table]
        raw = {
            name: recorded(signal, table, tables[signal.table], _period(name, signal))
            for name, signal in group.signals.items()
        }
        usable = np.ones(len(table.utime), bool)
        for values in raw.values():
            usable &= np.isfinite(values)
        self._skip(stream, "row without a number for each of its signals", usable)
        table, raw = rows_of(table, usable), {name: values[usable] for name, values in raw.items()}
        if isinstance(group, Command) and group.holds:
            try:
                again = in_force_again(table, tables.values())
            except SamplingError as error:
                raise ConversionError(str(error)) from error
            table, raw = rows_of(table, again.rows, again.utime), {name: one[again.rows] for name, one in raw.items()}
        ours = {
            name: signal.gain * raw[name].astype(np.float64) + signal.shift for name, signal in group.signals.items()
        }
        return table, ours, raw

    def _skip(self, stream: Stream[Message], reason: str, keep: NDArray[np.bool_]) -> None:
        if not keep.all():
            self._source.skipped[stream.channel(self._robot_id), reason] += int((~keep).sum())

    def _batch(
        self,
        stream: Stream[Message],
        table: Table,
        fields: dict[str, Column],
        keep: NDArray[np.bool_] | None = None,
        **constants: int,
    ) -> Batch:
        columns = fields | {"utime": table.utime}
        if keep is not None:
            columns = {name: values[keep] for name, values in columns.items()}
        return Batch(stream, columns, {"robot_id": self._robot_id, **constants})


def _period(name: str, signal: Signal) -> float | None:
    """Return the recorded value at which a signal wraps around; None if it does not."""
    return TURN / abs(signal.gain) if name == "theta" and signal.gain else None


def _repeated(columns: Sequence[Column]) -> NDArray[np.bool_]:
    """Return which rows repeat all of these columns of the row before, shape (n,)."""
    values = np.stack(columns)
    return np.append(False, (values[:, 1:] == values[:, :-1]).all(axis=0))[: values.shape[1]]


def _counted(signal: Signal, ours: Floats, raw: Column) -> Floats:
    """Return the count since the first row, in whole ticks.

    A counter narrower than 64 bits may wrap around; differences in its own number type are still correct.
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
    return _sum_over(table, (psi[1:] + psi[:-1]) / 2)


def _turned_since(table: Table, psi: Floats) -> Floats:
    """Return the angle since the first row [rad] of speeds that are means since the row before.

    Odometry is like that: a base divides the encoders' counts by the time since they were last read. Taken for
    instantaneous speeds, they would be smoothed once more, which looks like a lag of the motors.
    """
    return _sum_over(table, psi[1:])


def _sum_over(table: Table, speeds: Floats) -> Floats:
    """Return the angle at each row, (n,), from the speeds between them, (n - 1,); between segments nothing turns."""
    seconds = np.where(np.diff(table.segment) == 0, np.diff(table.utime), 0) / MICROSECONDS
    return np.concatenate([[0.0], np.cumsum(speeds * seconds)])[: len(table.utime)]

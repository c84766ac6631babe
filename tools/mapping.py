"""The mapping file of one robot: where in its recordings our signals are, in which unit, with which sign and scale.

README.md beside the shipped mappings describes the format for those who write one.
"""

from collections.abc import Iterable
from dataclasses import dataclass, field
from datetime import datetime, timezone
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from cmr.parameters.file import ParameterFile, ParameterFileError, Value
from cmr.tools.block import Block, MappingError
from cmr.tools.layout import LayoutError, column_names, parse_layout
from cmr.tools.quantities import TURN, units
from cmr.tools.ros_fields import PathError, parse_path

SHIPPED = Path(__file__).resolve().parent / "mappings"
CSV_TABLE = "the file"  # a CSV file is one table; a log has one for each channel, a bag one for each topic

# utime: as the message says. event_time: when the log says it arrived, for a utime that is broken.
# shifted_utime: utime of a clock that runs well but was set wrong, moved as a whole to the log's clock.
CLOCKS = ("utime", "event_time", "shifted_utime")

# header: as the message's header says. received: when the recorder got it. published: when an MCAP file says it was.
# shifted_header: header of a clock that runs well but was set wrong, moved as a whole to the recorder's clock.
TOPIC_CLOCKS = ("header", "received", "published", "shifted_header")

FEEDBACK_PAIRS = {"ticks": "ticks", "psi": "wheel_speed", "applied": "drive", "current": "current"}
FEEDBACK_SINGLES = {"battery_voltage": "voltage", "temperature": "temperature"}


@dataclass(frozen=True)
class Signal:
    """One quantity in the recording: ours = gain × recorded + shift, in our unit.

    `table` is the channel or topic it is on (CSV_TABLE in a CSV file), `column` its name there (in a bag a path, see
    ros_fields), `unit` the recorded one.
    """

    table: str
    column: str
    unit: str
    gain: float
    shift: float


@dataclass(frozen=True)
class Group:
    """The signals that make one kind of message, by the message's field; all are sampled at the times of `table`."""

    table: str
    signals: dict[str, Signal]


@dataclass(frozen=True)
class Feedback(Group):
    """Wheels. `ticks_per_turn` counts make one turn of a wheel."""

    ticks_per_turn: float


@dataclass(frozen=True)
class Command(Group):
    """Drives, as `left` and `right` or as the body's `v` and `omega`; duty 1 is `full_scale` [rad/s] where declared."""

    full_scale: float | None


@dataclass(frozen=True)
class Pose(Group):
    """External pose. Where `only_changes` names columns, rows that repeat them are no new measurement."""

    only_changes: tuple[str, ...]


@dataclass(frozen=True)
class Channel:
    """How the messages of a foreign LCM channel are laid out, and which of CLOCKS is right about their time."""

    layout: np.dtype[Any]
    clock: str


@dataclass(frozen=True)
class Topic:
    """Which of TOPIC_CLOCKS is right about a bag's topic; its type's .msg text, for bags that do not define it."""

    clock: str
    definition: str | None


@dataclass(frozen=True)
class Rows:
    """How time runs in a CSV file: `time_column` [s] counts from `start`.

    Where `segment_column` changes its value, time starts anew, `gap` seconds after the segment before.
    """

    time_column: str
    start: datetime
    segment_column: str | None = None
    gap: float = 0.0


@dataclass(frozen=True)
class Mapping:
    """A checked mapping; exactly one of `channels` (LCM log), `topics` (bag) and `rows` (CSV) is given."""

    name: str
    about: str
    nominal: dict[str, float]
    channels: dict[str, Channel] = field(default_factory=dict)
    topics: dict[str, Topic] = field(default_factory=dict)
    rows: Rows | None = None
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
        needed = [signal.column for group in self.groups for signal in group.signals.values() if signal.table == table]
        if self.pose is not None and self.pose.table == table:
            needed += self.pose.only_changes
        return tuple(dict.fromkeys(needed))


def shipped() -> list[str]:
    """Return the names of the mappings that come with the package."""
    return sorted(path.stem for path in SHIPPED.glob("*.yaml"))


def load(name_or_path: str) -> Mapping:
    """Read and check a shipped mapping (by name) or one of the user's own (by path).

    Raises MappingError naming file, key and what is allowed.
    """
    is_name = name_or_path in shipped()
    path = SHIPPED / f"{name_or_path}.yaml" if is_name else Path(name_or_path)
    try:
        content = yaml.safe_load(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise MappingError(
            f"{path}: cannot be read ({error.strerror}); shipped mappings are {', '.join(shipped())}"
        ) from error
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        raise MappingError(f"{path}: is not YAML: {' '.join(str(error).split())}") from error
    return _Reader(Block(content, path.name)).mapping(path.stem)


class _Reader:
    """Turns the blocks of one mapping file into a Mapping."""

    def __init__(self, file: Block) -> None:
        self._file = file
        self._channels: dict[str, Channel] = {}
        self._topics: dict[str, Topic] = {}
        self._nominal: dict[str, float] = {}

    def mapping(self, name: str) -> Mapping:
        file = self._file
        about = file.text("about")
        kind = file.choice("format", ("lcm_log", "csv", "ros_bag"))
        rows = None
        if kind == "lcm_log":
            self._channels = self._read_channels(file.block("channels"))
        elif kind == "ros_bag":
            self._topics = self._read_topics(file.block("topics"))
        else:
            rows = self._read_rows(file)
        self._nominal = self._read_nominal(file.block("nominal"))
        mapping = Mapping(
            name=name,
            about=about,
            nominal=self._nominal,
            channels=self._channels,
            topics=self._topics,
            rows=rows,
            feedback=self._read_feedback(file.block("motor_feedback")) if file.value("motor_feedback") else None,
            command=self._read_command(file.block("motor_command")) if file.value("motor_command") else None,
            gyro=self._read_gyro(file.block("gyro")) if file.value("gyro") else None,
            pose=self._read_pose(file.block("pose")) if file.value("pose") else None,
        )
        file.finish()
        if not mapping.groups:
            raise MappingError(f"{file.place}: needs at least one of motor_feedback, motor_command, gyro, pose")
        for name in self._topics:
            if not mapping.columns(name):
                raise MappingError(f"{file.place}: topics: {name}: no signal is on it; leave it out")
        return mapping

    def _read_channels(self, block: Block) -> dict[str, Channel]:
        channels = {}
        for name in block:
            channel = block.block(name)
            try:
                layout = parse_layout(channel.text("layout"))
            except LayoutError as error:
                raise channel.error("layout", str(error)) from error
            clock = channel.choice("time", CLOCKS)
            if clock != "event_time" and "utime" not in column_names(layout):
                raise channel.error("time", f"{clock} needs a member utime in the layout; else use event_time")
            channel.finish()
            channels[name] = Channel(layout, clock)
        return channels

    def _read_topics(self, block: Block) -> dict[str, Topic]:
        topics = {}
        for name in block:
            topic = block.block(name)
            clock = topic.choice("time", TOPIC_CLOCKS)
            definition = None if topic.value("definition") is None else topic.text("definition")
            topic.finish()
            topics[name] = Topic(clock, definition)
        if not topics:
            raise MappingError(f"{block.place}: names no topic")
        return topics

    def _read_rows(self, file: Block) -> Rows:
        time = file.block("time")
        column, start = time.text("column"), time.value("start")
        if not isinstance(start, datetime):
            raise time.error("start", f"must be a time such as 2026-01-31T12:00:00Z, not {start!r}")
        start = start if start.tzinfo else start.replace(tzinfo=timezone.utc)
        time.finish()
        if file.value("segment") is None:
            return Rows(column, start)
        segment = file.block("segment")
        rows = Rows(column, start, segment.text("column"), segment.number("gap", positive=True))
        segment.finish()
        return rows

    def _read_nominal(self, block: Block) -> dict[str, float]:
        nominal = {name: block.number(name) for name in block}
        for name in ("wheel_radius", "base_width"):
            if name not in nominal:
                raise block.error(name, "is missing; wheel_radius and base_width [m] are needed")
        try:
            ParameterFile(robot_id=0, values={name: Value(value) for name, value in nominal.items()})
        except ParameterFileError as error:
            raise MappingError(f"{block.place}: {error}") from error
        return nominal

    def _read_feedback(self, block: Block) -> Feedback:
        quantities = {f"{name}_{side}": of for name, of in FEEDBACK_PAIRS.items() for side in ("left", "right")}
        table = self._table(block)
        ticks_per_turn = block.number("ticks_per_turn", positive=True)
        present = {key: of for key, of in (quantities | FEEDBACK_SINGLES).items() if block.value(key) is not None}
        signals = self._read_signals(block, present, table, ticks_per_turn=ticks_per_turn)
        block.finish()
        if not {"ticks_left", "ticks_right"} <= set(signals) and not {"psi_left", "psi_right"} <= set(signals):
            raise MappingError(f"{block.place}: needs ticks_left and ticks_right, or psi_left and psi_right, or all")
        for name in FEEDBACK_PAIRS:
            if (f"{name}_left" in signals) != (f"{name}_right" in signals):
                raise MappingError(f"{block.place}: {name}_left and {name}_right are needed together")
        return Feedback(table, signals, ticks_per_turn)

    def _read_command(self, block: Block) -> Command:
        table = self._table(block)
        full_scale = None if block.value("full_scale") is None else block.number("full_scale", positive=True)
        if block.value("v") is not None or block.value("omega") is not None:
            if full_scale is None:
                raise block.error("full_scale", "is missing; a command of the body needs the wheel speed of duty 1")
            signals = self._read_signals(block, {"v": "speed", "omega": "turn_rate"}, table)
        else:
            signals = self._read_signals(block, {"left": "drive", "right": "drive"}, table, full_scale)
        block.finish()
        return Command(table, signals, full_scale)

    def _read_gyro(self, block: Block) -> Group:
        table = self._table(block)
        group = Group(table, self._read_signals(block, {"yaw_rate": "turn_rate"}, table))
        block.finish()
        return group

    def _read_pose(self, block: Block) -> Pose:
        table = self._table(block)
        signals = self._read_signals(block, {"x": "length", "y": "length", "theta": "angle"}, table)
        only_changes = block.value("only_changes")
        if only_changes is True:
            columns = tuple(signal.column for signal in signals.values())
        elif isinstance(only_changes, str):
            self._check_column(block, "only_changes", table, only_changes)
            columns = (only_changes,)
        elif only_changes in (None, False):
            columns = ()
        else:
            raise block.error("only_changes", f"must be true (of the pose) or a column's name, not {only_changes!r}")
        block.finish()
        return Pose(table, signals, columns)

    def _table(self, block: Block, default: str | None = None) -> str:
        if self._channels:
            return block.choice("channel", self._channels, default)
        if self._topics:
            return block.choice("topic", self._topics, default)
        return CSV_TABLE

    def _read_signals(
        self,
        group: Block,
        quantities: dict[str, str],
        table: str,
        full_scale: float | None = None,
        ticks_per_turn: float | None = None,
    ) -> dict[str, Signal]:
        signals = {}
        for key, quantity in quantities.items():
            allowed = units(quantity, wheel_radius=self._nominal["wheel_radius"], full_scale=full_scale)
            if quantity == "ticks" and ticks_per_turn is not None:
                allowed |= {"rad": ticks_per_turn / TURN, "deg": ticks_per_turn / 360}
            signals[key] = self._read_signal(group.block(key), allowed, table)
        return signals

    def _read_signal(self, block: Block, allowed: dict[str, float], table: str) -> Signal:
        """Read one signal; `allowed` are its units and how many of ours each is."""
        column_key = "field" if self._channels or self._topics else "column"
        table = self._table(block, table)
        column = block.text(column_key)
        self._check_column(block, column_key, table, column)
        unit = block.choice("unit", allowed)
        sign = block.number("sign", 1.0)
        if sign not in (1.0, -1.0):
            raise block.error("sign", f"must be 1 or -1, not {sign:g}")
        factor = sign * allowed[unit]
        scale, offset = block.number("scale", 1.0), block.number("offset", 0.0)
        block.finish()
        return Signal(table, column, unit, gain=factor * scale, shift=factor * offset)

    def _check_column(self, block: Block, key: str, table: str, column: str) -> None:
        if self._channels:
            present: Iterable[str] = column_names(self._channels[table].layout)
            if column not in present:
                raise block.error(key, f"is {column!r}; {table} has {', '.join(present)}")
        if self._topics:
            try:
                parse_path(column)
            except PathError as error:
                raise block.error(key, str(error)) from error

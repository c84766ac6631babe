"""Read the mapping file of one robot: where CMR's signals are in its recordings, in which unit, sign and scale.

README.md beside the shipped mappings describes the format for those who write one.
"""

from collections.abc import Iterable
from collections.abc import Mapping as Dictionary
from datetime import datetime, timezone
from pathlib import Path

from cmr.documents.document import Place, quoted, read_file
from cmr.model.command_kinds import DUTY
from cmr.parameters.file import ParameterFile, ParameterFileError, Value
from cmr_tools.importing.block import Block, MappingError
from cmr_tools.importing.layout import LayoutError, column_names, parse_layout
from cmr_tools.importing.mapping_types import (
    BODY,
    CLOCKS,
    COMMAND_BLOCKS,
    CSV_TABLE,
    FEEDBACK_PAIRS,
    FEEDBACK_SINGLES,
    FIRST_POSES,
    SPEEDS,
    TIME_UNITS,
    TOPIC_CLOCKS,
    Channel,
    Command,
    Feedback,
    File,
    Group,
    Mapping,
    Pieces,
    Pose,
    Signal,
    Topic,
)
from cmr_tools.importing.quantities import TURN, units
from cmr_tools.importing.ros_fields import PathError, parse_path

SHIPPED = Path(__file__).resolve().parent / "mappings"
TICKS_PER_TURN = 65536.0  # for recordings without ticks: fine enough to preserve angles
USUAL_GAP = 5.0  # s between two pieces; estimates continue over gaps of less than 1 s
QUATERNION = ("w", "x", "y", "z")


def shipped() -> list[str]:
    """Return the names of the mappings that come with the package."""
    return sorted(path.stem for path in SHIPPED.glob("*.yaml"))


def load(name_or_path: str, nominal: Dictionary[str, float] | None = None) -> Mapping:
    """Read and check a shipped mapping (by name) or one of the user's own (by path).

    Values in `nominal` override the mapping's. Raises MappingError naming file, line, key and allowed values.
    """
    is_name = name_or_path in shipped()
    path = SHIPPED / f"{name_or_path}.yaml" if is_name else Path(name_or_path)
    if not path.is_file():
        raise MappingError(f"{path}: there is no such file; shipped mappings are {', '.join(shipped())}")
    return _Reader(Block(read_file(path, MappingError)), nominal or {}).mapping(path.stem)


class _Reader:
    """Converts the blocks of one mapping file to a Mapping."""

    def __init__(self, file: Block, nominal: Dictionary[str, float]) -> None:
        self._file = file
        self._channels: dict[str, Channel] = {}
        self._topics: dict[str, Topic] = {}
        self._files: dict[str, File] = {}
        self._nominal = dict(nominal)

    def mapping(self, name: str) -> Mapping:
        file = self._file
        about = file.text("about")
        kind = file.choice("format", ("lcm_log", "csv", "ros_bag"))
        pieces = None
        if kind == "lcm_log":
            self._channels = self._read_channels(file.block("channels"))
        elif kind == "ros_bag":
            self._topics = self._read_topics(file.block("topics"))
        else:
            self._files = self._read_files(file)
            pieces = self._read_pieces(file)
        self._nominal = self._read_nominal(file)
        mapping = Mapping(
            name=name,
            about=about,
            nominal=self._nominal,
            channels=self._channels,
            topics=self._topics,
            files=self._files,
            pieces=pieces,
            feedback=self._read_feedback(file.block("motor_feedback")) if file.value("motor_feedback") else None,
            command=self._read_any_command(),
            gyro=self._read_gyro(file.block("gyro")) if file.value("gyro") else None,
            pose=self._read_pose(file.block("pose")) if file.value("pose") else None,
        )
        file.finish()
        if not mapping.groups:
            needed = ", ".join(("motor_feedback", *COMMAND_BLOCKS, "gyro", "pose"))
            raise file.place.error(f"needs at least one of {needed}")
        for key, tables in (("topics", self._topics), ("files", self._files)):
            for table in tables:
                if not mapping.columns(table):
                    raise file.found(key, table).error("no signal is on it; leave it out")
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
            raise block.place.error("names no topic")
        return topics

    def _read_files(self, file: Block) -> dict[str, File]:
        if file.value("files") is None:
            return {CSV_TABLE: self._read_file(file)}
        block = file.block("files")
        files = {}
        for name in block:
            if name.count("*") > 1 or "/" in name:
                raise block.error(name, "must be the name of a file; one * in it may stand for the recording's name")
            one = block.block(name)
            files[name] = self._read_file(one)
            one.finish()
        if not files:
            raise block.place.error("names no file")
        return files

    def _read_file(self, block: Block) -> File:
        time = block.block("time")
        column, start = time.text("column"), time.value("start")
        if not isinstance(start, datetime):
            raise time.error("start", f"must be a time such as 2026-01-31T12:00:00Z, not {quoted(start)}")
        start = start if start.tzinfo else start.replace(tzinfo=timezone.utc)
        unit = TIME_UNITS[time.choice("unit", TIME_UNITS, "s")]
        time.finish()
        header = () if block.value("columns") is None else block.texts("columns")
        if header and column not in header:
            raise time.error("column", f"is {quoted(column)}; columns names {', '.join(header)}")
        return File(column, unit, start, header, block.count("skip_lines", 0))

    def _read_pieces(self, file: Block) -> Pieces | None:
        if file.value("segment") is None:
            return None
        segment = file.block("segment")
        pieces = Pieces(segment.text("column"), segment.number("gap", USUAL_GAP, positive=True))
        segment.finish()
        return pieces

    def _read_nominal(self, file: Block) -> dict[str, float]:
        given = file.value("nominal")
        if given is None and self._nominal:
            return self._checked_nominal(file.found("nominal"), self._nominal)
        block = file.block("nominal")
        return self._checked_nominal(block.place, {name: block.number(name) for name in block} | self._nominal)

    def _checked_nominal(self, place: Place, nominal: dict[str, float]) -> dict[str, float]:
        for name in ("wheel_radius", "base_width"):
            if name not in nominal:
                raise place.error(
                    f"{name}: is missing; wheel_radius and base_width [m] are needed, here or by --parameters"
                )
        try:
            ParameterFile(robot_id=0, values={name: Value(value) for name, value in nominal.items()})
        except ParameterFileError as error:
            raise place.error(str(error)) from error
        return nominal

    def _read_feedback(self, block: Block) -> Feedback:
        quantities = {f"{name}_{side}": of for name, of in FEEDBACK_PAIRS.items() for side in ("left", "right")}
        table = self._table(block)
        possible = quantities | BODY | FEEDBACK_SINGLES
        present = {key: of for key, of in possible.items() if block.value(key) is not None}
        has_ticks = "ticks_left" in present or "ticks_right" in present
        ticks_per_turn = block.number("ticks_per_turn", None if has_ticks else TICKS_PER_TURN, positive=True)
        signals = self._read_signals(block, present, table, ticks_per_turn=ticks_per_turn)
        block.finish()
        pairs = [*((f"{name}_left", f"{name}_right") for name in FEEDBACK_PAIRS), tuple(BODY)]
        if not any(set(pair) <= set(signals) for pair in (("ticks_left", "ticks_right"), pairs[1], pairs[-1])):
            raise block.place.error(
                "needs ticks_left and ticks_right, or psi_left and psi_right, or both, or the body's v and omega"
            )
        for one, other in pairs:
            if (one in signals) != (other in signals):
                raise block.place.error(f"{one} and {other} are needed together")
        if "psi_left" in signals and "v" in signals:
            raise block.place.error("map psi_left and psi_right, or v and omega, not both")
        return Feedback(table, signals, ticks_per_turn)

    def _read_any_command(self) -> Command | None:
        """Read the one kind of command that the robot takes; None if there is none."""
        present = [name for name in COMMAND_BLOCKS if self._file.value(name)]
        if len(present) > 1:
            raise self._file.place.error(f"a robot takes one kind of command, not {' and '.join(present)}")
        if not present:
            return None
        block, kind = self._file.block(present[0]), COMMAND_BLOCKS[present[0]]
        return self._read_command(block) if kind == DUTY else self._read_speed_command(block, kind)

    def _read_speed_command(self, block: Block, kind: str) -> Command:
        table, holds = self._table(block), block.switch("holds")
        signals = self._read_signals(block, SPEEDS[kind], table, holds=holds)
        block.finish()
        return Command(table, signals, None, holds, kind)

    def _read_command(self, block: Block) -> Command:
        table = self._table(block)
        full_scale = None if block.value("full_scale") is None else block.number("full_scale", positive=True)
        holds = block.switch("holds")
        if block.value("v") is not None or block.value("omega") is not None:
            if full_scale is None:
                raise block.error("full_scale", "is missing; a command of the body needs the wheel speed of duty 1")
            signals = self._read_signals(block, BODY, table, holds=holds)
        else:
            signals = self._read_signals(block, {"left": "drive", "right": "drive"}, table, full_scale, holds=holds)
        block.finish()
        return Command(table, signals, full_scale, holds)

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
            columns = tuple(column for one in signals.values() if one.table == table for column in one.columns)
        elif isinstance(only_changes, str):
            self._check_column(block, "only_changes", table, only_changes)
            columns = (only_changes,)
        elif only_changes in (None, False):
            columns = ()
        else:
            raise block.error(
                "only_changes", f"must be true (of the pose) or a column's name, not {quoted(only_changes)}"
            )
        first = block.choice("first_of_piece", FIRST_POSES, "left_out" if columns else "kept")
        block.finish()
        return Pose(table, signals, columns, first)

    @property
    def _column_key(self) -> str:
        return "column" if self._files else "field"

    def _table(self, block: Block, default: str | None = None) -> str:
        if self._channels:
            return block.choice("channel", self._channels, default)
        if self._topics:
            return block.choice("topic", self._topics, default)
        return CSV_TABLE if CSV_TABLE in self._files else block.choice("file", self._files, default)

    def _read_signals(
        self,
        group: Block,
        quantities: dict[str, str],
        table: str,
        full_scale: float | None = None,
        ticks_per_turn: float | None = None,
        holds: bool = False,
    ) -> dict[str, Signal]:
        signals = {}
        for key, quantity in quantities.items():
            allowed = units(quantity, wheel_radius=self._nominal["wheel_radius"], full_scale=full_scale)
            if quantity == "ticks" and ticks_per_turn is not None:
                allowed |= {"rad": ticks_per_turn / TURN, "deg": ticks_per_turn / 360}
            signals[key] = self._read_signal(group.block(key), allowed, table, quantity, holds)
        return signals

    def _read_signal(self, block: Block, allowed: dict[str, float], table: str, quantity: str, holds: bool) -> Signal:
        """Read one signal; `allowed` are its units with their factors."""
        table = self._table(block, table)
        if quantity == "angle" and block.value("quaternion") is not None:
            columns, unit = self._read_quaternion(block.block("quaternion"), table), "rad"
            block.choice("unit", (unit,), unit)
        else:
            columns = (block.text(self._column_key),)
            self._check_column(block, self._column_key, table, *columns)
            unit = block.choice("unit", allowed)
        sign = block.number("sign", 1.0)
        if sign not in (1.0, -1.0):
            raise block.error("sign", f"must be 1 or -1, not {sign:g}")
        factor = sign * allowed[unit]
        scale, offset = block.number("scale", 1.0), block.number("offset", 0.0)
        holds = block.switch("holds") or holds
        block.finish()
        return Signal(table, columns, unit, gain=factor * scale, shift=factor * offset, holds=holds)

    def _read_quaternion(self, block: Block, table: str) -> tuple[str, ...]:
        """Return the columns of w and z, or of w, x, y and z where x or y is given."""
        members = [one for one in QUATERNION if one in "wz" or any(block.value(other) is not None for other in "xy")]
        columns = tuple(block.text(member) for member in members)
        for member, column in zip(members, columns, strict=True):
            self._check_column(block, member, table, column)
        block.finish()
        return columns

    def _check_column(self, block: Block, key: str, table: str, column: str) -> None:
        if self._channels:
            present: Iterable[str] = column_names(self._channels[table].layout)
        elif self._topics:
            try:
                parse_path(column)
            except PathError as error:
                raise block.error(key, str(error)) from error
            return
        else:
            present = self._files[table].header or (column,)
        if column not in present:
            raise block.error(key, f"is {quoted(column)}; {table} has {', '.join(present)}")

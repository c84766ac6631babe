"""Read a bag (ROS 1, ROS 2 or MCAP) into tables: of each mapped topic the times and the mapped fields."""

from array import array
from collections.abc import Callable
from collections.abc import Mapping as Dictionary
from contextlib import suppress
from pathlib import Path

import numpy as np

from cmr.bus.messages import MICROSECONDS
from cmr.cli.progress import BYTES, Progress
from cmr.distribution import how_to_install
from cmr.recordings.log_clock import LATEST_UTIME
from cmr_tools.importing.mapping_types import Mapping
from cmr_tools.importing.mapping_types import Topic as MappedTopic
from cmr_tools.importing.ros_fields import AbsentError, PathError, Types, getter, parse_path
from cmr_tools.importing.ros_files import files_of, opened
from cmr_tools.importing.ros_messages import DecodeError, TypeUnknownError, decoder
from cmr_tools.importing.ros_records import BagError, BagReader, Message, Topic
from cmr_tools.importing.sources import Source, SourceError, Table, in_time_order, require_moving_clocks

MICROSECOND = 1000  # ns
CLOCKS_APART = 1.0  # s; less may be how long a localisation takes, and the estimation finds it
MESSAGES_BETWEEN_SHOWINGS = 1000
MOST_TOPICS = 40  # listed in an error

NO_TIME = "message without a time that is possible"
NO_NUMBER = "message with a field that is no number"
NOT_INTACT = "message that does not decode"


def read_bag(mapping: Mapping, path: Path) -> Source:
    """Read the bag at `path`, a file or the folder of one, as the mapping specifies.

    Raises SourceError naming a topic or field that is missing and the ones present, or a package to install; OSError if
    the bag cannot be read.
    """
    source = Source({})
    rows = {
        name: _Rows(name, topic, mapping.columns(name), _counters(mapping, name))
        for name, topic in mapping.topics.items()
    }
    present: dict[str, set[str]] = {}
    try:
        files = files_of(path)
        with Progress(sum(file.stat().st_size for file in files), BYTES) as progress:
            for file in files:
                with opened(file, frozenset(rows)) as reader:
                    _take_all(reader, rows, progress)
                for name, kinds in reader.topics.items():
                    present.setdefault(name, set()).update(kinds)
                if sentence := reader.sentence():
                    source.notes.append(sentence)
    except BagError as error:
        raise SourceError(str(error)) from error
    except ModuleNotFoundError as error:
        raise SourceError(
            f"{error.name} is missing, which bags need. To install it: {how_to_install('ros')}"
        ) from error
    try:
        _check_present(path, rows, present)
        source.tables = _tables(path, rows, source)
    except SourceError as error:
        raise SourceError(" ".join((f"{error}.", *source.notes)) if source.notes else str(error)) from error
    _compare_clocks(source)
    return source


def _counters(mapping: Mapping, topic: str) -> frozenset[str]:
    """Return the columns of a topic that count ticks."""
    signals = {} if mapping.feedback is None else mapping.feedback.signals
    return frozenset(one.columns[0] for key, one in signals.items() if key.startswith("ticks_") and one.table == topic)


def _take_all(reader: BagReader, rows: Dictionary[str, "_Rows"], progress: Progress) -> None:
    before = 0
    for count, message in enumerate(reader):
        if count % MESSAGES_BETWEEN_SHOWINGS == 0:
            progress.advance(reader.position - before)
            before = reader.position
        rows[message.topic.name].take(message)
    progress.advance(reader.size - before)


def _check_present(path: Path, rows: Dictionary[str, "_Rows"], present: dict[str, set[str]]) -> None:
    listed = [f"{name} ({', '.join(sorted(kinds))})" for name, kinds in sorted(present.items())]
    more = f" and {len(listed) - MOST_TOPICS} more" if len(listed) > MOST_TOPICS else ""
    for name in rows:
        if name not in present:
            raise SourceError(
                f"{path}: {name}: no such topic; topics present: {', '.join(listed[:MOST_TOPICS]) or 'none'}{more}"
            )


def _tables(path: Path, rows: Dictionary[str, "_Rows"], source: Source) -> dict[str, Table]:
    """Return the tables; all topics of a clock with a wrong offset are shifted equally, to keep them synchronised."""
    for name, one in rows.items():
        for reason, count in one.skipped.items():
            source.skipped[name, reason] += count
        if not one.stamps:
            raise SourceError(f"{path}: {name}: {one.why_empty()}")
    # A message cannot arrive before it was stamped, so the smallest observed delay is the tightest bound on the shift.
    shifted = [one for one in rows.values() if one.clock == "shifted_header"]
    shift = min((one.smallest_delay() for one in shifted), default=0)
    tables = {name: one.table(shift if one in shifted else 0) for name, one in rows.items()}
    require_moving_clocks(path, tables, "for a broken header, map time: received")
    return tables


def _compare_clocks(source: Source) -> None:
    """Note where two topics were stamped by clocks that differ.

    Of a topic, no message arrives sooner after its stamp than the quickest: by how much this is more for one topic than
    for another, its clock is behind. Only a topic of much delay looks the same, which takes less than CLOCKS_APART.
    """
    tables = source.tables.values()
    begin, end = max(t.received_utime.min() for t in tables), min(t.received_utime.max() for t in tables)
    least = {name: _least_delay(table, begin, end) for name, table in source.tables.items()}
    behind, ahead = max(least, key=least.__getitem__), min(least, key=least.__getitem__)
    apart = (least[behind] - least[ahead]) / MICROSECONDS
    if apart > CLOCKS_APART:
        source.notes.append(
            f"{ahead} is stamped by a clock that is {apart:.1f} s ahead of that of {behind}, as their arrival at the "
            "recorder shows. Map time: shifted_header for the one that was set wrong, or time: received for both."
        )


def _least_delay(table: Table, begin: int, end: int) -> int:
    """Return by how much the quickest message arrived after its stamp [us], of those that arrived from begin to end.

    In a simulation that runs slower than the clock, delays grow: they are compared at the same time, or over all the
    time where topics have none in common.
    """
    together = (table.received_utime >= begin) & (table.received_utime <= end)
    delays = table.received_utime - table.utime
    return int((delays[together] if together.any() else delays).min())


class _Rows:
    """Collects one topic's rows; `skipped` counts omitted messages, by reason."""

    def __init__(self, name: str, mapped: MappedTopic, columns: tuple[str, ...], counters: frozenset[str]) -> None:
        self.clock = mapped.clock
        self.skipped: dict[str, int] = {}
        self.stamps = array("q")  # us
        self._received = array("q")  # us
        self._name = name
        self._definition = mapped.definition
        self._counters = counters
        self._getters = {column: getter(column) for column in columns}
        self._values = {column: array("d") for column in columns}
        self._absent = ""
        self._takers: dict[Topic, tuple[Callable[[bytes], object], Callable[[Message, object], int]]] = {}
        self._is_typed = False

    def take(self, message: Message) -> None:
        """Add one message. Raises SourceError if the topic's type does not fit the mapping."""
        decode, stamp_of = self._takers.get(message.topic) or self._learn(message.topic)
        try:
            content = decode(message.data)
            stamp = stamp_of(message, content)
            received = message.received // MICROSECOND
            values = [get(content) for get in self._getters.values()]
        except DecodeError:
            self._skip(NOT_INTACT)
            return
        except AbsentError as error:
            self._absent = str(error)
            self._skip(f"message with {self._absent.partition(';')[0]}")
            return
        if not 0 < stamp < LATEST_UTIME or not 0 <= received < LATEST_UTIME:
            self._skip(NO_TIME)
            return
        self._append(stamp, received, values)

    def _append(self, stamp: int, received: int, values: list[float]) -> None:
        taken = []
        try:
            for column, value in zip(self._values.values(), values, strict=True):
                column.append(value)
                taken.append(column)
        except (TypeError, ValueError, OverflowError):
            for column in taken:
                column.pop()
            self._skip(NO_NUMBER)
            return
        self.stamps.append(stamp)
        self._received.append(received)

    def _skip(self, reason: str) -> None:
        self.skipped[reason] = self.skipped.get(reason, 0) + 1

    def _learn(self, topic: Topic) -> tuple[Callable[[bytes], object], Callable[[Message, object], int]]:
        """Return the decoder and the time function of a topic's messages, after a check of the mapped paths."""
        what = f"{self._name} ({topic.message_type or 'of no known type'})"
        try:
            decode, types = decoder(topic, self._definition)
            if types is not None:
                self._check_types({column: types.code(column) for column in self._values}, what)
            stamp = self._stamp(types, what)
        except (PathError, TypeUnknownError) as error:
            raise SourceError(f"{what} {error}") from error
        self._takers[topic] = decode, stamp
        return self._takers[topic]

    def _check_types(self, codes: dict[str, str], what: str) -> None:
        """Keep each number in its own type, since counters wrap around in theirs."""
        if not self._is_typed and not self.stamps:
            self._values = {column: array(code) for column, code in codes.items()}
            self._is_typed = True
        elif codes != {column: values.typecode for column, values in self._values.items()}:
            raise SourceError(f"{what} has other types of numbers than the messages on that topic before")

    def _stamp(self, types: Types | None, what: str) -> Callable[[Message, object], int]:
        """Return a function that reads a message's time [us] by the chosen clock."""
        if self.clock == "received":
            return lambda message, _: message.received // MICROSECOND
        if self.clock == "published":
            return _published
        candidates = ["header", *(f"{parse_path(column)[0]}.header" for column in self._values)]
        for candidate in candidates:
            if types is None or _has_stamp(types, candidate):
                return _header_clock(candidate)
        raise SourceError(f"{what} has no header; map time: received")

    def why_empty(self) -> str:
        """Return why no message was used."""
        if self._absent:
            return f"no message has all mapped fields: {self._absent}"
        counts = ", ".join(f"{count} x {reason}" for reason, count in self.skipped.items())
        hint = "; for headers without a stamp, map time: received" if NO_TIME in self.skipped else ""
        return f"no usable message: {counts or 'there is none'}{hint}"

    def smallest_delay(self) -> int:
        """Return the smallest time between stamp and arrival [us]."""
        return int((np.frombuffer(self._received, np.int64) - np.frombuffer(self.stamps, np.int64)).min())

    def table(self, shift: int) -> Table:
        """Return the rows in the order of time, their stamps shifted by `shift` [us]."""
        columns = {}
        for column, values in self._values.items():
            # Counters wrap around: as signed numbers their differences are right, whichever way they turn.
            code = values.typecode.lower() if column in self._counters else values.typecode
            columns[column] = np.frombuffer(values, code)
        utime = np.frombuffer(self.stamps, np.int64) + shift
        return in_time_order(utime, np.frombuffer(self._received, np.int64), np.zeros(len(utime), np.int64), columns)


def _has_stamp(types: Types, header: str) -> bool:
    try:
        return bool(types.code(f"{header}.stamp.sec"))
    except PathError:
        return False


def _published(message: Message, _content: object) -> int:
    if message.published is None:
        raise SourceError(f"{message.topic.name}: only MCAP files record times of publication; map time: header")
    return message.published // MICROSECOND


def _header_clock(header: str) -> Callable[[Message, object], int]:
    stamp_of = getter(f"{header}.stamp")

    def stamp(_message: Message, content: object) -> int:
        time = stamp_of(content)
        for name in ("nanosec", "nsec"):  # of ROS; of Foxglove's JSON
            with suppress(AttributeError, TypeError, ValueError, OverflowError):
                return (int(time.sec) * 1_000_000_000 + int(getattr(time, name))) // MICROSECOND
        raise AbsentError(f"no {header}.stamp of sec and nanosec; for messages without a header, map time: received")

    return stamp

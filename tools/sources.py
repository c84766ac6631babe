"""Read a foreign recording, an LCM log or a CSV file, into tables: columns over time as NumPy arrays."""

import csv
import gzip
import io
import zlib
from array import array
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cmr.recordings.events import Event, EventReader
from cmr.tools.events import Progress, reading
from cmr.tools.layout import decode, message_bytes
from cmr.tools.mapping import CSV_TABLE, Mapping, Rows

MICROSECONDS = 1e6
LATEST_UTIME = 7_258_118_400_000_000  # us; the year 2200: a later time is a damaged one
LONGEST_SECONDS = 1e9  # 31 years: a recording is shorter
LINES_BETWEEN_REDRAWINGS = 1000


class SourceError(Exception):
    """The recording cannot be read with this mapping; the text says what is wrong and what there is instead."""


@dataclass(frozen=True)
class Table:
    """Rows in the order of time.

    `utime` and `received_utime` [us], shape (n,), int64, not decreasing; `segment` numbers the pieces of a
    recording that is no continuous one; `columns` are of shape (n,), NaN where a CSV cell holds no number.
    """

    utime: NDArray[np.int64]
    received_utime: NDArray[np.int64]
    segment: NDArray[np.int64]
    columns: dict[str, NDArray[Any]]


@dataclass
class Source:
    """What was read: tables by name, what was skipped, by (place, reason), and sentences about damage."""

    tables: dict[str, Table]
    skipped: Counter[tuple[str, str]] = field(default_factory=Counter)
    notes: list[str] = field(default_factory=list)


def read(mapping: Mapping, path: Path) -> Source:
    """Read the recording at `path` as the mapping says.

    Raises SourceError naming a channel or column that is missing and those that are there, or a clock that stands
    still; OSError when the file cannot be read.
    """
    with path.open("rb"):
        pass  # LCM's own error does not say why a file cannot be opened
    source = _read_csv(mapping, mapping.rows, path) if mapping.rows is not None else _read_log(mapping, path)
    for name, table in source.tables.items():
        if len(table.utime) > 1 and table.utime[0] == table.utime[-1]:
            raise SourceError(f"{path}: the time of {name} stands still; for a broken utime, map time: event_time")
    return source


def _read_log(mapping: Mapping, path: Path) -> Source:
    source = Source({})
    gathered: dict[str, _Messages] = {}
    channels_present: set[str] = set()
    log = EventReader(path)
    with Progress(log.size) as progress:
        for event in reading(log, progress):
            channels_present.add(event.channel)
            channel = mapping.channels.get(event.channel)
            if channel is None:
                continue
            if len(event.data) == message_bytes(channel.layout):
                gathered.setdefault(event.channel, _Messages()).take(event)
            else:
                source.skipped[event.channel, "message of another length than the layout's"] += 1
    if log.damaged_bytes:
        source.notes.append(
            f"{path} is truncated or damaged: {log.damaged_bytes} bytes of it are no intact events; the rest is used."
        )
    for name in mapping.channels:
        if name not in gathered:
            why = "no message of the layout's length" if name in channels_present else "no such channel"
            raise SourceError(
                f"{path}: {name}: {why}; channels present: {', '.join(sorted(channels_present)) or 'none'}"
            )
    source.tables = _log_tables(mapping, gathered, source.skipped)
    return source


class _Messages:
    """The messages of one channel, one after the other without gaps, and when each was logged [us]."""

    def __init__(self) -> None:
        self.arrivals = array("q")
        self.data = bytearray()

    def take(self, event: Event) -> None:
        self.arrivals.append(event.utime)
        self.data += event.data


def _log_tables(
    mapping: Mapping, gathered: dict[str, _Messages], skipped: Counter[tuple[str, str]]
) -> dict[str, Table]:
    """Decode the messages; all channels of a clock that was set wrong are shifted alike, to keep them in step."""
    channels = mapping.channels
    arrivals = {name: np.frombuffer(gathered[name].arrivals, np.int64) for name in channels}
    # What has been decoded is let go.
    decoded = {
        name: decode(channel.layout, gathered.pop(name).data, {"utime", *mapping.columns(name)})
        for name, channel in channels.items()
    }
    # A message cannot arrive before it was stamped, so the smallest delay seen is the closest bound on the shift.
    delays = [
        int((arrivals[name] - decoded[name]["utime"]).min())
        for name, channel in channels.items()
        if channel.clock == "shifted_utime"
    ]
    tables = {}
    for name, channel in channels.items():
        if channel.clock == "event_time":
            utime = arrivals[name]
        else:
            utime = decoded[name]["utime"] + (min(delays) if channel.clock == "shifted_utime" else 0)
        possible = (utime >= 0) & (utime < LATEST_UTIME)
        if not possible.all():
            skipped[name, "message of an impossible time"] += int((~possible).sum())
        columns = {column: values[possible] for column, values in decoded[name].items()}
        segment = np.zeros(int(possible.sum()), np.int64)
        tables[name] = in_time_order(utime[possible], arrivals[name][possible], segment, columns)
    return tables


def in_time_order(
    utime: NDArray[np.int64],
    received_utime: NDArray[np.int64],
    segment: NDArray[np.int64],
    columns: dict[str, NDArray[Any]],
) -> Table:
    """Return the rows as a table, in the order of `utime`; rows of one time stay in their order."""
    order = np.argsort(utime, kind="stable")
    return Table(
        utime[order], received_utime[order], segment[order], {name: values[order] for name, values in columns.items()}
    )


def _names(header: list[str]) -> str:
    """Return the names of columns for a person to read, whatever the file holds."""
    if not all(name.isprintable() and "\ufffd" not in name for name in header):
        return "none that can be read; is it a CSV file?"
    return ", ".join(header) or "none"


def _read_csv(mapping: Mapping, rows: Rows, path: Path) -> Source:
    source = Source({})
    with Progress(path.stat().st_size) as progress:
        lines = _csv_lines(path, source, progress)
        header = [name.strip() for name in next(lines, [])]
        segment_columns = () if rows.segment_column is None else (rows.segment_column,)
        for name in (rows.time_column, *segment_columns, *mapping.columns(CSV_TABLE)):
            if name not in header:
                raise SourceError(f"{path}: no column {name!r}; columns present: {_names(header)}")
        cells = _Cells(header, rows, mapping.columns(CSV_TABLE))
        for line in lines:
            if len(line) == len(header):
                cells.take(line)
            elif line:
                source.skipped[CSV_TABLE, "row with another number of cells than the header"] += 1
    seconds, segment = _finite(cells.seconds), np.frombuffer(cells.segments, np.int64)
    timed = np.abs(seconds) < LONGEST_SECONDS
    if not timed.all():
        source.skipped[CSV_TABLE, f"row without a time in {rows.time_column}"] += int((~timed).sum())
    columns = {name: _finite(values)[timed] for name, values in cells.columns.items()}
    utime = _utime(rows, seconds[timed], segment[timed])
    source.tables[CSV_TABLE] = in_time_order(utime, utime, segment[timed], columns)
    return source


class _Cells:
    """What is needed of the rows of a CSV file, as numbers; `segments` numbers the runs of equal labels from 0."""

    def __init__(self, header: list[str], rows: Rows, names: tuple[str, ...]) -> None:
        place = {name: index for index, name in enumerate(header)}
        self.seconds = array("d")
        self.segments = array("q")
        self.columns = {name: array("d") for name in names}
        self._taken = [(place[rows.time_column], self.seconds)]
        self._taken += [(place[name], values) for name, values in self.columns.items()]
        self._label_at = None if rows.segment_column is None else place[rows.segment_column]
        self._label = ""

    def take(self, line: list[str]) -> None:
        """Take a row, NaN where a cell is no number."""
        label = "" if self._label_at is None else line[self._label_at]
        number = self.segments[-1] if self.segments else 0
        self.segments.append(number + (bool(self.segments) and label != self._label))
        self._label = label
        for index, values in self._taken:
            values.append(_number(line[index]))


def _csv_lines(path: Path, source: Source, progress: Progress) -> Iterator[list[str]]:
    """Yield the lines' cells; of a truncated file those that are there."""
    before = 0
    with path.open("rb") as file:
        content: Any = gzip.GzipFile(fileobj=file) if path.suffix == ".gz" else file
        text = io.TextIOWrapper(content, encoding="utf-8-sig", errors="replace", newline="")
        try:
            for count, line in enumerate(csv.reader(text)):
                if count % LINES_BETWEEN_REDRAWINGS == 0:
                    progress.show(file.tell() - before)
                    before = file.tell()
                yield line
        except (EOFError, zlib.error, gzip.BadGzipFile, csv.Error) as error:
            source.notes.append(f"{path} is truncated or damaged ({error}); the rows before that are used.")


def _finite(values: "array[float]") -> NDArray[np.float64]:
    """Return the numbers as an array; NaN where one is not finite."""
    numbers = np.frombuffer(values, np.float64)
    return np.where(np.isfinite(numbers), numbers, np.nan)


def _number(cell: str) -> float:
    try:
        return float(cell)
    except ValueError:
        return np.nan


def _utime(rows: Rows, seconds: NDArray[np.float64], segment: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return the rows' times [us]: counted from `start`, or segment after segment with the gap between them."""
    clock = seconds.copy()
    if rows.segment_column is not None:
        begin = 0.0
        for number in np.unique(segment):
            here = segment == number
            own = seconds[here] - seconds[here].min()
            clock[here] = begin + own
            begin += float(own.max()) + rows.gap
    start = round(rows.start.timestamp() * MICROSECONDS)
    return start + np.rint(clock * MICROSECONDS).astype(np.int64)

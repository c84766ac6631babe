"""Read a foreign recording, an LCM log or a CSV file, into tables: columns over time as NumPy arrays."""

import csv
import gzip
import zlib
from collections import Counter, defaultdict
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cmr.recordings.events import EventReader
from cmr.tools.layout import decode, message_bytes
from cmr.tools.mapping import CSV_TABLE, Channel, Mapping, Rows

MICROSECONDS = 1e6
LATEST_UTIME = 7_258_118_400_000_000  # us; the year 2200: a later time is a damaged one
LONGEST_SECONDS = 1e9  # 31 years: a recording is shorter


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
    events: dict[str, list[tuple[int, bytes]]] = defaultdict(list)
    channels_present: set[str] = set()
    log = EventReader(path)
    for event in log:
        channels_present.add(event.channel)
        channel = mapping.channels.get(event.channel)
        if channel is None:
            continue
        if len(event.data) == message_bytes(channel.layout):
            events[event.channel].append((event.utime, event.data))
        else:
            source.skipped[event.channel, "message of another length than the layout's"] += 1
    if log.damaged_bytes:
        source.notes.append(
            f"{path} is truncated or damaged: {log.damaged_bytes} bytes of it are no intact events; the rest is used."
        )
    for name in mapping.channels:
        if name not in events:
            why = "no message of the layout's length" if name in channels_present else "no such channel"
            raise SourceError(
                f"{path}: {name}: {why}; channels present: {', '.join(sorted(channels_present)) or 'none'}"
            )
    source.tables = _log_tables(mapping.channels, events, source.skipped)
    return source


def _log_tables(
    channels: dict[str, Channel], events: dict[str, list[tuple[int, bytes]]], skipped: Counter[tuple[str, str]]
) -> dict[str, Table]:
    """Decode the events; all channels of a clock that was set wrong are shifted alike, to keep them in step."""
    decoded = {name: decode(channel.layout, [data for _, data in events[name]]) for name, channel in channels.items()}
    arrivals = {name: np.array([timestamp for timestamp, _ in events[name]], np.int64) for name in channels}
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


def _read_csv(mapping: Mapping, rows: Rows, path: Path) -> Source:
    source = Source({})
    lines = _csv_lines(path, source)
    header = [name.strip() for name in next(lines, [])]
    segment_columns = () if rows.segment_column is None else (rows.segment_column,)
    for name in (rows.time_column, *segment_columns, *mapping.columns(CSV_TABLE)):
        if name not in header:
            raise SourceError(f"{path}: no column {name!r}; columns present: {', '.join(header) or 'none'}")
    cells = []
    for line in lines:
        if len(line) == len(header):
            cells.append(line)
        elif line:
            source.skipped[CSV_TABLE, "row with another number of cells than the header"] += 1
    by_column = dict(zip(header, zip(*cells, strict=True), strict=True)) if cells else dict.fromkeys(header, ())
    columns = {name: _numbers(by_column[name]) for name in mapping.columns(CSV_TABLE)}
    seconds = _numbers(by_column[rows.time_column])
    labels = by_column[rows.segment_column] if rows.segment_column is not None else ("",) * len(seconds)
    timed = np.abs(seconds) < LONGEST_SECONDS
    if not timed.all():
        source.skipped[CSV_TABLE, f"row without a time in {rows.time_column}"] += int((~timed).sum())
    segment = _segment_numbers(np.array(labels, str))[timed]
    utime = _utime(rows, seconds[timed], segment)
    source.tables[CSV_TABLE] = in_time_order(
        utime, utime, segment, {name: values[timed] for name, values in columns.items()}
    )
    return source


def _csv_lines(path: Path, source: Source) -> Iterator[list[str]]:
    """Yield the lines' cells; of a truncated file those that are there."""
    opener: Any = gzip.open if path.suffix == ".gz" else open
    with opener(path, "rt", encoding="utf-8-sig", errors="replace", newline="") as stream:
        try:
            yield from csv.reader(stream)
        except (EOFError, zlib.error, gzip.BadGzipFile, csv.Error) as error:
            source.notes.append(f"{path} is truncated or damaged ({error}); the rows before that are used.")


def _numbers(cells: tuple[str, ...]) -> NDArray[np.float64]:
    """Return the cells as numbers; NaN where a cell is empty, no number, or not finite."""
    values = np.array([_number(cell) for cell in cells], np.float64)
    return np.where(np.isfinite(values), values, np.nan)


def _number(cell: str) -> float:
    try:
        return float(cell)
    except ValueError:
        return np.nan


def _segment_numbers(labels: NDArray[np.str_]) -> NDArray[np.int64]:
    """Number the runs of equal labels from 0."""
    return np.concatenate([[0], np.cumsum(labels[1:] != labels[:-1])]).astype(np.int64)[: len(labels)]


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

"""Read a recording of one or several CSV files into tables."""

import csv
import gzip
import io
import zlib
from array import array
from collections.abc import Iterator, Sequence
from collections.abc import Mapping as Dictionary
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import chain, islice
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cmr.bus.messages import MICROSECONDS
from cmr.cli.progress import BYTES, Progress
from cmr.files import open_regular
from cmr.recordings.log_clock import LATEST_UTIME
from cmr_tools.importing.mapping_types import File, Mapping, Pieces
from cmr_tools.importing.sources import (
    Piece,
    Source,
    SourceError,
    Table,
    in_time_order,
    require_moving_clocks,
)
from cmr_tools.importing.unpacking import most_unpacked, too_much

LINES_BETWEEN_SHOWINGS = 1000
SEPARATORS = ",;\t"  # the first of them found in a file's first line; else spaces
COMMENT = "#"  # a line that begins with it is not a row; it may name the columns
LEAST_GAP = 1.0  # s; estimates continue over shorter gaps
CLOSE = "pieces {gap:g} s apart are taken for one another's continuation; let the segment's gap be more than 1"
PACKED_SUFFIX = ".gz"
LOOK_BYTES = 1 << 20
LONGEST_LINE = 1_000_000  # characters; text without line ends is not a table
MOST_COLUMNS = 40  # listed in an error

Label = tuple[str, int]  # of a piece: the cell that names it, and how many pieces before it had the same


@dataclass(frozen=True)
class _Columns:
    """A file's rows with a valid time: `seconds` since the first file's start, and the piece of each."""

    seconds: NDArray[np.float64]
    piece: NDArray[np.int64]
    labels: Sequence[Label]
    columns: dict[str, NDArray[np.float64]]


def read_csv(mapping: Mapping, paths: Dictionary[str, Path]) -> Source:
    """Read the files, by their names in the mapping, as it specifies.

    Raises SourceError naming a column that is missing and those that are there, or a clock that stands still; OSError
    when a file cannot be read.
    """
    source = Source({})
    files = {name: _read_file(mapping, name, path, source) for name, path in paths.items()}
    start = round(mapping.files[next(iter(files))].start.timestamp() * MICROSECONDS)
    if mapping.pieces is None:
        clocks = {name: file.seconds for name, file in files.items()}
    else:
        files = _with_common_labels(files)
        clocks, source.pieces = _one_after_the_other(files, mapping.pieces, start)
        if mapping.pieces.gap <= LEAST_GAP:
            source.notes.append(CLOSE.format(gap=mapping.pieces.gap))
    for name, file in files.items():
        source.tables[name] = _table(name, file, start, clocks[name], source)
        require_moving_clocks(paths[name], {name: source.tables[name]}, "map another column as time")
    return source


def _table(name: str, file: _Columns, start: int, clock: NDArray[np.float64], source: Source) -> Table:
    utime = start + np.rint(clock * MICROSECONDS).astype(np.int64)
    possible = (utime >= 0) & (utime < LATEST_UTIME)
    if not possible.all():
        source.skipped[name, "row of an impossible time"] += int((~possible).sum())
    columns = {column: values[possible] for column, values in file.columns.items()}
    return in_time_order(utime[possible], utime[possible], file.piece[possible], columns)


def _read_file(mapping: Mapping, name: str, path: Path, source: Source) -> _Columns:
    file = mapping.files[name]
    if path.suffix == PACKED_SUFFIX:
        _check_unpacked(path)
    first = next(iter(mapping.files.values())).start
    label = () if mapping.pieces is None else (mapping.pieces.column,)
    wanted = tuple(dict.fromkeys((file.time_column, *label, *mapping.columns(name))))
    with Progress(path.stat().st_size, BYTES) as progress:
        text = _Text(path, file, wanted, _lines(path, source, progress))
        cells = _Cells(text.names, label, wanted)
        try:
            for line in text.rows:
                if len(line) == text.width:
                    cells.take(line)
                elif line:
                    source.skipped[name, f"row with another number of cells than the {text.measure}"] += 1
        except csv.Error as error:
            source.notes.append(_damaged(path, error))
    seconds = _finite(cells.numbers[file.time_column]) * file.time_unit + (file.start - first).total_seconds()
    timed = np.abs(seconds) < LATEST_UTIME / MICROSECONDS
    if not timed.all():
        source.skipped[name, f"row without a time in {file.time_column}"] += int((~timed).sum())
    columns = {column: _finite(cells.numbers[column])[timed] for column in mapping.columns(name)}
    return _Columns(seconds[timed], np.frombuffer(cells.piece, np.int64)[timed], cells.labels, columns)


class _Text:
    """A CSV file's rows: `names` of its columns, its `width` in cells, which is that of `measure`, and the `rows`.

    The column names are in the first line, in a comment before it, or in `file.header`. Raises SourceError if a
    required column has no name.
    """

    def __init__(self, path: Path, file: File, wanted: Sequence[str], lines: Iterator[str]) -> None:
        lines = islice(lines, file.skipped_lines, None)
        first, comment = "", [""]
        for first in lines:
            if not first.startswith(COMMENT):
                break
            comment = _split(first.lstrip(COMMENT), _separator(first))
            if set(wanted) <= set(comment):
                break
        separator = _separator(first)
        cells = _split(first, separator)
        named_by_comment = first.startswith(COMMENT) and set(wanted) <= set(comment)
        if named_by_comment or set(wanted) <= set(cells):
            self.names, self.measure = (comment if named_by_comment else cells), "header"
            begin: list[str] = []
        elif file.header:
            self.names, self.measure = list(file.header), "first row"
            begin = [first]
            if len(cells) < len(self.names):
                raise SourceError(f"{path}: {_too_few(cells, self.names)}")
        else:
            raise SourceError(f"{path}: {_why_not_named(cells, wanted)}")
        if ambiguous := next((name for name in wanted if self.names.count(name) > 1), None):
            raise SourceError(
                f"{path}: {self.names.count(ambiguous)} columns are called {ambiguous!r}: give them names in the "
                "mapping, with columns, and pass over the file's own by skip_lines"
            )
        self.width = len(cells) if begin else len(self.names)
        self.rows = csv.reader(
            _ends_cut(chain(begin, lines), separator), delimiter=separator, skipinitialspace=separator == " "
        )


def _separator(line: str) -> str:
    return next((one for one in SEPARATORS if one in line), " ")


def _split(line: str, separator: str) -> list[str]:
    row = next(csv.reader([line.strip()], delimiter=separator, skipinitialspace=True), [])
    return [cell.strip() for cell in row]


def _ends_cut(lines: Iterator[str], separator: str) -> Iterator[str]:
    """Return lines without the spaces at their ends, which would be taken for separators."""
    return (line.rstrip() for line in lines) if separator == " " else lines


def _too_few(cells: Sequence[str], names: Sequence[str]) -> str:
    return f"the mapping names {len(names)} columns ({', '.join(names)}), but the first row has {len(cells)} cells"


def _why_not_named(cells: Sequence[str], wanted: Sequence[str]) -> str:
    """Return which column is missing in a file's first line, and which are there instead."""
    missing = next(name for name in wanted if name not in cells)
    if cells and not np.isnan([_number(cell) for cell in cells]).all():
        return (
            f"no column {missing!r}: the first line has numbers, no names. Name the {len(cells)} columns in the "
            f"mapping, in their order: columns: [{missing}, ...]"
        )
    if not all(name.isprintable() and "\ufffd" not in name for name in cells):
        present = "none that can be read; is it a CSV file?"
    else:
        more = f" and {len(cells) - MOST_COLUMNS} more" if len(cells) > MOST_COLUMNS else ""
        present = (", ".join(cells[:MOST_COLUMNS]) or "none") + more
    return f"no column {missing!r}; columns present: {present}"


class _Cells:
    """The required cells of a CSV file, as numbers; `labels` names the pieces that `piece` counts from 0."""

    def __init__(self, names: Sequence[str], label: tuple[str, ...], wanted: Sequence[str]) -> None:
        self.numbers = {name: array("d") for name in wanted}
        self.piece = array("q")
        self.labels: list[Label] = [] if label else [("", 0)]
        self._taken = [(names.index(name), values) for name, values in self.numbers.items()]
        self._label_at = names.index(label[0]) if label else None
        self._last: str | None = None
        self._before: dict[str, int] = {}

    def take(self, line: list[str]) -> None:
        """Add a row, NaN where a cell is not a number."""
        if self._label_at is not None and line[self._label_at] != self._last:
            self._last = line[self._label_at]
            self.labels.append((self._last.strip(), self._before.get(self._last, 0)))
            self._before[self._last] = self._before.get(self._last, 0) + 1
        self.piece.append(len(self.labels) - 1)
        for index, values in self._taken:
            values.append(_number(line[index]))


def _lines(path: Path, source: Source, progress: Progress) -> Iterator[str]:
    """Yield the lines of a file; those that are left if it is truncated."""
    before = 0
    with open_regular(path) as file:
        content = gzip.GzipFile(fileobj=file) if path.suffix == PACKED_SUFFIX else file
        text = io.TextIOWrapper(content, encoding="utf-8-sig", errors="replace", newline="")
        try:
            for count, line in enumerate(iter(lambda: text.readline(LONGEST_LINE), "")):
                if count % LINES_BETWEEN_SHOWINGS == 0:
                    progress.advance(file.tell() - before)
                    before = file.tell()
                if len(line) == LONGEST_LINE:
                    source.notes.append(_damaged(path, f"line {count + 1} has {LONGEST_LINE} characters or more"))
                    return
                yield line
        except (EOFError, zlib.error, gzip.BadGzipFile) as error:
            source.notes.append(_damaged(path, error))


def _check_unpacked(path: Path) -> None:
    """Raise SourceError for a packed file that holds too much; the check takes a twentieth of the time of reading its
    rows.
    """
    packed = path.stat().st_size
    with open_regular(path) as file, suppress(EOFError, zlib.error, gzip.BadGzipFile):
        content = gzip.GzipFile(fileobj=file)
        while content.read(LOOK_BYTES):
            if content.tell() > most_unpacked(packed):
                raise SourceError(too_much(path, packed, "gunzip"))


def _damaged(path: Path, error: object) -> str:
    return f"{path} is truncated or damaged ({error}); the rows before that are used."


def _finite(values: "array[float]") -> NDArray[np.float64]:
    """Return the numbers as an array; NaN where they are not finite."""
    numbers = np.frombuffer(values, np.float64)
    return np.where(np.isfinite(numbers), numbers, np.nan)


def _number(cell: str) -> float:
    try:
        return float(cell)
    except ValueError:
        return np.nan


def _with_common_labels(files: Dictionary[str, _Columns]) -> dict[str, _Columns]:
    """Return the files with common numbers for the pieces of all, in order of appearance."""
    labels = list(dict.fromkeys(label for file in files.values() for label in file.labels))
    number = {label: index for index, label in enumerate(labels)}
    common = {}
    for name, file in files.items():
        numbers = np.array([number[label] for label in file.labels], np.int64)
        common[name] = replace(file, piece=numbers[file.piece], labels=labels)
    return common


def _one_after_the_other(
    files: Dictionary[str, _Columns], pieces: Pieces, start: int
) -> tuple[dict[str, NDArray[np.float64]], tuple[Piece, ...]]:
    """Return for each file its rows' time since `start` [us] in seconds, piece after piece, and the pieces."""
    labels = next(iter(files.values())).labels
    first, last = np.full(len(labels), np.inf), np.full(len(labels), -np.inf)
    for file in files.values():
        np.minimum.at(first, file.piece, file.seconds)
        np.maximum.at(last, file.piece, file.seconds)
    present = last >= first
    lengths = np.where(present, last - first + pieces.gap, 0.0)
    begin = np.concatenate([[0.0], np.cumsum(lengths)[:-1]]) if len(labels) else lengths
    statements = tuple(
        Piece(start + round(begin[index] * MICROSECONDS), labels[index][0], float(first[index]))
        for index in np.flatnonzero(present).tolist()
    )
    return {name: begin[file.piece] + file.seconds - first[file.piece] for name, file in files.items()}, statements

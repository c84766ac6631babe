"""Messages of a log as tables, a file for each channel: CSV or Parquet, with units in the names of the columns.

Messages are gathered as bytes and decoded many at a time.
"""

import csv
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from types import TracebackType
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from cmr.bus.fields import BYTES, INDEX, Field, fields_of, text_of_bytes
from cmr.bus.message import Message
from cmr.bus.messages import RejectedMessage
from cmr.bus.wire import WIRE_TYPES, Channel, channel_of, layout_of
from cmr.plain_text import cell
from cmr.recordings.events import Event
from cmr_tools.logs.channels import FOREIGN_CHANNEL, LeftOut

LOGGED = "logged [us]"  # column: when the message was logged, since the Unix epoch
MOST_OF_A_CHANNEL = 1 << 20  # bytes of messages collected before they are written
MOST_OF_ALL = 1 << 25  # bytes
PARTS_OF_FIXED_SIZE, PARTS_OF_VARYING_SIZE = 1 << 15, 1 << 8  # messages decoded together


class Column(NamedTuple):
    """A column of a table: its values, shape (n,), and which of them are missing, None if none is."""

    values: NDArray[np.generic]
    is_none: NDArray[np.bool_] | None = None


Table = dict[str, Column]


class Sink(Protocol):
    """A file that takes tables, one after another; their columns are always the same."""

    def write(self, table: Table) -> None:
        """Append a table."""

    def close(self) -> None:
        """Complete the file."""


class TableWriter:
    """Writes the messages of each channel into a file of its own; a context manager, which completes the files.

    `open_sink` opens the file of a channel. `rows` counts written rows by channel, `left_out` messages that could not
    be decoded.
    """

    def __init__(self, open_sink: Callable[[str], Sink]) -> None:
        self._open_sink = open_sink
        self._sinks: dict[str, Sink] = {}
        self._gathered: dict[str, list[tuple[int, bytes]]] = {}
        self._bytes: dict[str, int] = {}
        self._all_bytes = 0
        self.rows: dict[str, int] = {}
        self.left_out = LeftOut()

    def __enter__(self) -> "TableWriter":
        return self

    def __exit__(self, kind: type | None, _error: BaseException | None, _trace: TracebackType | None) -> None:
        try:
            if kind is None:
                for name in list(self._gathered):
                    self._write(name)
        finally:
            for sink in self._sinks.values():
                sink.close()

    def take_all(self, events: Iterable[Event]) -> None:
        """Process the events of a log."""
        for event in events:
            channel = channel_of(event.channel)
            if channel is None:
                self.left_out.add(event.channel, FOREIGN_CHANNEL)
                continue
            try:
                channel.check(event.data)
            except RejectedMessage as rejected:
                self.left_out.add(event.channel, rejected.reason)
            else:
                self._gather(event)

    def _gather(self, event: Event) -> None:
        size = len(event.data) + 100  # bytes; Python's overhead per object
        name = event.channel
        self._gathered.setdefault(name, []).append((event.utime, event.data))
        self._bytes[name] = self._bytes.get(name, 0) + size
        self._all_bytes += size
        if self._bytes[name] >= MOST_OF_A_CHANNEL:
            self._write(name)
        elif self._all_bytes >= MOST_OF_ALL:
            self._write(max(self._bytes, key=lambda each: self._bytes[each]))

    def _write(self, name: str) -> None:
        """Write the collected messages of a channel."""
        messages = self._gathered.pop(name)
        self._all_bytes -= self._bytes.pop(name)
        channel = channel_of(name)
        assert channel is not None
        if name not in self._sinks:
            self._sinks[name] = self._open_sink(name)
        for table in tables_of(channel, messages):
            self.rows[name] = self.rows.get(name, 0) + len(table[LOGGED].values)
            self._sinks[name].write(table)


def tables_of(channel: Channel, messages: list[tuple[int, bytes]]) -> Iterator[Table]:
    """Decode checked messages, each with its logging time [us]; yield them in tables of limited length.

    Of messages with arrays each element is a row, numbered by the column `index`; the message's single values are
    repeated in all of them. A message whose arrays are empty is one row without index and elements.
    """
    part = PARTS_OF_FIXED_SIZE if channel.is_fixed else PARTS_OF_VARYING_SIZE
    for first in range(0, len(messages), part):
        some = messages[first : first + part]
        logged = np.array([utime for utime, _ in some], np.int64)
        data = [content for _, content in some]
        yield (_table_of_fixed_size if channel.is_fixed else _table_of_varying_size)(channel, logged, data)


def _table_of_fixed_size(channel: Channel, logged: NDArray[np.int64], data: list[bytes]) -> Table:
    message_type = channel.stream.message_type
    content = b"".join(each[: channel.least] for each in data)
    messages = np.frombuffer(content, layout_of(message_type))
    table = {LOGGED: Column(logged)}
    for field in fields_of(message_type):
        values = messages[field.name]
        table[field.column] = Column(values.astype(values.dtype.newbyteorder("=")))
    return table


def _table_of_varying_size(channel: Channel, logged: NDArray[np.int64], data: list[bytes]) -> Table:
    fields = fields_of(channel.stream.message_type)
    messages = [message for each in data if (message := channel.check(each)) is not None]
    counts = {field.counted_by for field in fields if field.counted_by is not None}
    if not counts:
        return {LOGGED: Column(logged), **{field.column: _singles(field, messages) for field in fields}}
    [count] = counts  # all arrays of one of CMR's types have the same length
    lengths = np.array([getattr(message, count) for message in messages], np.int64)
    rows = np.maximum(lengths, 1)
    is_none = np.repeat(lengths == 0, rows)
    index = np.arange(len(is_none)) - np.repeat(np.cumsum(rows) - rows, rows)
    table = {LOGGED: Column(np.repeat(logged, rows)), INDEX: Column(index, is_none)}
    for field in fields:
        if field.counted_by is None:
            table[field.column] = Column(np.repeat(_singles(field, messages).values, rows))
        else:
            values = np.zeros(len(is_none), _dtype(field))
            values[~is_none] = np.concatenate([np.asarray(getattr(message, field.name)) for message in messages])
            table[field.column] = Column(values, is_none)
    return table


def _singles(field: Field, messages: list[Message]) -> Column:
    values = [getattr(message, field.name) for message in messages]
    if field.wire_type == BYTES:
        values = list(map(text_of_bytes, values))
    return Column(np.array(values, _dtype(field)))


def _dtype(field: Field) -> np.dtype[np.generic]:
    return (
        np.dtype(object)
        if field.wire_type in ("string", BYTES)
        else np.dtype(WIRE_TYPES[field.wire_type]).newbyteorder("=")
    )


class CsvFile:
    """A CSV file; it is closed between tables, since a log may have more channels than the limit of open files."""

    def __init__(self, path: Path) -> None:
        self._path = path

    def write(self, table: Table) -> None:
        """Append a table; the first line of the file names the columns."""
        is_new = not self._path.exists()
        with self._path.open("a", encoding="utf-8", newline="") as stream:
            writer = csv.writer(stream, lineterminator="\n")
            if is_new:
                writer.writerow(table)
            writer.writerows(zip(*map(_texts, table.values()), strict=True))

    def close(self) -> None:
        """Do nothing: the file is complete."""


def _texts(column: Column) -> list[object]:
    """Return the values as text with as few digits as are exact."""
    texts: list[object] = column.values.tolist()
    if column.values.dtype == object:
        texts = [cell(str(text)) for text in texts]
    elif column.values.dtype == np.float32:
        texts = [str(value) for value in column.values]
    if column.is_none is not None:
        texts = ["" if is_none else text for text, is_none in zip(texts, column.is_none, strict=True)]
    return texts


class _Writer(Protocol):
    """The part of PyArrow's ParquetWriter that is used."""

    def write_table(self, table: object) -> None: ...

    def close(self) -> None: ...


class ParquetFile:
    """A Parquet file. Raises ModuleNotFoundError without PyArrow."""

    def __init__(self, path: Path) -> None:
        import pyarrow
        import pyarrow.parquet

        self._pyarrow = pyarrow
        self._path = path
        self._writer: _Writer | None = None

    def write(self, table: Table) -> None:
        """Append a table as a group of rows."""
        columns = {name: self._pyarrow.array(values, mask=is_none) for name, (values, is_none) in table.items()}
        rows = self._pyarrow.table(columns)
        if self._writer is None:
            self._writer = self._pyarrow.parquet.ParquetWriter(str(self._path), rows.schema)
        self._writer.write_table(rows)

    def close(self) -> None:
        """Complete the file."""
        if self._writer is not None:
            self._writer.close()

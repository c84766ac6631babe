"""ROS 1 bags, read sequentially without their index, which is missing if the recorder was killed.

Format 2.0 (wiki.ros.org/Bags/Format/2.0): a line that names it, then records. A record is a header and data, each
behind its length; the header is of fields name=value, each behind its length. Chunks are records that hold records.
"""

import re
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO

from cmr_tools.importing.ros_records import (
    COMPRESSIONS,
    LONGEST_CUT_CHUNK,
    BagError,
    BagReader,
    Message,
    Topic,
    places,
    type_name,
)
from cmr_tools.importing.unpacking import LARGEST_RECORD, decompress

MAGIC = b"#ROSBAG V"
FIRST_LINE = b"#ROSBAG V2.0\n"

MESSAGE, BAG_HEADER, INDEX, CHUNK, CHUNK_INFO, CONNECTION = 2, 3, 4, 5, 6, 7
LONGEST_HEADER = 1 << 16  # bytes; a chunk's has some 50, a connection's a topic's name more
CHUNK_OP = re.compile(rb"\x04\x00\x00\x00op=\x05")
LONGEST_CHUNK_HEADER = 100  # bytes

Header = dict[bytes, bytes]


class Bag1Reader(BagReader):
    """Reads one .bag file. Raises BagError for another version, or an encrypted bag."""

    def __init__(self, path: Path, wanted: frozenset[str]) -> None:
        super().__init__(path, wanted)
        self._connections: dict[int, Topic] = {}

    def __iter__(self) -> Iterator[Message]:
        with self.path.open("rb") as stream:
            if stream.read(len(FIRST_LINE)) != FIRST_LINE:
                raise BagError(f"{self.path}: is no ROS 1 bag of format 2.0")
            self.position = len(FIRST_LINE)
            self._read_index(stream)
            while self.position < self.size:
                record = _record_at(stream, self.position)
                if record is None:
                    self._get_back_in_step(stream, self.size)
                    continue
                header, start, length = record
                is_whole = start + length <= self.size
                self._is_intact = True
                yield from self._take(stream, header, start, length if is_whole else min(length, LONGEST_CUT_CHUNK))
                if is_whole and self._is_intact:
                    self.position = start + length
                else:
                    self._get_back_in_step(stream, start + length)

    def _take(self, stream: BinaryIO, header: Header, start: int, length: int) -> Iterator[Message]:
        op = _operation(header)
        if op not in (CHUNK, CONNECTION, MESSAGE) or self.is_too_large(length):
            return
        stream.seek(start)
        data = stream.read(length)
        if op == CHUNK:
            yield from self._take_chunk(header, data)
        elif op == CONNECTION:
            self._take_connection(header, data)
        elif len(data) == length:  # the length in the header of an unclosed chunk is missing
            yield from self._take_message(header, data)

    def _take_chunk(self, header: Header, data: bytes) -> Iterator[Message]:
        compression = header.get(b"compression", b"").decode("ascii", "replace")
        if compression not in COMPRESSIONS:
            self._spoil(f"a chunk of unknown compression {compression[:8]!r}")
            return
        size = _number(header, b"size", 4)
        records = decompress(compression, data, LARGEST_RECORD if size is None else min(size, LARGEST_RECORD))
        if self.is_too_large(len(records)):
            return
        if size is not None and len(records) < size:
            self._spoil("a chunk that is not whole")
        place = 0
        while place < len(records):
            record = _record_in(records, place)
            if record is None:
                self._spoil("a chunk with a record that is not intact")
                return
            inner, start, length = record
            if _operation(inner) == CONNECTION:
                self._take_connection(inner, records[start : start + length])
            elif _operation(inner) == MESSAGE:
                yield from self._take_message(inner, records[start : start + length])
            place = start + length

    def _take_connection(self, header: Header, data: bytes) -> None:
        number, about = _number(header, b"conn", 4), _fields(data)
        if number is None or about is None or b"type" not in about:
            self.fault("a connection that is not intact")
            return
        name, kind, definition = (
            text.decode("utf-8", "replace")
            for text in (header.get(b"topic", b""), about[b"type"], about.get(b"message_definition", b""))
        )
        self._connections[number] = self.announce(Topic(name, type_name(kind), "ros1", definition, "msg"))

    def _take_message(self, header: Header, data: bytes) -> Iterator[Message]:
        number, stamp = _number(header, b"conn", 4), header.get(b"time", b"")
        topic = self._connections.get(-1 if number is None else number)
        if topic is None or len(stamp) != 8:
            self.fault("a message of an unknown topic or time")
        elif topic.name in self._wanted:
            seconds, nanoseconds = struct.unpack("<II", stamp)
            yield Message(topic, seconds * 1_000_000_000 + nanoseconds, None, data)

    def _read_index(self, stream: BinaryIO) -> None:
        """Read the topics from the end of the bag, in case the chunks that announce them are damaged."""
        record = _record_at(stream, self.position)
        if record is None:
            return
        if record[0].get(b"encryptor"):
            raise BagError(f"{self.path}: is encrypted")
        place = _number(record[0], b"index_pos", 8)
        if not place:
            self.fault("it was never closed by its recorder")
            return
        while place < self.size and (record := _record_at(stream, place)) is not None:
            header, start, length = record
            if _operation(header) == CONNECTION and not self.is_too_large(length):
                stream.seek(start)
                self._take_connection(header, stream.read(length))
            place = start + length

    def _spoil(self, what: str) -> None:
        """Record that the current chunk is damaged, so that its length may be wrong, too."""
        self.fault(what)
        self._is_intact = False

    def _get_back_in_step(self, stream: BinaryIO, end: int) -> None:
        """Move to the next chunk, or to `end`, the end of the damaged record by its length, if that is nearer."""
        following = end if end <= self.size else self.size
        for place in places(stream, self.position + 1, CHUNK_OP, LONGEST_CHUNK_HEADER):
            begin = _begin_of_chunk(stream, place, self.position + 1)
            if begin is not None:
                following = min(begin, following)
                break
        self.damage(following - self.position)
        self.position = following


def _begin_of_chunk(stream: BinaryIO, place: int, earliest: int) -> int | None:
    """Return the start of the chunk whose field op is at `place`; None if there is no chunk."""
    for begin in range(place - 4, max(place - LONGEST_CHUNK_HEADER, earliest) - 1, -1):
        record = _record_at(stream, begin)
        if record is not None and begin + 4 <= place < record[1] and b"compression" in record[0]:
            return begin if _operation(record[0]) == CHUNK else None
    return None


def _record_at(stream: BinaryIO, place: int) -> tuple[Header, int, int] | None:
    """Return a record's header, and the offset and length of its data in the file; None if there is none."""
    stream.seek(place)
    head = stream.read(4)
    if len(head) < 4 or not 0 < (length := int.from_bytes(head, "little")) <= LONGEST_HEADER:
        return None
    found = _record_in(head + stream.read(length + 4), 0, header_only=True)
    return None if found is None else (found[0], place + found[1], found[2])


def _record_in(data: bytes, place: int, *, header_only: bool = False) -> tuple[Header, int, int] | None:
    """Return the same of a record in memory, whose data must be complete, unless `header_only`."""
    start = place + 8 + int.from_bytes(data[place : place + 4], "little")
    if start > len(data):
        return None
    header = _fields(data[place + 4 : start - 4])
    length = int.from_bytes(data[start - 4 : start], "little")
    if header is None or b"op" not in header or (not header_only and start + length > len(data)):
        return None
    return header, start, length


def _fields(data: bytes) -> Header | None:
    """Return the fields of a header; None if it is not one."""
    fields = {}
    place = 0
    while place < len(data):
        end = place + 4 + int.from_bytes(data[place : place + 4], "little")
        name, equals, value = data[place + 4 : end].partition(b"=")
        if end > len(data) or not equals:
            return None
        fields[name] = value
        place = end
    return fields


def _operation(header: Header) -> int:
    return header[b"op"][0] if header[b"op"] else 0


def _number(header: Header, name: bytes, size: int) -> int | None:
    value = header.get(name, b"")
    return int.from_bytes(value, "little") if len(value) == size else None

"""MCAP files, read sequentially without their index, which is missing if the recorder was killed.

Format (mcap.dev/spec): eight magic bytes, then records: a byte for the kind, the length in 64 bits, the
content. Chunks are records that hold records, compressed, with a checksum.
"""

import re
import struct
import zlib
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

MAGIC = b"\x89MCAP0\r\n"

FOOTER, SCHEMA, CHANNEL, MESSAGE, CHUNK = 2, 3, 4, 5, 6
RECORD_HEAD = struct.Struct("<BQ")
MESSAGE_HEAD = struct.Struct("<HIQQ")  # channel, sequence, log time, publish time
CHUNK_HEAD = struct.Struct("<QQQI")  # first and last time, uncompressed size, checksum
CHUNK_BEGIN = re.compile(
    rb"\x06.{5}\x00{3}.{20}.{8}(?:\x00{4}|\x03\x00{3}lz4|\x04\x00{3}zstd)", re.DOTALL
)  # shorter than 2^40 bytes, and of a known compression
LONGEST_CHUNK_BEGIN = 45  # bytes
FOOTER_BYTES = RECORD_HEAD.size + 20 + len(MAGIC)
LANGUAGES = {"ros1msg": "msg", "ros2msg": "msg", "ros2idl": "idl", "omgidl": "idl"}


class McapReader(BagReader):
    """Reads one MCAP file, of ROS or not. Raises BagError if it is not an MCAP file."""

    def __init__(self, path: Path, wanted: frozenset[str]) -> None:
        super().__init__(path, wanted)
        self._schemas: dict[int, tuple[str, str, str]] = {}  # name, definition, language
        self._channels: dict[int, Topic] = {}

    def __iter__(self) -> Iterator[Message]:
        with self.path.open("rb") as stream:
            if stream.read(len(MAGIC)) != MAGIC:
                raise BagError(f"{self.path}: is no MCAP file")
            self._read_summary(stream)
            self.position = len(MAGIC)
            kind = 0
            while self.position < self.size and kind != FOOTER:
                stream.seek(self.position)
                head = stream.read(RECORD_HEAD.size)
                kind, length = RECORD_HEAD.unpack(head) if len(head) == RECORD_HEAD.size else (0, 0)
                end = self.position + RECORD_HEAD.size + length
                is_whole = kind != 0 and end <= self.size
                self._is_intact = True
                if kind in (SCHEMA, CHANNEL, MESSAGE, CHUNK) and is_whole and self.is_too_large(length):
                    pass
                elif kind == CHUNK:
                    yield from self._take_chunk(stream.read(length if is_whole else min(length, LONGEST_CUT_CHUNK)))
                elif kind in (SCHEMA, CHANNEL, MESSAGE) and is_whole:
                    yield from self._take(kind, stream.read(length))
                if is_whole and self._is_intact:
                    self.position = end
                else:
                    self._get_back_in_step(stream, end if is_whole else self.size)
            if kind != FOOTER:
                self.fault("it has no end")

    def _take_chunk(self, content: bytes) -> Iterator[Message]:
        start = CHUNK_HEAD.size + 12
        if len(content) < start:
            return
        _, _, size, checksum = CHUNK_HEAD.unpack_from(content)
        name_end = CHUNK_HEAD.size + 4 + int.from_bytes(content[28:32], "little")
        compression = content[32:name_end].decode("ascii", "replace")
        if compression not in COMPRESSIONS or name_end + 8 > len(content):
            self._spoil(f"a chunk of unknown compression {compression[:8]!r}")
            return
        length = int.from_bytes(content[name_end : name_end + 8], "little")
        packed = content[name_end + 8 : name_end + 8 + length]
        records = decompress(compression, packed, min(size, LARGEST_RECORD))
        if self.is_too_large(len(records)):
            return
        if len(records) != size:
            self._spoil("a chunk that is not whole")
        elif checksum and zlib.crc32(records) != checksum:
            self._spoil("a chunk that fails its checksum")
            for _ in self._take_records(records, (SCHEMA, CHANNEL)):  # else a file without its end has no topics
                pass
            return
        yield from self._take_records(records, (SCHEMA, CHANNEL, MESSAGE))

    def _take_records(self, records: bytes, wanted: tuple[int, ...]) -> Iterator[Message]:
        place = 0
        while place + RECORD_HEAD.size <= len(records):
            kind, length = RECORD_HEAD.unpack_from(records, place)
            place += RECORD_HEAD.size
            if kind not in (SCHEMA, CHANNEL, MESSAGE) or place + length > len(records):
                break
            if kind in wanted:
                yield from self._take(kind, records[place : place + length])
            place += length
        if place != len(records):
            self._spoil("a chunk with a record that is not intact")

    def _take(self, kind: int, content: bytes) -> Iterator[Message]:
        if kind == MESSAGE:
            yield from self._take_message(content)
            return
        try:
            if kind == SCHEMA:
                self._take_schema(content)
            else:
                self._take_channel(content)
        except (struct.error, UnicodeDecodeError):
            self.fault("a schema or channel that is not intact")

    def _take_schema(self, content: bytes) -> None:
        (number,) = struct.unpack_from("<H", content)
        if number in self._schemas:
            return  # known from the end of the file
        name, place = _text(content, 2)
        language, place = _text(content, place)
        definition, _ = _text(content, place)
        self._schemas[number] = name, definition, LANGUAGES.get(language, language)

    def _take_channel(self, content: bytes) -> None:
        number, schema = struct.unpack_from("<HH", content)
        if number in self._channels:
            return
        name, place = _text(content, 4)
        encoding, _ = _text(content, place)
        kind, definition, language = self._schemas.get(schema, ("", "", ""))
        topic = Topic(name, type_name(kind) or encoding, encoding, definition, language)
        self._channels[number] = self.announce(topic)

    def _take_message(self, content: bytes) -> Iterator[Message]:
        if len(content) < MESSAGE_HEAD.size:
            self.fault("a message that is not intact")
            return
        channel, _, received, published = MESSAGE_HEAD.unpack_from(content)
        topic = self._channels.get(channel)
        if topic is None:
            self.fault("a message of an unknown topic")
        elif topic.name in self._wanted:
            yield Message(topic, received, published, content[MESSAGE_HEAD.size :])

    def _read_summary(self, stream: BinaryIO) -> None:
        """Read the topics from the end of the file, in case the chunks that announce them are damaged."""
        if self.size < FOOTER_BYTES:
            return
        stream.seek(self.size - FOOTER_BYTES)
        footer = stream.read(FOOTER_BYTES)
        (place,) = struct.unpack_from("<Q", footer, RECORD_HEAD.size)
        if footer[0] != FOOTER or not footer.endswith(MAGIC) or not 0 < place < self.size:
            return
        while place + RECORD_HEAD.size <= self.size - FOOTER_BYTES:
            stream.seek(place)
            kind, length = RECORD_HEAD.unpack(stream.read(RECORD_HEAD.size))
            place += RECORD_HEAD.size + length
            if kind == 0:
                return  # the footer does not point to a summary
            if place <= self.size and kind in (SCHEMA, CHANNEL) and not self.is_too_large(length):
                for _ in self._take(kind, stream.read(length)):
                    pass

    def _spoil(self, what: str) -> None:
        """Record that the current chunk is damaged, so that its length may be wrong, too."""
        self.fault(what)
        self._is_intact = False

    def _get_back_in_step(self, stream: BinaryIO, end: int) -> None:
        """Move to the next chunk, or to `end`, the end of the damaged record by its length, if that is nearer."""
        following = min(next(places(stream, self.position + 1, CHUNK_BEGIN, LONGEST_CHUNK_BEGIN), end), end)
        self.damage(following - self.position)
        self.position = following


def _text(content: bytes, place: int) -> tuple[str, int]:
    """Return the text at `place` of a record, and where it ends."""
    (length,) = struct.unpack_from("<I", content, place)
    end = place + 4 + length
    if end > len(content):
        raise struct.error("text is longer than its record")
    return content[place + 4 : end].decode(), end

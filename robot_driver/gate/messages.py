"""Messages between driver and last gate: two messages of fixed length, each checked by a CRC-32."""

import struct
from enum import IntEnum
from typing import NamedTuple
from zlib import crc32

MOST_DATA = 240  # bytes that are written to a controller in one go
SECOND = 10**9  # ns; all times here are ns since the computer was started, also while it was suspended


class Malformed(ValueError):  # noqa: N818 - the name of the reason
    """Bytes that are not a valid message."""


class Kind(IntEnum):
    """Request of a driver's message, besides the command in force."""

    FEED = 0  # nothing
    WRITE = 1  # write `data` to the controller
    OPEN = 2  # write to the port whose descriptor comes with this message
    CLOSE = 3  # give the port up
    END = 4  # end, now that the motors were stopped


class Reason(IntEnum):
    """Why something was refused; reports count them in this order."""

    MALFORMED = 0  # not a message, or not newer than the last one
    LATE = 1  # sent too long ago: a delayed command is out of date
    INSANE = 2  # a command that is not finite, beyond full duty, or in force for too long
    NO_PORT = 3  # there is no port to write to
    FOREIGN = 4  # bytes that are none of the driver's requests
    UNARMED = 5  # the controller has not been given its watchdog
    HELD = 6  # the motors are held
    STALE = 7  # no command is in force
    BEYOND = 8  # not on the way from the last duty to the one commanded
    ZERO_FIRST = 9  # after the gate stopped the motors, the driver must send zero before anything else


class Word(NamedTuple):
    """A message of the driver: its command in force, and the data to write.

    `sequence` grows by one or more. `held`: the motors are held; `engaged`: by the emergency stop. The command (duty of
    each side) is in force until `expires`; `sent` is when this was sent [ns since the start of the computer].
    """

    kind: Kind
    sequence: int
    sent: int
    held: bool
    engaged: bool
    left: float
    right: float
    expires: int
    data: bytes = b""


class Report(NamedTuple):
    """A message of the gate: its state, and counts of refusals since it was started.

    `sequence` is that of the last accepted message. `interventions` counts how often it stopped the motors itself;
    `acknowledged`: the controller acknowledged zero the last time. `latched`: an emergency stop is stored on the disk.
    """

    sequence: int
    has_port: bool
    latched: bool
    acknowledged: bool
    interventions: int
    refused: tuple[int, ...]


_WORD = struct.Struct(f"<4sBBHQqddq{MOST_DATA}s")
_REPORT = struct.Struct(f"<4sB3xQI{len(Reason)}I")
_CHECK = struct.Struct("<I")
_MAGIC = b"CMRw", b"CMRr"
WORD_LENGTH = _WORD.size + _CHECK.size
REPORT_LENGTH = _REPORT.size + _CHECK.size
_FLAGS = 3  # bits in use


def packed_word(word: Word) -> bytes:
    """Return the bytes of a message to the gate. Raises struct.error for values out of range."""
    flags = word.held | word.engaged << 1
    if len(word.data) > MOST_DATA:
        raise struct.error(f"{len(word.data)} bytes are too many.")
    head = _MAGIC[0], word.kind, flags, len(word.data), word.sequence, word.sent
    return _checked(_WORD.pack(*head, word.left, word.right, word.expires, word.data))


def word_in(message: bytes) -> Word:
    """Decode a message of the driver. Raises Malformed."""
    magic, kind, flags, length, sequence, sent, left, right, expires, data = _WORD.unpack(_content(message, _WORD))
    if magic != _MAGIC[0] or kind > Kind.END or flags > _FLAGS or length > MOST_DATA or data[length:].strip(b"\0"):
        raise Malformed
    return Word(Kind(kind), sequence, sent, bool(flags & 1), bool(flags & 2), left, right, expires, data[:length])


def packed_report(report: Report) -> bytes:
    """Return the bytes of a message of the gate."""
    flags = report.has_port | report.latched << 1 | report.acknowledged << 2
    counts = (min(count, 2**32 - 1) for count in (report.interventions, *report.refused))
    return _checked(_REPORT.pack(_MAGIC[1], flags, report.sequence, *counts))


def report_in(message: bytes) -> Report:
    """Decode a message of the gate. Raises Malformed."""
    magic, flags, sequence, interventions, *refused = _REPORT.unpack(_content(message, _REPORT))
    if magic != _MAGIC[1]:
        raise Malformed
    return Report(sequence, bool(flags & 1), bool(flags & 2), bool(flags & 4), interventions, tuple(refused))


def _checked(content: bytes) -> bytes:
    return content + _CHECK.pack(crc32(content))


def _content(message: bytes, layout: struct.Struct) -> bytes:
    """Return a message without its check. Raises Malformed if that or the length is wrong."""
    content, check = message[: layout.size], message[layout.size :]
    if len(content) != layout.size or check != _CHECK.pack(crc32(content)):
        raise Malformed
    return content

"""Messages of KVH 1725, 1750 and 1775 IMUs and DSP-1760 gyros: binary in normal mode, lines of text otherwise.

All numbers are big-endian. Data messages end with CRC-32/MPEG-2 over all their bytes, answers to commands have no
checksum. Source: KVH 1775 IMU technical manual 56-0298 Rev. B, tables 5-1 to 5-12 and section 7.
"""

import re
import struct
import zlib
from dataclasses import dataclass
from typing import NamedTuple

_ROTATION = struct.Struct(">fff")
LONGEST_LINE = 256  # bytes; the longest answer, that to ?AXES, has 132

_REVERSED_BITS = bytes(int(f"{byte:08b}"[::-1], 2) for byte in range(256))
_ANSWER = re.compile(rb"([A-Z]+),([ -~]*)\Z")  # a prompt like "CFG>" may stand before it


@dataclass(frozen=True)
class Layout:
    """Length of a data message and place of its status byte, in bytes; the sequence number is the next byte."""

    length: int
    status: int


LAYOUTS = {
    b"\xfe\x81\xff\x55": Layout(36, 28),  # format A
    b"\xfe\x81\xff\x56": Layout(40, 32),  # format B, with a time
    b"\xfe\x81\xff\x57": Layout(38, 32),  # format C, with a magnetometer
}
SELF_TESTS = {b"\xfe\x81\x00\xaa": 11, b"\xfe\x81\x00\xab": 13}  # header: length in bytes, the last a sum of the others
# A header, or at the end possibly the beginning of one; its first byte does not occur in text.
_BEGINNING = re.compile(rb"\xfe(?:\Z|\x81(?:\Z|\xff(?:\Z|[\x55-\x57])|\x00(?:\Z|[\xaa\xab])))")
_LENGTHS = SELF_TESTS | {header: layout.length for header, layout in LAYOUTS.items()}
_LONGEST_MESSAGE = max(_LENGTHS.values())  # bytes


class Sample(NamedTuple):
    """One data message.

    `rotation` is about the axes x, y, z, in the unit set in the device, counter-clockwise positive seen from the end of
    the axis. Bits 0, 1, 2 of `status` vouch for the sensors of x, y, z. `sequence` counts to 127. `bytes_since` is as
    in GyroReading.
    """

    rotation: tuple[float, float, float]
    status: int
    sequence: int
    bytes_since: int


@dataclass(frozen=True)
class SelfTest:
    """The result of a self-test, which a device sends after power-up."""


@dataclass(frozen=True)
class Answer:
    """Answer of a device to a command or query: its name, and the value as text."""

    name: str
    value: str


class Stream:
    """Splits the bytes of a device, in pieces of any size, into messages and answers; damaged ones are skipped."""

    def __init__(self) -> None:
        self._waiting = b""  # possibly beginning with the start of a message
        self._line = b""

    def feed(self, data: bytes) -> list[Sample | SelfTest | Answer]:
        """Process the next bytes; return the items completed by them."""
        complete: list[Sample | SelfTest | Answer] = []
        data = self._waiting + data
        text = position = 0  # start of bytes outside messages, and of a possible message
        while (beginning := _BEGINNING.search(data, position)) is not None:
            start = beginning.start()
            end = start + _LENGTHS.get(beginning[0], _LONGEST_MESSAGE)
            if end > len(data):
                break
            message = _message(data[start:end], len(data) - start)
            position = start + 1  # a complete message may begin within a damaged one
            if message is not None:
                if text < start:
                    complete += self._answers(data[text:start])
                complete.append(message)
                self._line = b""  # text before a message is not the beginning of an answer
                text = position = end
        end = len(data) if beginning is None else beginning.start()
        if text < end:
            complete += self._answers(data[text:end])
        self._waiting = data[end:]
        return complete

    def _answers(self, text: bytes) -> list[Answer]:
        *lines, rest = re.split(rb"[\r\n]", self._line + text)
        self._line = rest[-LONGEST_LINE:]
        matches = [_ANSWER.search(line[-LONGEST_LINE:]) for line in lines]
        return [Answer(match[1].decode(), match[2].decode()) for match in matches if match is not None]


def checksum(data: bytes) -> int:
    """Return CRC-32/MPEG-2: polynomial 0x04C11DB7, initial value 0xFFFFFFFF, nothing reflected or inverted.

    It is zlib's CRC-32 with all bits in reverse order and without the final inversion.
    """
    mirrored = zlib.crc32(data.translate(_REVERSED_BITS)) ^ 0xFFFFFFFF
    return int.from_bytes(mirrored.to_bytes(4, "little").translate(_REVERSED_BITS), "big")


def ends_with_checksum(data: bytes) -> bool:
    """Return whether the last four bytes are the checksum of those before: then that of all together is 0."""
    return zlib.crc32(data.translate(_REVERSED_BITS)) == 0xFFFFFFFF


def _message(data: bytes, bytes_since: int) -> Sample | SelfTest | None:
    """Return the content of a message of the right length, None if it is damaged."""
    header = data[:4]
    layout = LAYOUTS.get(header)
    if layout is None:
        is_sound = header in SELF_TESTS and sum(data[:-1]) & 0xFF == data[-1]
        return SelfTest() if is_sound else None
    if not ends_with_checksum(data):
        return None
    return Sample(_ROTATION.unpack_from(data, 4), data[layout.status], data[layout.status + 1], bytes_since)

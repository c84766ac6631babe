"""Messages as bytes: the layout of their fields, and checks without decoding.

Every message begins with the fingerprint of its type and its `utime`; where a type has a `robot_id`, that comes next.
The layout of the rest is derived from the generated class, so it always agrees with lcmtypes/.
"""

import struct
from functools import cache, lru_cache
from typing import NamedTuple

import numpy as np

from cmr.bus.message import FINGERPRINT_BYTES, Message
from cmr.bus.messages import RejectedMessage, decode
from cmr.bus.streams import STREAMS, Stream, identify

FINGERPRINT = "fingerprint"  # name of the first bytes of every message
UTIME_AT = FINGERPRINT_BYTES
ROBOT_ID_AT = UTIME_AT + 8
# NumPy's names of LCM's types of fixed size; LCM sends the most significant byte first.
WIRE_TYPES = {
    "int8_t": ">i1",
    "int16_t": ">i2",
    "int32_t": ">i4",
    "int64_t": ">i8",
    "float": ">f4",
    "double": ">f8",
    "boolean": ">i1",
    "byte": ">u1",
}
TYPES = {stream.message_type._get_packed_fingerprint(): stream.message_type for stream in STREAMS}
MOST_CHANNELS = 5000  # names that are distinguished; a log with more is damaged
_UTIME = struct.Struct(">q")


@cache
def layout_of(message_type: type[Message]) -> np.dtype[np.void]:
    """Return the NumPy dtype of an encoded message of this class: fingerprint, then its fields.

    Raises TypeError for a class that is not of fixed size.
    """
    fields = zip(message_type.__slots__, message_type.__typenames__, message_type.__dimensions__, strict=True)
    layout = [(FINGERPRINT, f"V{FINGERPRINT_BYTES}")]
    for name, wire_type, dimensions in fields:
        if wire_type not in WIRE_TYPES or dimensions is not None:
            raise TypeError(f"{message_type.__name__}: {name} is not of fixed size")
        layout.append((name, WIRE_TYPES[wire_type]))
    return np.dtype(layout)


def offsets(message_type: type[Message]) -> dict[str, int]:
    """Return where each field begins in the bytes of a message, up to the first one of variable length."""
    found: dict[str, int] = {}
    offset = FINGERPRINT_BYTES
    fields = zip(message_type.__slots__, message_type.__typenames__, message_type.__dimensions__, strict=True)
    for name, wire_type, dimensions in fields:
        found[name] = offset
        if dimensions is not None or wire_type not in WIRE_TYPES:
            break
        offset += np.dtype(WIRE_TYPES[wire_type]).itemsize
    return found


def utime_of(data: bytes) -> int:
    """Return the `utime` of a message [us since the Unix epoch]; it must be at least that long."""
    utime: int = _UTIME.unpack_from(data, UTIME_AT)[0]
    return utime


class Channel(NamedTuple):
    """A known channel: its stream, its robot (None: all), and the properties of its encoded messages.

    `least` is the size of its shortest message [bytes], if `is_fixed` of all; `robot` are the bytes of the robot id,
    empty on a channel for all robots.
    """

    name: str
    stream: Stream[Message]
    robot_id: int | None
    fingerprint: bytes
    least: int
    is_fixed: bool
    robot: bytes

    def fault(self, data: bytes) -> str:
        """Return why these bytes cannot be a message of the channel, one of REASONS; empty if they can."""
        if not data.startswith(self.fingerprint):
            return "foreign"
        if len(data) < self.least:
            return "corrupt"
        return "" if data.startswith(self.robot, ROBOT_ID_AT) else "wrong_robot"

    def check(self, data: bytes) -> Message | None:
        """Check an encoded message. Return it decoded if its size varies, None if the size is fixed and no decoding is
        needed.

        Raises RejectedMessage when it cannot be used.
        """
        if not self.is_fixed:
            return decode(self.name, data).message
        reason = self.fault(data)
        if reason:
            raise RejectedMessage(reason, f"{len(data)} bytes on {self.name}")
        return None


@lru_cache(maxsize=MOST_CHANNELS)
def channel_of(name: str) -> Channel | None:
    """Return the channel of this name, None for an unknown channel."""
    identity = identify(name)
    if identity is None:
        return None
    stream, robot_id = identity
    fingerprint, least, is_fixed = _of_type(stream.message_type)
    robot = b"" if robot_id is None else robot_id.to_bytes(4, "big")
    return Channel(name, stream, robot_id, fingerprint, least, is_fixed, robot)


@cache
def _of_type(message_type: type[Message]) -> tuple[bytes, int, bool]:
    """Return the fingerprint of a type, the size of its shortest message [bytes], and whether all are of that size."""
    is_fixed = not any(message_type.__dimensions__) and set(message_type.__typenames__) <= set(WIRE_TYPES)
    return message_type._get_packed_fingerprint(), len(message_type().encode()), is_fixed

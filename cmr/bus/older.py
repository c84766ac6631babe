"""Convert messages of older types, from before a field was appended, to today's types.

A field that an older log or driver does not have is set to 0.
"""

from typing import NamedTuple

from cmr.bus.message import FINGERPRINT_BYTES, Message
from cmr.msg import motor_feedback_t


class Older(NamedTuple):
    """An older version of a type: its encoded `size` [bytes, fingerprint included], and the type's name today."""

    size: int
    message_type: type[Message]


OLDER = {
    # motor_feedback_t without applied_utime
    bytes.fromhex("17ee2f1946253fa0"): Older(112, motor_feedback_t),
}


def as_of_today(data: bytes) -> bytes:
    """Return an encoded message converted to today's type; other messages are returned unchanged."""
    older = OLDER.get(data[:FINGERPRINT_BYTES])
    if older is None:
        return data
    fingerprint: bytes = older.message_type._get_packed_fingerprint()
    if len(data) < older.size:  # damaged; the decoder reports it
        return fingerprint + data[FINGERPRINT_BYTES:]
    return fingerprint + data[FINGERPRINT_BYTES : older.size] + bytes(len(older.message_type().encode()) - older.size)

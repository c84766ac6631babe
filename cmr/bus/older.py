"""Messages of types as they were before a field was added to their end: read as those of today.

A log, or a driver, that is older than the field says nothing of it: it is 0 then.
"""

from typing import NamedTuple

from cmr.bus.message import FINGERPRINT_BYTES, Message
from cmr.msg import motor_feedback_t


class Older(NamedTuple):
    """How a type was: its encoded `size` [bytes, fingerprint included], and its name of today."""

    size: int
    message_type: type[Message]


OLDER = {
    # motor_feedback_t without applied_utime
    bytes.fromhex("17ee2f1946253fa0"): Older(112, motor_feedback_t),
}


def as_of_today(data: bytes) -> bytes:
    """Return an encoded message as it would be sent today; one that is not of an older type as it is."""
    older = OLDER.get(data[:FINGERPRINT_BYTES])
    if older is None:
        return data
    fingerprint: bytes = older.message_type._get_packed_fingerprint()
    if len(data) < older.size:  # damaged, and so it stays
        return fingerprint + data[FINGERPRINT_BYTES:]
    return fingerprint + data[FINGERPRINT_BYTES : older.size] + bytes(len(older.message_type().encode()) - older.size)

"""Signatures: programs that have the key may send messages to robots and about them; what others send is refused.

A signature follows the encoded message, so whoever decodes the message passes it over; LCM's decoders do so in every
language. It is keyed BLAKE2b (RFC 7693) over the channel, the message, who sent it, and when.
"""

import hmac
import os
from collections.abc import Callable
from hashlib import blake2b
from struct import Struct
from typing import NamedTuple

from cmr.bus.messages import RejectedMessage, decode, now_utime
from cmr.bus.streams import COMMAND_CLAIM, ESTOP, MOTOR_COMMAND, VELOCITY_COMMAND, WHEEL_SPEED_COMMAND, identify
from cmr.msg import estop_t

KEY_BYTES = 32
TAG_BYTES = 16
MAGIC = b"CMR1"  # the last bytes of a message that is signed
TRAILER = Struct(f">qq{TAG_BYTES}s{len(MAGIC)}s")  # who sent it, when [us since the Unix epoch], the tag, MAGIC
SIGNED = Struct(">qq")  # the part of it that the tag covers, too
WINDOW = 1_000_000  # us by which the moment of sending may differ from the receiver's clock
SET_BACK = 100_000  # us by which a clock may go back before its process takes another name
NO_TAG = bytes(TAG_BYTES)
# Names of the streams whose sender counts, also where there is no key.
COMMANDING = frozenset(stream.name for stream in (MOTOR_COMMAND, WHEEL_SPEED_COMMAND, VELOCITY_COMMAND, COMMAND_CLAIM))

# Why a message was refused for its signature. unsigned: it has none, and this process has a key. forged: its sender has
# another key, or it was changed. stale: sent more than a second before or after now, as in a log that is replayed; or
# clocks of computers differ by as much. repeated: it came before.
SIGNATURE_REASONS = ("unsigned", "forged", "stale", "repeated")


class Signed(NamedTuple):
    """A message without its signature, and who sent it: a name that each process makes up for itself; None: unknown."""

    data: bytes
    sender: int | None


class RefusedSignature(Exception):  # noqa: N818 - it is a finding, not a failure of the program
    """A message that is not taken for its signature; `reason` is one of SIGNATURE_REASONS."""

    def __init__(self, reason: str) -> None:
        super().__init__(reason)
        self.reason = reason


class Signer:
    """Signs what a process sends. Without a key it only writes its name under commands.

    No two signatures of a process are of the same moment, so that a message that is repeated is known.
    """

    def __init__(self, key: bytes | None, utime: Callable[[], int] = now_utime) -> None:
        self._key, self._utime = key, utime
        self._latest = 0
        self.sender = _new_name()

    def sign(self, channel: str, data: bytes) -> bytes:
        """Return a message as it goes onto the bus."""
        if self._key is None and not _is_commanding(channel):
            return data
        now = self._utime()
        if now < self._latest - SET_BACK:
            self.sender = _new_name()  # else nothing would be taken until the clock is where it was
        elif now <= self._latest:
            now = self._latest + 1
        self._latest = now
        tag = NO_TAG if self._key is None else _tag(self._key, channel, data, SIGNED.pack(self.sender, now))
        return data + TRAILER.pack(self.sender, now, tag, MAGIC)


class Verifier:
    """Verifies what a process receives: with a key each signature; without one it takes all as it comes."""

    def __init__(self, key: bytes | None, utime: Callable[[], int] = now_utime) -> None:
        self._key, self._utime = key, utime
        self._latest: dict[tuple[int, str], int] = {}
        self._forgotten = 0

    def verify(self, channel: str, data: bytes) -> Signed:
        """Return a message and its sender. An emergency stop that is engaged needs no signature.

        Raises RefusedSignature for any other that cannot be taken.
        """
        try:
            return self._verified(channel, data)
        except RefusedSignature:
            if channel == ESTOP.name and _engages(data):
                return Signed(without_signature(data), None)
            raise

    def _verified(self, channel: str, data: bytes) -> Signed:
        if not _has_trailer(data):
            if self._key is not None:
                raise RefusedSignature("unsigned")
            return Signed(data, None)
        message = data[: -TRAILER.size]
        sender, sent, tag, _ = TRAILER.unpack_from(data, len(message))
        if self._key is not None:
            self._check(channel, message, SIGNED.pack(sender, sent), tag)
            self._note(sender, channel, sent)
        return Signed(message, sender)

    def _check(self, channel: str, message: bytes, signed: bytes, tag: bytes) -> None:
        assert self._key is not None
        if tag == NO_TAG:
            raise RefusedSignature("unsigned")
        if not hmac.compare_digest(tag, _tag(self._key, channel, message, signed)):
            raise RefusedSignature("forged")

    def _note(self, sender: int, channel: str, sent: int) -> None:
        """Refuse what is not of now, or no later than what the sender sent last on this channel."""
        now = self._utime()
        if abs(now - sent) > WINDOW:
            raise RefusedSignature("stale")
        if sent <= self._latest.get((sender, channel), 0):
            raise RefusedSignature("repeated")
        self._latest[sender, channel] = sent
        if abs(now - self._forgotten) > WINDOW:  # what is older would be stale
            self._forgotten = now
            self._latest = {which: last for which, last in self._latest.items() if abs(now - last) <= 2 * WINDOW}


def without_signature(data: bytes) -> bytes:
    """Return a message as it was encoded, whether it is signed or not."""
    return data[: -TRAILER.size] if _has_trailer(data) else data


def _has_trailer(data: bytes) -> bool:
    return data.endswith(MAGIC) and len(data) >= TRAILER.size


def _engages(data: bytes) -> bool:
    try:
        message = decode(ESTOP.name, data).message
    except RejectedMessage:
        return False
    return isinstance(message, estop_t) and bool(message.engaged)


def _new_name() -> int:
    return int.from_bytes(os.urandom(8), "big", signed=True)


def _is_commanding(channel: str) -> bool:
    identity = identify(channel)
    return identity is not None and identity[0].name in COMMANDING


def _tag(key: bytes, channel: str, message: bytes, signed: bytes) -> bytes:
    """Return the tag of a message. No channel name has a zero byte, which ends it here."""
    tag = blake2b(channel.encode() + b"\0", digest_size=TAG_BYTES, key=key, person=b"CMR message")
    tag.update(message)
    tag.update(signed)
    return tag.digest()

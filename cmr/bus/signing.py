"""Sign and verify messages: only programs that have the key may send messages to robots or about them.

The signature follows the encoded message, where decoders ignore it; LCM's decoders in all languages do. It is keyed
BLAKE2b (RFC 7693) over the channel, the message, who sent it, and when.
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
MAGIC = b"CMR1"  # the last bytes of a signed message
TRAILER = Struct(f">qq{TAG_BYTES}s{len(MAGIC)}s")  # sender, time of sending [us since the Unix epoch], tag, MAGIC
SIGNED = Struct(">qq")  # the part of the trailer that the tag covers
WINDOW = 1_000_000  # us by which the moment of sending may differ from the receiver's clock
SET_BACK = 100_000  # us by which a clock may go back before the process takes a new name
NO_TAG = bytes(TAG_BYTES)
# Names of the streams whose sender matters even without a key.
COMMANDING = frozenset(stream.name for stream in (MOTOR_COMMAND, WHEEL_SPEED_COMMAND, VELOCITY_COMMAND, COMMAND_CLAIM))

# Why a message was refused for its signature. unsigned: it has no signature, and this process has a key. forged: its
# sender has another key, or it was changed. stale: sent more than a second before or after now, as in a log that is
# replayed; or clocks of computers differ by as much. repeated: it was received before.
SIGNATURE_REASONS = ("unsigned", "forged", "stale", "repeated")


class Signed(NamedTuple):
    """A message without its signature, and its sender: a random name that each process chooses; None if unknown."""

    data: bytes
    sender: int | None


class RefusedSignature(Exception):  # noqa: N818 - it is a finding, not a failure of the program
    """A message was refused because of its signature; `reason` is one of SIGNATURE_REASONS."""

    def __init__(self, reason: str) -> None:
        super().__init__(reason)
        self.reason = reason


class Signer:
    """Signs what a process sends. Without a key it only adds the sender's name to commands.

    No two signatures of a process have the same time, so a repeated message is recognised.
    """

    def __init__(self, key: bytes | None, utime: Callable[[], int] = now_utime) -> None:
        self._key, self._utime = key, utime
        self._latest = 0
        self.sender = _new_name()

    def sign(self, channel: str, data: bytes) -> bytes:
        """Return a message with its signature, as sent on the bus."""
        if self._key is None and not _is_commanding(channel):
            return data
        now = self._utime()
        if now < self._latest - SET_BACK:
            self.sender = _new_name()  # otherwise everything would be refused until the clock is back where it was
        elif now <= self._latest:
            now = self._latest + 1
        self._latest = now
        tag = NO_TAG if self._key is None else _tag(self._key, channel, data, SIGNED.pack(self.sender, now))
        return data + TRAILER.pack(self.sender, now, tag, MAGIC)


class Verifier:
    """Verifies what a process receives: with a key every signature; without one it accepts all messages."""

    def __init__(self, key: bytes | None, utime: Callable[[], int] = now_utime) -> None:
        self._key, self._utime = key, utime
        self._latest: dict[tuple[int, str], int] = {}
        self._forgotten = 0

    def verify(self, channel: str, data: bytes) -> Signed:
        """Return a message and its sender. An emergency stop that is engaged needs no signature.

        Raises RefusedSignature for any other message without a valid signature.
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
        """Refuse a message not sent around now, or not later than the sender's last one on this channel."""
        now = self._utime()
        if abs(now - sent) > WINDOW:
            raise RefusedSignature("stale")
        if sent <= self._latest.get((sender, channel), 0):
            raise RefusedSignature("repeated")
        self._latest[sender, channel] = sent
        if abs(now - self._forgotten) > WINDOW:  # older senders would be stale anyway
            self._forgotten = now
            self._latest = {which: last for which, last in self._latest.items() if abs(now - last) <= 2 * WINDOW}


def without_signature(data: bytes) -> bytes:
    """Return the encoded message without its signature, if it has one."""
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

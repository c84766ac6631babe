"""The channels of CMR in a log: what each carries, and which of its messages can be used."""

import struct
from collections import Counter
from functools import lru_cache
from typing import NamedTuple

from cmr.bus.message import Message
from cmr.bus.messages import RejectedMessage, decode
from cmr.bus.streams import Stream, identify
from cmr.recordings.batch import layout_of

MOST_CHANNELS = 5000  # that are distinguished; a log with more names is a damaged one
FOREIGN_CHANNEL = "unknown_channel"
SHOWN = 5  # names of other channels
OTHERS = "(other channels)"
UTIME = struct.Struct(">q")
UTIME_AT = 8  # bytes: behind the fingerprint; the first field of all our types


class Rejected(Exception):  # noqa: N818 - it is a finding, not a failure of the program
    """A message that cannot be used; `reason` is one of cmr.bus.messages.REASONS."""

    def __init__(self, reason: str) -> None:
        super().__init__(reason)
        self.reason = reason


class Channel(NamedTuple):
    """A channel of ours: its stream, its robot (None: all), and how messages of fixed size lie in their bytes.

    `size` is that of an encoded message [bytes], 0 where it varies; `robot` the bytes that name the robot, which are
    to be at `robot_at`.
    """

    name: str
    stream: Stream[Message]
    robot_id: int | None
    fingerprint: bytes
    size: int
    robot: bytes
    robot_at: int

    def check(self, data: bytes) -> Message | None:
        """Return the message, decoded, where its size varies; None where it does not: then the bytes are as they are.

        Raises Rejected when it cannot be used.
        """
        if self.size == 0:
            try:
                return decode(self.name, data).message
            except RejectedMessage as rejected:
                raise Rejected(rejected.reason) from None
        if not data.startswith(self.fingerprint):
            raise Rejected("foreign")
        if len(data) < self.size:
            raise Rejected("corrupt")
        if not data.startswith(self.robot, self.robot_at):
            raise Rejected("wrong_robot")
        return None


@lru_cache(maxsize=MOST_CHANNELS)
def channel_of(name: str) -> Channel | None:
    """Return the channel of this name, None if it is none of ours."""
    identity = identify(name)
    if identity is None:
        return None
    stream, robot_id = identity
    try:
        layout = layout_of(stream.message_type)
    except TypeError:  # of varying size
        size, robot, robot_at = 0, b"", 0
    else:
        size = layout.itemsize
        robot, robot_at = b"", 0
        if robot_id is not None and layout.fields is not None:
            robot, robot_at = struct.pack(">i", robot_id), layout.fields["robot_id"][1]
    fingerprint = stream.message_type._get_packed_fingerprint()
    return Channel(name, stream, robot_id, fingerprint, size, robot, robot_at)


def utime_of(data: bytes) -> int:
    """Return when a message that was checked was measured or decided [us since the Unix epoch]."""
    utime: int = UTIME.unpack_from(data, UTIME_AT)[0]
    return utime


class LeftOut:
    """Counts by channel and reason the messages that are not taken over."""

    def __init__(self) -> None:
        self._counts: Counter[tuple[str, str]] = Counter()

    def add(self, channel: str, reason: str) -> None:
        """Count a message."""
        key = (channel, reason)
        if key not in self._counts and len(self._counts) >= MOST_CHANNELS:
            key = (OTHERS, reason)
        self._counts[key] += 1

    def sentences(self) -> list[str]:
        """Return the counts in sentences: messages of ours first, then other channels."""
        foreign = sorted(channel for channel, reason in self._counts if reason == FOREIGN_CHANNEL)
        lines = [
            f"{channel}: {count} x {reason}, left out."
            for (channel, reason), count in sorted(self._counts.items())
            if reason != FOREIGN_CHANNEL
        ]
        if foreign:
            count = sum(self._counts[channel, FOREIGN_CHANNEL] for channel in foreign)
            shown = ", ".join(foreign[:SHOWN]) + (f" and {len(foreign) - SHOWN} more" if len(foreign) > SHOWN else "")
            lines.append(f"{count} x a channel that is none of CMR's, left out: {shown}.")
        return lines

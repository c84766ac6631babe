"""How much is said on each channel; nothing is decoded here but the time stamp that all our messages begin with."""

import struct
from collections import deque
from typing import NamedTuple

from cmr.bus.streams import ESTOP, PROCESS_STATUS, WAYPOINTS, identify

WINDOW = 3_000_000  # us over which rates are taken
MARKS_APART = 250_000  # us
GAP = 3.0  # times the usual interval, after which a silence counts as a gap
LEAST_FOR_GAPS = 5  # intervals ...
SETTLED = 500_000  # ... and us, before there is a usual one
LONGEST_INTERVAL = 500_000  # us; slower channels are distinguished from silent ones by their age alone
IRREGULAR = (ESTOP, PROCESS_STATUS, WAYPOINTS)  # said by many processes, or when there is something to say
UTIME = struct.Struct(">8xq")  # of a message [us], after the fingerprint


class Line(NamedTuple):
    """A channel: messages and bytes per second, seconds since the last, gaps, and messages that were not taken.

    `gaps` is None where nothing says how often messages are to come.
    """

    channel: str
    rate: float
    bytes_per_second: float
    age: float
    gaps: int | None
    rejected: int


class _Mark(NamedTuple):
    """How far a channel was when a message arrived [us]; `steps` counts its different time stamps."""

    utime: int
    messages: int
    size: int
    steps: int
    stamp: int


class _Channel:
    __slots__ = ("count", "gaps", "is_regular", "marks", "rejected", "size", "stamp", "steps", "utime")

    def __init__(self, name: str, utime: int) -> None:
        identity = identify(name)
        self.is_regular = identity is not None and identity[0] not in IRREGULAR
        self.utime = utime
        self.count = self.size = self.gaps = self.rejected = self.stamp = self.steps = 0
        self.marks: deque[_Mark] = deque()

    def follow(self, stamp: int) -> None:
        """Take the next time stamp [us]; parts of one message have the same."""
        interval = stamp - self.stamp
        if interval > 0 and self.marks:
            # Over seconds: stamps may come in bunches, and one channel from several senders.
            span, intervals = self.stamp - self.marks[0].stamp, self.steps - self.marks[0].steps
            usual = span / intervals if intervals >= LEAST_FOR_GAPS and span >= SETTLED else 0.0
            self.gaps += 0.0 < usual <= LONGEST_INTERVAL and interval > GAP * usual
            self.steps += 1
        self.stamp = stamp

    def arrive(self, utime: int) -> None:
        """Note that a message has arrived, after it was counted."""
        self.utime = utime
        if not self.marks or utime - self.marks[-1].utime >= MARKS_APART:
            self.marks.append(_Mark(utime, self.count, self.size, self.steps, self.stamp))
            while self.marks[0].utime < utime - WINDOW:
                self.marks.popleft()


class Traffic:
    """Counts the messages of every channel. Times [us] are those of arrival.

    Gaps are those between the messages' own time stamps: they arrive in bursts, as the page listens between pictures.
    """

    def __init__(self) -> None:
        self._channels: dict[str, _Channel] = {}

    def take(self, utime: int, channel: str, data: bytes) -> None:
        """Count a message."""
        state = self._channels.get(channel)
        if state is None:
            state = self._channels[channel] = _Channel(channel, utime)
        if state.is_regular and len(data) >= UTIME.size:
            state.follow(UTIME.unpack_from(data)[0])
        state.count += 1
        state.size += len(data)
        state.arrive(utime)

    def reject(self, channel: str) -> None:
        """Count a message that was not what its channel promises."""
        self._channels[channel].rejected += 1

    def ages(self, now: int) -> list[tuple[str, int]]:
        """Return all channels, by name, with the time since the last message of each [us]."""
        return [(name, now - self._channels[name].utime) for name in sorted(self._channels)]

    def lines(self, now: int) -> list[Line]:
        """Return all channels, by name."""
        return [_line(name, self._channels[name], now) for name in sorted(self._channels)]


def _line(name: str, state: _Channel, now: int) -> Line:
    seen = [mark for mark in state.marks if mark.utime >= now - WINDOW]
    since, count, size = seen[0][:3] if seen else (now, state.count, state.size)
    seconds = max(now - since, 1) / 1e6
    is_new = count == 1 and seconds < 0.5
    rate, flow = (0.0, 0.0) if is_new else ((state.count - count) / seconds, (state.size - size) / seconds)
    gaps = state.gaps if state.is_regular else None
    return Line(name, rate, flow, (now - state.utime) / 1e6, gaps, state.rejected)

"""How much is said on each channel; nothing is decoded here but the time stamp that all our messages begin with."""

import struct
from collections import deque
from typing import NamedTuple

from cmr.bus.streams import ESTOP, PROCESS_STATUS, WAYPOINTS, identify

WINDOW = 3_000_000  # us over which rates are taken
MARKS_APART = 250_000  # us
GAP = 3.0  # times the usual interval, after which a silence counts as a gap
LEAST_FOR_GAPS = 20  # messages, before there is a usual interval
LONGEST_INTERVAL = 500_000  # us; slower channels are told from silent ones by their age alone
WEIGHT = 0.05  # of a new interval in the usual one
IRREGULAR = (ESTOP, PROCESS_STATUS, WAYPOINTS)  # said by many processes, or when there is something to say
UTIME = struct.Struct(">8xq")  # of a message [us], after the fingerprint


class Line(NamedTuple):
    """A channel: messages and bytes per second, seconds since the last, gaps, and messages that were not taken.

    `gaps` is None where nothing tells how often messages are to come.
    """

    channel: str
    rate: float
    bytes_per_second: float
    age: float
    gaps: int | None
    rejected: int


class _Channel:
    __slots__ = ("count", "gaps", "interval", "is_regular", "marks", "rejected", "size", "stamp", "utime")

    def __init__(self, name: str, utime: int) -> None:
        identity = identify(name)
        self.is_regular = identity is not None and identity[0] not in IRREGULAR
        self.utime = utime
        self.count = self.size = self.gaps = self.rejected = self.stamp = 0
        self.interval = 0.0
        self.marks: deque[tuple[int, int, int]] = deque([(utime, 0, 0)])

    def follow(self, stamp: int) -> None:
        """Take the next time stamp [us]; parts of one message have the same."""
        interval = stamp - self.stamp
        self.stamp = stamp
        if interval <= 0 or self.count == 0:
            return
        if interval > GAP * self.interval > 0.0 and self.count > LEAST_FOR_GAPS:
            self.gaps += self.interval <= LONGEST_INTERVAL
        else:
            self.interval += (interval - self.interval) * (WEIGHT if self.interval else 1.0)


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
        state.utime = utime
        state.count += 1
        state.size += len(data)
        if utime - state.marks[-1][0] >= MARKS_APART:
            state.marks.append((utime, state.count, state.size))
            while state.marks[0][0] < utime - WINDOW:
                state.marks.popleft()

    def reject(self, channel: str) -> None:
        """Count a message that was not what its channel promises."""
        self._channels[channel].rejected += 1

    def lines(self, now: int) -> list[Line]:
        """Return all channels, by name."""
        return [_line(name, self._channels[name], now) for name in sorted(self._channels)]


def _line(name: str, state: _Channel, now: int) -> Line:
    since, count, size = next((mark for mark in state.marks if mark[0] >= now - WINDOW), (now, state.count, state.size))
    seconds = max(now - since, 1) / 1e6
    is_new = count == 0 and seconds < 0.5
    rate, flow = (0.0, 0.0) if is_new else ((state.count - count) / seconds, (state.size - size) / seconds)
    gaps = state.gaps if state.is_regular else None
    return Line(name, rate, flow, (now - state.utime) / 1e6, gaps, state.rejected)

"""How much is said on each channel; nothing is decoded here."""

from collections import deque
from typing import NamedTuple

WINDOW = 3_000_000  # us over which rates are taken
MARKS_APART = 250_000  # us
GAP = 3.0  # times the usual interval, after which a silence counts as a gap
LEAST_FOR_GAPS = 20  # messages, before there is a usual interval
LONGEST_INTERVAL = 500_000  # us; slower channels are told from silent ones by their age alone
WEIGHT = 0.05  # of a new interval in the usual one


class Line(NamedTuple):
    """A channel: messages and bytes per second, seconds since the last, gaps, and messages that were not taken."""

    channel: str
    rate: float
    bytes_per_second: float
    age: float
    gaps: int
    rejected: int


class _Channel:
    __slots__ = ("count", "gaps", "interval", "marks", "rejected", "size", "utime")

    def __init__(self, utime: int) -> None:
        self.utime = utime
        self.count = self.size = self.gaps = self.rejected = 0
        self.interval = 0.0
        self.marks: deque[tuple[int, int, int]] = deque([(utime, 0, 0)])


class Traffic:
    """Counts the messages of every channel. Times [us] are those of arrival."""

    def __init__(self) -> None:
        self._channels: dict[str, _Channel] = {}

    def take(self, utime: int, channel: str, size: int) -> None:
        """Count a message of `size` bytes."""
        state = self._channels.get(channel)
        if state is None:
            state = self._channels[channel] = _Channel(utime)
        interval = utime - state.utime
        if interval > GAP * state.interval > 0.0 and state.count > LEAST_FOR_GAPS:
            state.gaps += state.interval <= LONGEST_INTERVAL
        else:
            state.interval += (interval - state.interval) * (WEIGHT if state.interval else 1.0)
        state.utime = utime
        state.count += 1
        state.size += size
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
    return Line(name, rate, flow, (now - state.utime) / 1e6, state.gaps, state.rejected)

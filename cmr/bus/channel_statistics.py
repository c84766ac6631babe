"""Statistics of each channel as messages arrive: bytes, rate, jitter and gaps.

Nothing is decoded here. Rates and jitter are those of the last `window` [us]. They are differences between the sums
over all messages and the sums recorded at a few earlier marks.
"""

import math
from collections import deque
from typing import NamedTuple

from cmr.bus.messages import MICROSECONDS
from cmr.bus.rejections import OTHERS
from cmr.bus.streams import ESTOP, PROCESS_STATUS, WAYPOINTS, identify
from cmr.bus.wire import ROBOT_ID_AT, utime_of

MOST_CHANNELS = 16_384  # counted individually; enough for a thousand robots
GAP_INTERVALS = 3.0  # a silence of more than this many usual intervals is a gap
LEAST_INTERVALS = 2  # the fewest intervals a rate is computed from, however old they are
MARKS_APART_US = 250_000
LEAST_FOR_GAPS = 5  # intervals ...
SETTLED_US = 500_000  # ... and time, before there is a usual one
LONGEST_INTERVAL_US = 500_000  # on slower channels, only the age of the last message shows silence
IRREGULAR = (ESTOP, PROCESS_STATUS, WAYPOINTS)  # sent by many processes, or only on occasion


def per_second(count: int, span_us: int) -> float:
    """Return a rate [1/s] from a count and a time span [us]; NaN for an empty span."""
    return count * MICROSECONDS / span_us if span_us > 0 else math.nan


class Line(NamedTuple):
    """The statistics of a channel at one moment.

    `messages` until now; `rate` [Hz]; `bytes_per_second`; `age` [s] since the last message; `jitter`: standard
    deviation of the time from message to message [s], NaN where there are fewer than three messages; `gaps`: number of
    gaps between the messages' own time stamps, None where the expected rate is unknown; `errors`: rejected messages;
    `data`: the last message, which arrived at `utime` [us].
    """

    channel: str
    messages: int
    rate: float
    bytes_per_second: float
    age: float
    jitter: float
    gaps: int | None
    errors: int
    utime: int
    data: bytes


class _Mark(NamedTuple):
    """The sums of a channel when a message arrived at `utime` [us]; `steps` counts its distinct time stamps."""

    utime: int
    messages: int
    size: int
    squares: int
    steps: int
    stamp: int


class _Channel:
    """Sums over all messages of one channel; the rates follow from the differences to earlier marks."""

    __slots__ = (
        *("data", "errors", "gaps", "is_regular", "marks", "messages", "size", "squares", "stamp", "steps", "utime"),
    )

    def __init__(self, name: str, utime: int) -> None:
        identity = identify(name)
        self.is_regular = identity is not None and identity[0] not in IRREGULAR
        self.messages = self.size = self.squares = self.errors = self.gaps = self.steps = self.stamp = 0
        self.utime = utime
        self.data = b""
        self.marks: deque[_Mark] = deque()

    def arrive(self, utime: int, data: bytes, window: int) -> None:
        """Count a message."""
        if self.is_regular and len(data) >= ROBOT_ID_AT:
            self._follow(utime_of(data))
        interval = utime - self.utime
        self.utime = utime
        self.messages += 1
        self.size += len(data)
        self.squares += interval * interval
        self.data = data
        if not self.marks or utime - self.marks[-1].utime >= MARKS_APART_US:
            if interval > window and self._was_silent(interval):
                self.marks.clear()
            self.marks.append(_Mark(utime, self.messages, self.size, self.squares, self.steps, self.stamp))
            self.forget(utime, window)

    def forget(self, now: int, window: int) -> None:
        """Drop marks older than the window, except the one at its beginning."""
        marks = self.marks
        while (
            len(marks) > 2 and marks[1].utime <= now - window and self.messages - marks[1].messages >= LEAST_INTERVALS
        ):
            marks.popleft()

    def _follow(self, stamp: int) -> None:
        """Update the statistics with the next time stamp [us]; parts of one message share a stamp."""
        interval = stamp - self.stamp
        if interval > 0 and self.marks:
            # Averaged over seconds, because stamps may come in bunches and a channel may have several senders.
            span, intervals = self.stamp - self.marks[0].stamp, self.steps - self.marks[0].steps
            usual = span / intervals if intervals >= LEAST_FOR_GAPS and span >= SETTLED_US else 0.0
            self.gaps += 0.0 < usual <= LONGEST_INTERVAL_US and interval > GAP_INTERVALS * usual
            self.steps += 1
        self.stamp = stamp

    def _was_silent(self, interval: int) -> bool:
        """Return whether the interval before the last message [us] was a silence; rates are then computed from after
        it.
        """
        first = self.marks[0]
        intervals = self.messages - 1 - first.messages
        return bool(intervals) and interval > GAP_INTERVALS * (self.utime - interval - first.utime) / intervals


class ChannelStatistics:
    """Counts messages as they arrive; `lines` returns the state of all channels.

    Rates are those of the last `window` [us], and of the last two intervals at least.
    """

    def __init__(self, window: int) -> None:
        self._window = window
        self._channels: dict[str, _Channel] = {}

    def take(self, utime: int, channel: str, data: bytes) -> None:
        """Count a message that arrived at `utime` [us]."""
        state = self._channels.get(channel)
        if state is None:
            state = self._new(channel, utime)
        state.arrive(utime, data, self._window)

    def _new(self, channel: str, utime: int) -> _Channel:
        """Return the state of a new channel, or the shared state of all channels beyond the limit."""
        name = channel if len(self._channels) < MOST_CHANNELS else OTHERS
        return self._channels.setdefault(name, _Channel(name, utime))

    def reject(self, channel: str) -> None:
        """Count the last message of a channel as an error."""
        self._channels[channel if channel in self._channels else OTHERS].errors += 1

    def ages(self, now: int) -> list[tuple[str, int]]:
        """Return all channels, by name, with the time since the last message of each [us]."""
        return [(name, now - self._channels[name].utime) for name in sorted(self._channels)]

    def lines(self, now: int) -> list[Line]:
        """Return all channels, by name, as they are at `now` [us]."""
        return [_line(name, self._channels[name], now, self._window) for name in sorted(self._channels)]


def _line(name: str, state: _Channel, now: int, window: int) -> Line:
    state.forget(now, window)
    first = state.marks[0]
    intervals, span = state.messages - first.messages, state.utime - first.utime  # us, of that many intervals
    mean = span / intervals if intervals else 0.0
    variance = (state.squares - first.squares) / intervals - mean * mean if intervals > 1 else math.nan
    age = now - state.utime
    if age > max(window, GAP_INTERVALS * mean):
        intervals = 0
    elif age > 2.0 * mean:  # it has become slower
        span = now - first.utime
    size = state.size - first.size if intervals else 0
    return Line(
        channel=name,
        messages=state.messages,
        rate=per_second(intervals, max(span, 1)),
        bytes_per_second=per_second(size, max(span, 1)),
        age=age / MICROSECONDS,
        jitter=math.sqrt(max(variance, 0.0)) / MICROSECONDS,
        gaps=state.gaps if state.is_regular else None,
        errors=state.errors,
        utime=state.utime,
        data=state.data,
    )

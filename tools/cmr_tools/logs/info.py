"""Contents and health of an event log: numbers for each channel, computed with little memory."""

from array import array
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cmr.bus.channel_statistics import GAP_INTERVALS, per_second
from cmr.bus.message import Message
from cmr.bus.messages import MICROSECONDS, RejectedMessage
from cmr.bus.streams import ESTOP, Stream
from cmr.bus.wire import MOST_CHANNELS, Channel, channel_of, utime_of
from cmr.recordings.events import Event
from cmr.recordings.log_clock import seconds_since
from cmr_tools.logs.channels import OTHERS

BATCH = 1024  # times processed together
BINS_PER_DOUBLING = 16
DOUBLINGS = 48  # from 1 us to nine years


@dataclass(frozen=True)
class Rhythm:
    """Regularity of a channel's messages.

    `gaps` counts intervals longer than three usual ones; `longest` [s] is the longest interval and `longest_at` [us]
    when it began; `jitter` [s] is the standard deviation of the intervals that are no gaps, NaN if no regular interval
    is expected.
    """

    gaps: int
    longest: float
    longest_at: int
    jitter: float


class Intervals:
    """The intervals between times, stored as a histogram with bins 4 % wide."""

    def __init__(self) -> None:
        self._times = array("q")
        self._last: int | None = None
        self._counts = np.zeros(0, np.int64)
        self._sums = np.zeros(0)
        self._squares = np.zeros(0)
        self._longest = (0, 0)  # duration [us], start [us]

    def add(self, utime: int) -> None:
        """Add the next time [us]."""
        self._times.append(utime)
        if len(self._times) >= BATCH:
            self._gather()

    def rhythm(self, expected: float | None) -> Rhythm | None:
        """Return the regularity of the intervals, None if there are fewer than two.

        `expected` [us] is the usual interval of a channel that several senders share; None stands for the median.
        """
        self._gather()
        total = int(self._counts.sum())
        if total < 2:
            return None
        is_shared = expected is not None
        if expected is None:
            middle = int(np.searchsorted(np.cumsum(self._counts), (total + 1) // 2))
            expected = float(self._sums[middle] / self._counts[middle])
        filled = self._counts > 0
        means = np.divide(self._sums, self._counts, out=np.zeros_like(self._sums), where=filled)
        usual = filled & (means <= max(GAP_INTERVALS * expected, 1.0))
        longest, since = self._longest
        gaps = int(self._counts[filled & ~usual].sum())
        jitter = np.nan if is_shared else self._deviation(usual) / MICROSECONDS
        return Rhythm(gaps, longest / MICROSECONDS, since, jitter)

    def _deviation(self, chosen: NDArray[np.bool_]) -> float:
        """Return the standard deviation of the intervals in these bins [us]."""
        count = int(self._counts[chosen].sum())
        if count == 0:
            return 0.0
        mean = float(self._sums[chosen].sum()) / count
        squares = self._squares[chosen] - mean * (2.0 * self._sums[chosen] - mean * self._counts[chosen])
        return float(np.sqrt(max(float(squares.sum()) / count, 0.0)))

    def _gather(self) -> None:
        """Add the intervals between the times received since to the histogram; a clock set back adds none."""
        times = np.array(self._times, np.int64)
        self._times = array("q")
        if self._last is not None:
            times = np.concatenate([[self._last], times])
        if len(times) == 0:
            return
        self._last = int(times[-1])
        intervals = np.diff(times).astype(np.float64)
        since = times[:-1][intervals >= 0.0]
        intervals = intervals[intervals >= 0.0]
        if len(intervals) == 0:
            return
        if len(self._counts) == 0:
            self._counts = np.zeros(BINS_PER_DOUBLING * DOUBLINGS, np.int64)
            self._sums, self._squares = np.zeros(len(self._counts)), np.zeros(len(self._counts))
        bins = (BINS_PER_DOUBLING * np.log2(np.maximum(intervals, 1.0))).astype(np.int64).clip(0, len(self._counts) - 1)
        self._counts += np.bincount(bins, minlength=len(self._counts))
        self._sums += np.bincount(bins, intervals, len(self._counts))
        self._squares += np.bincount(bins, intervals * intervals, len(self._counts))
        longest = int(intervals.argmax())
        self._longest = max(self._longest, (int(intervals[longest]), int(since[longest])), key=lambda pair: pair[0])


class ChannelHealth:
    """Health of one channel.

    `late` counts messages that were logged, or of a robot's channel measured, before the one ahead of them;
    `rejected` counts by reason messages that cannot be decoded.
    """

    def __init__(self, channel: Channel | None) -> None:
        self.channel = channel
        self.count = 0
        self.bytes = 0
        self.late = 0
        self.rejected: Counter[str] = Counter()
        self.first = self.last = 0
        self._newest: int | None = None
        self._intervals = Intervals()

    def take(self, event: Event) -> None:
        """Process the next event of the channel."""
        if self.count == 0:
            self.first = event.utime
        self.count += 1
        self.bytes += len(event.data)
        self.last = event.utime
        self._intervals.add(event.utime)
        moment = event.utime
        if self.channel is not None:
            try:
                self.channel.check(event.data)
            except RejectedMessage as rejected:
                self.rejected[rejected.reason] += 1
                return
            if self.channel.robot_id is not None:
                moment = utime_of(event.data)
        if self._newest is not None and moment < self._newest:
            self.late += 1
        self._newest = moment

    @property
    def type_name(self) -> str:
        """Name of the message type; ? for channels that are not CMR's."""
        name: str = "?" if self.channel is None else self.channel.stream.message_type.__name__
        return name

    @property
    def rate(self) -> float:
        """Messages per second from the first to the last; NaN for a single one."""
        return per_second(self.count - 1, self.last - self.first)

    def rhythm(self) -> Rhythm | None:
        """Return how evenly the messages came; None for messages sent only on occasion.

        A channel shared by several processes has no usual interval, only a longest allowed one.
        """
        stream: Stream[Message] | None = None if self.channel is None else self.channel.stream
        if stream is None:
            return self._intervals.rhythm(None)
        if stream.rate_hz is None or stream is ESTOP:
            return None
        if stream.per_robot:
            return self._intervals.rhythm(None)
        return self._intervals.rhythm(MICROSECONDS / stream.rate_hz)


class LogHealth:
    """Health of a log: `channels` by name, the log's first, earliest and latest time [us], the number of events."""

    def __init__(self) -> None:
        self.channels: dict[str, ChannelHealth] = {}
        self.first = self.latest = 0
        self.count = 0

    def seconds(self, utime: int) -> float:
        """Return a time [s] relative to the log's first event."""
        return seconds_since(self.first, utime)

    def take_all(self, events: Iterable[Event]) -> None:
        """Process the events of a log."""
        for event in events:
            health = self.channels.get(event.channel)
            if health is None:
                health = self._new(event.channel)
            health.take(event)
            if self.count == 0:
                self.first = self.latest = event.utime
            self.count += 1
            if event.utime > self.latest:
                self.latest = event.utime

    def _new(self, name: str) -> ChannelHealth:
        if len(self.channels) >= MOST_CHANNELS:
            name = OTHERS
        return self.channels.setdefault(name, ChannelHealth(channel_of(name)))

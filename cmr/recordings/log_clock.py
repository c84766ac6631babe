"""The clock of a log: a monotonic time at which each event was logged.

Each event has two times. Its stamp is when the logger wrote it; `utime` in its message is when it was measured or
decided. Replay, the view and `cmr-log` use the first, to show what happened on the bus. Recordings and curves use the
second, to show what a robot did. The stamps come from a computer's clock, which may be set during logging: replay and
the view then do not advance time (`LogClock`), while `cmr-log` shows and cuts the stamps as they are. Seconds of a log
count from its first stamp.
"""

from bisect import bisect_left
from collections.abc import Iterable, Iterator
from typing import NamedTuple

from cmr.bus.messages import MICROSECONDS
from cmr.recordings.events import Event, EventReader

LARGEST_DISORDER_US = 1_000_000  # a larger step back in logging time means that the clock was set back
LONGEST_SILENCE_US = 86_400_000_000  # a day: after a longer one the clock was set
CHECKPOINTS_APART_US = 1_000_000
LATEST_UTIME = 7_258_118_400_000_000  # the year 2200: a later time is damaged
# Largest delay between a message's `utime` and its stamp; beyond, one of the clocks is wrong.
LARGEST_DELAY_US = 1_000_000
TAIL = 1 << 20  # bytes at the end of a log in which its last message is searched


class LogClock:
    """The log's own time [us]: as logged, but monotonic, without jumps when the logger's clock was set.

    It begins at the first event's time stamp. `utime` is the time of the latest event, None before the first; `latest`
    is the stamp that the next step is measured from.
    """

    def __init__(self, utime: int | None = None, latest: int | None = None) -> None:
        self.utime = utime
        self.latest = latest

    def advance(self, stamp: int) -> int:
        """Return the log's own time of the next event, with this time stamp [us]."""
        if self.utime is None or self.latest is None:
            self.utime = self.latest = stamp
        step = stamp - self.latest
        if step > 0 or step < -LARGEST_DISORDER_US:
            self.latest = stamp
        if 0 < step <= LONGEST_SILENCE_US:
            self.utime += step
        return self.utime


def seconds_since(first: int, utime: int) -> float:
    """Return the time from a log's first stamp to another time, both [us]. [s]"""
    return (utime - first) / MICROSECONDS


def utime_after(first: int, seconds: float) -> int:
    """Return the time [us] this many seconds after a log's first stamp [us]."""
    return first + round(seconds * MICROSECONDS)


def measured_at(moment: int, stamp: int, utime: int) -> int:
    """Return when a message was measured, by the clock of its `moment` of logging or arrival; all in [us].

    It precedes `moment` by as much as its `utime` precedes the logger's `stamp`; if those clocks differ, it is
    `moment`.
    """
    return moment + utime - stamp if abs(utime - stamp) <= LARGEST_DELAY_US else moment


def span_of(log: EventReader) -> tuple[int, int | None]:
    """Return the stamps [us] of a log's first and last event, from these alone: 0 and 0 for an empty log.

    The last is None if it cannot be found without reading everything: the end is damaged, or the clock was set.
    """
    first = next((event.utime for event in log.read()), None)
    if first is None:
        return 0, 0
    last = max((event.utime for event in log.read(max(log.size - TAIL, 0))), default=None)
    return first, last if last is not None and 0 <= last - first <= LONGEST_SILENCE_US else None


class Checkpoint(NamedTuple):
    """A position in the file [bytes] at which reading can start, with the log's clock there, None if unknown."""

    offset: int = 0
    utime: int | None = None
    latest: int | None = None

    def moments(self, events: Iterable[Event]) -> Iterator[tuple[int, Event]]:
        """Yield the events that begin here with their moments in the log's own time [us]."""
        clock = LogClock(self.utime, self.latest)
        return ((clock.advance(event.utime), event) for event in events)


class Checkpoints:
    """Positions in a log that has been read, a second apart, so that seeking needs little reading."""

    def __init__(self) -> None:
        self._known: list[Checkpoint] = []
        self._due = 0  # us

    @property
    def last_offset(self) -> int:
        """The file offset [bytes] of the last checkpoint, 0 without any."""
        return self._known[-1].offset if self._known else 0

    def pass_by(self, clock: LogClock, offset: int) -> None:
        """Keep the position of an event if it is far enough after the last; the clock has not seen it yet."""
        if not self._known or (clock.utime is not None and clock.utime >= self._due):
            self._known.append(Checkpoint(offset, clock.utime, clock.latest))
            self._due = (clock.utime or 0) + CHECKPOINTS_APART_US

    def before(self, utime: float) -> Checkpoint:
        """Return the last position before all events at or after a time [us of the log's own time]."""
        at = bisect_left(self._known, utime, key=lambda checkpoint: checkpoint.utime or 0)
        return self._known[max(at - 1, 0)] if self._known else Checkpoint()

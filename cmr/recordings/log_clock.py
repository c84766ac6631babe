"""The clock of a log: when each event was logged, by a time that never goes back.

Each event has two times. Its own stamp says when the logger wrote it; `utime` in its message says when that was
measured or decided. Replay, the view and `cmr-log` go by the first: they show what happened on the bus. Recordings
and curves go by the second: they show what a robot did. The stamps come from the clock of a computer, which may be set
while it logs: replay and the view let no time pass then (`LogClock`), while `cmr-log` shows and cuts the stamps as they
are. Seconds of a log are counted from its first stamp.
"""

from bisect import bisect_left
from collections.abc import Iterable, Iterator
from typing import NamedTuple

from cmr.bus.messages import MICROSECONDS
from cmr.recordings.events import Event, EventReader

LARGEST_DISORDER_US = 1_000_000  # what was logged with an earlier time than that before it: its clock was set back
LONGEST_SILENCE_US = 86_400_000_000  # a day: after a longer one the clock was set
CHECKPOINTS_APART_US = 1_000_000
LATEST_UTIME = 7_258_118_400_000_000  # the year 2200: a later time is a damaged one
LARGEST_DELAY_US = 1_000_000  # between a message's `utime` and its stamp; with more one of the clocks is wrong
TAIL = 1 << 20  # bytes at the end of a log in which its last message is looked for


class LogClock:
    """The log's own time [us]: as logged, but it never goes back, and does not jump where the logger's clock was set.

    It begins at the first event's time stamp. `utime` is the time of the latest event, None before the first; `latest`
    the stamp from which the next step of time is counted.
    """

    def __init__(self, utime: int | None = None, latest: int | None = None) -> None:
        self.utime = utime
        self.latest = latest

    def advance(self, stamp: int) -> int:
        """Return the log's own time of an event with this time stamp [us], the next one of the log."""
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
    """Return the time [us] so long after a log's first stamp [us]."""
    return first + round(seconds * MICROSECONDS)


def measured_at(moment: int, stamp: int, utime: int) -> int:
    """Return when a message was measured, by the clock of `moment`, when it was logged or arrived; all in [us].

    That is as long before as its `utime` is before the logger's `stamp`; where these two clocks differ, the moment.
    """
    return moment + utime - stamp if abs(utime - stamp) <= LARGEST_DELAY_US else moment


def span_of(log: EventReader) -> tuple[int, int | None]:
    """Return the stamps [us] of a log's first and last event, from these alone: 0 and 0 of an empty log.

    The last is None where it is not known without reading all: the end is damaged, or the clock was set.
    """
    first = next((event.utime for event in log.read()), None)
    if first is None:
        return 0, 0
    last = max((event.utime for event in log.read(max(log.size - TAIL, 0))), default=None)
    return first, last if last is not None and 0 <= last - first <= LONGEST_SILENCE_US else None


class Checkpoint(NamedTuple):
    """A place in the file [bytes] where reading can begin, and the log's clock there: None where it is not known."""

    offset: int = 0
    utime: int | None = None
    latest: int | None = None

    def moments(self, events: Iterable[Event]) -> Iterator[tuple[int, Event]]:
        """Yield the events that begin here with their moments in the log's own time [us]."""
        clock = LogClock(self.utime, self.latest)
        return ((clock.advance(event.utime), event) for event in events)


class Checkpoints:
    """Places of a log that has been read, a second apart, so that to go to a moment reads little."""

    def __init__(self) -> None:
        self._known: list[Checkpoint] = []
        self._due = 0  # us

    @property
    def last_offset(self) -> int:
        """Where the last of them is in the file [bytes], 0 without any."""
        return self._known[-1].offset if self._known else 0

    def pass_by(self, clock: LogClock, offset: int) -> None:
        """Keep a place where an event begins, if it is far enough behind the last; the clock has not seen it yet."""
        if not self._known or (clock.utime is not None and clock.utime >= self._due):
            self._known.append(Checkpoint(offset, clock.utime, clock.latest))
            self._due = (clock.utime or 0) + CHECKPOINTS_APART_US

    def before(self, utime: float) -> Checkpoint:
        """Return the last place behind which are all events at or after a moment [us of the log's own time]."""
        at = bisect_left(self._known, utime, key=lambda checkpoint: checkpoint.utime or 0)
        return self._known[max(at - 1, 0)] if self._known else Checkpoint()

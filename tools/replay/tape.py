"""A log as a tape: messages from any moment on, with a time that never goes back."""

from bisect import bisect_left
from collections.abc import Iterator
from typing import NamedTuple

from cmr.recordings.events import Event, EventReader

MICROSECONDS = 1e6
LARGEST_DISORDER = 1_000_000  # us; what was logged with an earlier time than that before it: its clock was set back
LONGEST_SILENCE = 86_400_000_000  # us; a day: after a longer one the clock was set
BETWEEN_MARKS = 1_000_000  # us
TAIL = 1 << 20  # bytes at the end of a log in which its last message is looked for


class Mark(NamedTuple):
    """A place to begin reading: the time there [us], the latest time stamp before it, the place in the file [bytes]."""

    elapsed: int
    latest_utime: int | None
    offset: int


class LogTape:
    """An event log; time runs from its first message [s].

    Where the clock of the logger was set, forward by more than a day or back by more than a second, no time passes.
    Places once read are remembered, so that to jump back reads little.
    """

    def __init__(self, log: EventReader) -> None:
        self._log = log
        self._marks: list[Mark] = []

    def read(self, begin: float) -> Iterator[tuple[float, Event]]:
        """Yield the intact messages from `begin` [s] on with their moments."""
        elapsed, latest, offset = self._mark_before(begin)
        for event in self._log.read(offset):
            latest = event.utime if latest is None else latest
            if not self._marks or elapsed >= self._marks[-1].elapsed + BETWEEN_MARKS:
                self._marks.append(Mark(elapsed, latest, offset))
            step = event.utime - latest
            if step > 0 or step < -LARGEST_DISORDER:
                latest = event.utime
            if 0 < step <= LONGEST_SILENCE:
                elapsed += step
            offset = self._log.position
            if elapsed / MICROSECONDS >= begin:
                yield elapsed / MICROSECONDS, event

    def duration(self) -> float | None:
        """Return how long the log is [s], from its first and last message alone; None where they do not show it."""
        first = next((event.utime for event in self._log.read()), 0)
        last = max((event.utime for event in self._log.read(max(self._log.size - TAIL, 0))), default=0)
        return (last - first) / MICROSECONDS if 0 <= last - first <= LONGEST_SILENCE else None

    def _mark_before(self, begin: float) -> Mark:
        index = bisect_left(self._marks, begin * MICROSECONDS, key=lambda mark: mark.elapsed)
        return self._marks[max(index - 1, 0)] if self._marks else Mark(0, None, 0)

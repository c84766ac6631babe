"""A log as a tape: messages from any time on, with a time that never decreases."""

from collections.abc import Iterator

from cmr.bus.messages import MICROSECONDS
from cmr.recordings.events import Event, EventReader
from cmr.recordings.log_clock import Checkpoints, LogClock, seconds_since, span_of


class LogTape:
    """An event log; time runs from its first message [s].

    When the logger's clock was set, forward by more than a day or back by more than a second, no time passes. Positions
    once read are stored, so that jumping back reads little.
    """

    def __init__(self, log: EventReader) -> None:
        self._log = log
        self._first, self._last = span_of(log)
        self._checkpoints = Checkpoints()

    def duration(self) -> float | None:
        """Return how long the log is [s], from its first and last message alone; None where they do not show it."""
        return None if self._last is None else seconds_since(self._first, self._last)

    def read(self, begin: float) -> Iterator[tuple[float, Event]]:
        """Yield the intact messages from `begin` [s] on with their times."""
        start = self._checkpoints.before(self._first + begin * MICROSECONDS)
        clock, offset = LogClock(start.utime, start.latest), start.offset
        for event in self._log.read(offset):
            self._checkpoints.pass_by(clock, offset)
            moment = seconds_since(self._first, clock.advance(event.utime))
            offset = self._log.position
            if moment >= begin:
                yield moment, event

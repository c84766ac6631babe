"""Plays a log: the state at any moment of it, forward at any speed, and jumps."""

import time
from collections.abc import Iterator

from cmr.bus.messages import RejectedMessage, decode
from cmr.bus.streams import CALIBRATION_STATUS, CAMERA_IMAGE, PROCESS_STATUS, WORLD_STATE, identify
from cmr.recordings.events import Event
from cmr.view.drives import LONGEST
from cmr.view.intake import Intake
from cmr.view.log_index import LogIndex, Place
from cmr.view.state import ViewState

LONGEST_WORK = 0.04  # s of reading in one go
BETWEEN_FLUSHES = 250_000  # us of the log, so that trails have all their points at high speed
DRIVE_APART = 400_000  # us between the messages that are read again of a drive long ago
DRIVE_BEGINS = 1_000_000  # us before cmr-calibrate has told that the robot moves
RUN_UP = 1_000_000  # us before the moment jumped to that are read whole, for rates
HISTORY = {
    WORLD_STATE.name: 60.0,
    PROCESS_STATUS.name: 3.0,
    CAMERA_IMAGE.name: 2.0,
    CALIBRATION_STATUS.name: 3600.0,
}  # s
MOST_OF_HISTORY = 400  # messages of a channel that are read again
EVENTS_BETWEEN_LOOKS = 200  # at the clock


class Playback:
    """The log of an index as `state`, at `position` [us of the log's own time], `speed` times as fast as it was."""

    def __init__(self, index: LogIndex) -> None:
        self.index = index
        self.state = ViewState()
        self.position = index.begin
        self.speed = 1.0
        self.paused = False
        self._intake = Intake(self.state)
        self._events: Iterator[tuple[int, Event]] = index.read(index.begin)
        self._next: tuple[int, Event] | None = None

    @property
    def at_end(self) -> bool:
        """Whether all has been played."""
        return self._look() is None

    def play(self, seconds: float) -> None:
        """Let that much time pass; more than can be read at once is left for later."""
        if not self.paused:
            self._read_until(self.position + int(seconds * self.speed * 1e6), time.monotonic() + LONGEST_WORK)

    def jump(self, utime: int) -> None:
        """Show this moment; of what the index does not know yet, its latest."""
        utime = max(min(utime, self.index.indexed_until), self.index.begin)
        run_up = max(utime - RUN_UP, self.index.begin)
        self.state = ViewState()
        self._intake = Intake(self.state)
        for moment, event in self.index.events_at(self._history(run_up)):
            self._show(moment, event)
        self.position = run_up
        self._events = self.index.read(run_up)
        self._next = None
        self._read_until(utime, None)

    def _read_until(self, utime: int, enough: float | None) -> None:
        """Take what was logged until this moment, at most until `enough` of the monotonic clock [s]."""
        flushed = self.position
        count = 0
        while (found := self._look()) is not None and found[0] <= utime:
            moment, event = found
            self._next = None
            self._intake.take(moment, event.channel, event.data)
            if moment - flushed >= BETWEEN_FLUSHES:
                flushed = moment
                self._flush(moment)
            count += 1
            if enough is not None and not count % EVENTS_BETWEEN_LOOKS and time.monotonic() > enough:
                utime = moment
        self.position = utime if found is not None else min(utime, max(self.index.end, self.position))
        self._flush(self.position)

    def _flush(self, now: int) -> None:
        self._intake.flush()
        self.state.advance(now)

    def _look(self) -> tuple[int, Event] | None:
        if self._next is None:
            self._next = next(self._events, None)
        return self._next

    def _history(self, utime: int) -> list[Place]:
        """Return what of the past is still to be seen at a moment, oldest first."""
        places: list[Place] = []
        for channel in self.index.places:
            identity = identify(channel)
            seconds = HISTORY.get(identity[0].name, 0.0) if identity else 0.0
            found = self.index.last_before(channel, utime, seconds)
            step = 1 if channel == WORLD_STATE.name else -(-len(found) // MOST_OF_HISTORY) or 1
            places += found[::-1][::step]
        return sorted({*places, *self._drives(utime)}, key=lambda place: place.offset)

    def _drives(self, utime: int) -> Iterator[Place]:
        """Yield what tells of the drive of the last calibration before a moment, and of the one after it."""
        last = next((drive for drive in reversed(self.index.drives) if drive.end <= utime), None)
        if last is None or WORLD_STATE.name not in self.index.places:
            return
        known = utime - int(HISTORY[WORLD_STATE.name] * 1e6)  # what came since is read anyway
        for begin, end in ((last.begin - DRIVE_BEGINS, last.end), (last.end, last.end + LONGEST)):
            end = min(end, begin + LONGEST, known)
            yield from self.index.between(WORLD_STATE.name, begin, end, DRIVE_APART)

    def _show(self, moment: int, event: Event) -> None:
        try:
            message = decode(event.channel, event.data).message
        except RejectedMessage:
            return
        self.state.handle(moment, event.channel, message)
        if event.channel == WORLD_STATE.name:
            self.state.advance(moment)

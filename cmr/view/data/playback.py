"""Play a log: the state at any time, at any speed, with seeking."""

import time
from bisect import bisect_left
from collections import Counter
from collections.abc import Iterator

from cmr.bus.messages import RejectedMessage, decode
from cmr.bus.streams import (
    CALIBRATION_STATUS,
    CAMERA_IMAGE,
    INVESTIGATION_STATUS,
    PARAMETERS,
    PROCESS_STATUS,
    WORLD_STATE,
    identify,
)
from cmr.recordings.events import Event
from cmr.view.data.intake import Intake
from cmr.view.data.log_drives import PARTS_WITHIN
from cmr.view.data.log_index import LogIndex, Place
from cmr.view.data.state import RATE_WINDOW, ViewState

LONGEST_WORK = 0.04  # s of reading at once
BETWEEN_FLUSHES = 250_000  # us of the log, so that trails are complete at high speed
RUN_UP = RATE_WINDOW  # us before a seek target that are read completely, for rates
WORLDS_KEPT = 60_000_000  # us before that, of which trails, paths and distances are drawn ...
WORLDS_APART = 400_000  # ... from WORLD_STATEs that are so far apart [us], at least ...
RECENT = 12_000_000  # us; ... and from all that are remembered of this time, so that trails are smooth
# s before a time for which messages of each stream are shown
HISTORY = {
    PROCESS_STATUS.name: 3.0,
    CAMERA_IMAGE.name: 2.0,
    CALIBRATION_STATUS.name: 3600.0,
    INVESTIGATION_STATUS.name: 30.0,
    PARAMETERS.name: 3.0,
}
MOST_OF_HISTORY = 400  # messages of a stream that are read again, all its channels together; but ...
LEAST_OF_HISTORY = 40  # ... of each channel
EVENTS_BETWEEN_LOOKS = 200  # at the clock


class Playback:
    """The log of an index as `state`, at `position` [us of the log's own time], played at `speed` times real time.

    `is_guess` says that the log has not been read that far yet, so earlier information may be missing.
    """

    def __init__(self, index: LogIndex) -> None:
        self.index = index
        self.state = ViewState()
        self.position = index.begin
        self.speed = 1.0
        self.paused = False
        self.is_guess = False
        self._world_begun = 0  # when the first part of the last WORLD_STATE that was remembered came [us]
        self._intake = Intake(self.state)
        self._events: Iterator[tuple[int, Event]] = index.read(index.begin)
        self._next: tuple[int, Event] | None = None

    @property
    def at_end(self) -> bool:
        """Whether everything has been played."""
        return self._look() is None

    def play(self, seconds: float) -> None:
        """Advance by this time; what cannot be read at once is left for later."""
        if self.is_guess and (self.index.complete or self.index.indexed_until >= self.position):
            self.jump(self.position)  # again, now with the full history
        if not self.paused:
            self._read_until(self.position + int(seconds * self.speed * 1e6), time.monotonic() + LONGEST_WORK)

    def jump(self, utime: int) -> None:
        """Show this time; in unread parts of the log, without older history."""
        utime = max(min(utime, max(self.index.end, self.index.indexed_until)), self.index.begin)
        self.is_guess = utime > self.index.indexed_until
        run_up = max(utime - RUN_UP, self.index.begin)
        self.state = ViewState()
        self._world_begun = 0
        if not self.is_guess:
            self._remember(run_up)
        self._intake = Intake(self.state)
        self.position = run_up
        self._events = self.index.read(run_up)
        self._next = None
        self._read_until(utime, None)

    def _read_until(self, utime: int, enough: float | None) -> None:
        """Process the log until this time, but not beyond `enough` of the monotonic clock [s]."""
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

    def _remember(self, utime: int) -> None:
        """Restore the state at a time, from the index."""
        since = utime - WORLDS_KEPT
        places = self._history(since, utime)
        first = bisect_left(places, since, key=lambda place: place.utime)
        for moment, event in self.index.events_at(places[:first]):
            self._show(moment, event)
        self.state.drives = self.index.calibrations.drives(since)
        for moment, event in self.index.events_at(places[first:]):
            self._show(moment, event)
        self._end_world()

    def _history(self, since: int, utime: int) -> list[Place]:
        """Return the past messages still visible at a time, oldest first."""
        places: list[Place] = []
        streams = {channel: (identify(channel) or (None,))[0] for channel in self.index.places}
        channels_of = Counter(streams.values())
        for channel, stream in streams.items():
            if stream is WORLD_STATE:
                recent = utime - RECENT
                places += self.index.between(channel, since, recent - 1, WORLDS_APART)
                places += self.index.between(channel, recent, utime, 0)
            else:
                found = self.index.last_before(channel, utime, HISTORY.get(stream.name, 0.0) if stream else 0.0)
                most = max(MOST_OF_HISTORY // channels_of[stream], LEAST_OF_HISTORY)
                places += found[:: -max(-(-len(found) // most), 1)]
        return sorted(places, key=lambda place: place.offset)

    def _show(self, moment: int, event: Event) -> None:
        try:
            received = decode(event.channel, event.data)
        except RejectedMessage:
            return
        if received.stream is WORLD_STATE and moment - self._world_begun > PARTS_WITHIN:
            self._end_world()
            self._world_begun = moment
        self.state.handle(moment, event.channel, received.message)

    def _end_world(self) -> None:
        """Advance time to the last WORLD_STATE whose parts are complete."""
        if self._world_begun:
            self.state.advance(self._world_begun)

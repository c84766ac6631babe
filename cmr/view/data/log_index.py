"""Index of a log, built once, to show any time without reading everything before."""

import os
import time
from array import array
from bisect import bisect_left, bisect_right
from collections.abc import Iterable, Iterator
from typing import NamedTuple

from cmr.bus.message import Message
from cmr.bus.messages import MICROSECONDS, RejectedMessage, decode
from cmr.bus.streams import (
    CALIBRATION_STATUS,
    ESTOP,
    INVESTIGATION_STATUS,
    PARAMETERS,
    PROCESS_STATUS,
    SELF_TESTS,
    WAYPOINTS,
    WORLD_STATE,
    identify,
)
from cmr.msg import calibration_status_t, estop_t, parameters_t, process_status_t
from cmr.parameters.versions import Versions
from cmr.recordings.events import CHUNK, HEADER, Event, EventReader
from cmr.recordings.log_clock import Checkpoint, Checkpoints, LogClock, seconds_since, span_of, utime_after
from cmr.view.data.drives import Calibrations
from cmr.view.data.log_drives import PARTS_WITHIN, DriveWatch
from cmr.view.data.state import DIAGNOSIS

PLACES_APART = 250_000  # us between the indexed messages of a channel
ALL_REMEMBERED = {
    stream.name for stream in (PROCESS_STATUS, ESTOP, CALIBRATION_STATUS, INVESTIGATION_STATUS, PARAMETERS, WAYPOINTS)
}
EVENTS_BETWEEN_LOOKS = 2000  # at the clock
UTIME_BYTES = slice(8, 16)  # of a message, after the fingerprint


class Mark(NamedTuple):
    """An event: its time [us of the log's own time], kind, and sentence."""

    utime: int
    word: str
    sentence: str


class Place(NamedTuple):
    """A message in a log: its time [us of the log's own time], and its offset in the file."""

    utime: int
    offset: int


class LogIndex:
    """The index of the log of `reader`; `build` continues reading.

    `begin` and `end` [us of the log's own time] are available at once, from the first and last messages; `end` is
    corrected while reading. `marks` are the events so far. Raises OSError.
    """

    def __init__(self, reader: EventReader) -> None:
        self.reader = reader
        self.begin, end = span_of(reader)
        self.end = self.begin if end is None else end
        self.indexed_until = self.begin
        self.complete = False
        self.marks: list[Mark] = []
        self.places: dict[str, tuple[array[int], array[int]]] = {}
        self._checkpoints = Checkpoints()
        self._due: dict[str, int] = {}  # when a channel's next message is to be indexed
        self._parts_until: dict[str, int] = {}  # until when it may be part of the last one indexed
        self._watch = _Watch(self.marks)
        self._drive_watch = DriveWatch()
        self._reading = self._read()

    @property
    def calibrations(self) -> Calibrations:
        """Courses of robots around the calibrations so far."""
        return self._drive_watch.calibrations

    @property
    def progress(self) -> float:
        """How much of the log has been read. [0 to 1]"""
        return 1.0 if self.complete or not self.reader.size else self.reader.position / self.reader.size

    def seconds(self, utime: int) -> float:
        """Return a time in seconds since the log's beginning."""
        return seconds_since(self.begin, utime)

    def moment(self, seconds: float) -> int:
        """Return the log's own time [us] at these seconds since its beginning."""
        return utime_after(self.begin, seconds)

    def build(self, seconds: float) -> bool:
        """Continue reading for some time; return whether all has been read."""
        enough = time.monotonic() + seconds
        while not self.complete and time.monotonic() < enough:
            self.complete = next(self._reading, None) is None
        return self.complete

    def last_before(self, channel: str, utime: int, seconds: float = 0.0) -> list[Place]:
        """Return the last indexed message of a channel at or before a time, and those up to `seconds` before."""
        times, offsets = self.places[channel]
        last = bisect_right(times, utime)
        first = min(bisect_right(times, utime - int(seconds * MICROSECONDS)), max(last - 1, 0))
        return [Place(times[k], offsets[k]) for k in range(first, last)]

    def between(self, channel: str, begin: int, end: int, apart: int) -> Iterator[Place]:
        """Yield indexed messages of a channel in a time span, at least `apart` [us] apart, with all parts."""
        times, offsets = self.places[channel]
        latest = begin - apart
        for k in range(bisect_left(times, begin), bisect_right(times, end)):
            latest = times[k] if times[k] - latest >= apart else latest
            if times[k] - latest <= PARTS_WITHIN:
                yield Place(times[k], offsets[k])

    def read(self, utime: int) -> Iterator[tuple[int, Event]]:
        """Yield the events from this time on with their times in the log's own time [us].

        Where the log has not been read yet, its time stamps are used.
        """
        if utime > self.indexed_until and not self.complete:
            start = Checkpoint(self._seek(utime))
        else:
            start = self._checkpoints.before(utime)
        for moment, event in start.moments(EventReader(self.reader.path).read(start.offset)):
            if moment >= utime:
                yield moment, event

    def _seek(self, utime: int) -> int:
        """Return a file position shortly before this time, by bisection of the unread part."""
        reader = EventReader(self.reader.path)
        low, high = self._checkpoints.last_offset, self.reader.size
        while high - low > CHUNK:
            middle = (low + high) // 2
            event = next(reader.read(middle), None)
            low, high = (low, middle) if event is None or event.utime > utime else (middle, high)
        return low

    def events_at(self, places: Iterable[Place]) -> Iterator[tuple[int, Event]]:
        """Yield the events at indexed places, with their times."""
        with self.reader.path.open("rb", buffering=0) as stream:
            for place in places:
                head = os.pread(stream.fileno(), HEADER.size, place.offset)
                _sync, number, utime, channel_bytes, data_bytes = HEADER.unpack(head)
                rest = os.pread(stream.fileno(), channel_bytes + data_bytes, place.offset + HEADER.size)
                yield place.utime, Event(number, utime, rest[:channel_bytes].decode(), rest[channel_bytes:])

    def _read(self) -> Iterator[bool]:
        clock, reader, due, parts_until = LogClock(), self.reader, self._due, self._parts_until
        utime = self.begin
        for count, event in enumerate(reader):
            self._checkpoints.pass_by(clock, reader.position - _length(event))
            utime = clock.advance(event.utime)
            if utime >= due.get(event.channel, 0) or utime <= parts_until.get(event.channel, 0):
                self._keep(utime, reader.position - _length(event), event)
            if not count % EVENTS_BETWEEN_LOOKS:
                self.indexed_until = utime
                yield True
        self.indexed_until = self.end = utime

    def _keep(self, utime: int, offset: int, event: Event) -> None:
        if event.channel in SELF_TESTS:
            return
        if event.channel not in self.places:
            self.places[event.channel] = array("q"), array("q")
        identity = identify(event.channel)
        if not (identity and identity[0].name in ALL_REMEMBERED) and utime >= self._due.get(event.channel, 0):
            self._due[event.channel] = utime + PLACES_APART
            if event.channel == WORLD_STATE.name:
                self._parts_until[event.channel] = utime + PARTS_WITHIN
        times, offsets = self.places[event.channel]
        times.append(utime)
        offsets.append(offset)
        self._watch.take(utime, event)
        self._drive_watch.take(utime, event)


MARKED = (ESTOP, PARAMETERS, CALIBRATION_STATUS, PROCESS_STATUS)  # streams with events to mark


class _Watch:
    """Finds events to mark."""

    def __init__(self, marks: list[Mark]) -> None:
        self._marks = marks
        self._is_marked: dict[str, bool] = {}  # by channel
        self._bytes: dict[str, bytes] = {}
        self._shown: dict[str, str] = {}
        self._versions: dict[int, Versions] = {}  # of each robot's parameters

    def take(self, utime: int, event: Event) -> None:
        """Look at one event."""
        if event.channel not in self._is_marked:
            identity = identify(event.channel)
            self._is_marked[event.channel] = identity is not None and identity[0] in MARKED
        content = event.data[UTIME_BYTES.stop :]
        if not self._is_marked[event.channel] or self._bytes.get(event.channel) == content:
            return
        self._bytes[event.channel] = content
        try:
            message = decode(event.channel, event.data).message
        except RejectedMessage:
            return
        if isinstance(message, parameters_t) and self._is_outdated(utime, message):
            return
        seen = _mark_of(message)
        if seen is None or seen[1] == self._shown.get(event.channel, ""):
            return
        self._shown[event.channel] = seen[1]
        if seen[0]:
            self._marks.append(Mark(utime, *seen))

    def _is_outdated(self, utime: int, message: parameters_t) -> bool:
        return self._versions.setdefault(message.robot_id, Versions()).is_outdated(message, utime)


def _mark_of(message: Message) -> tuple[str, str] | None:
    """Return kind and sentence of the event in a message; None without one."""
    if isinstance(message, estop_t):
        return _estop(message)
    if isinstance(message, parameters_t):
        return "parameters", f"Robot {message.robot_id} has parameters {message.sha256[:8]}"
    if isinstance(message, calibration_status_t):
        return _calibration(message)
    return _diagnosis(message) if isinstance(message, process_status_t) else None


def _estop(message: estop_t) -> tuple[str, str]:
    if message.engaged:
        return "stop", f"Emergency stop by {message.source}: {message.reason}"
    return "released", f"Emergency stop released by {message.source}: {message.reason}"


def _calibration(message: calibration_status_t) -> tuple[str, str]:
    words = {calibration_status_t.DONE: "calibrated", calibration_status_t.FAILED: "failed"}
    word = words.get(message.state, "")
    return word, f"Calibration of robot {message.robot_id}: {message.message}" if word else ""


def _diagnosis(message: process_status_t) -> tuple[str, str] | None:
    if message.process != DIAGNOSIS:
        return None
    is_news = "Watching" not in message.message and "Waiting" not in message.message
    return ("diagnosis", message.message) if is_news else ("", "")


def _length(event: Event) -> int:
    return HEADER.size + len(event.channel.encode()) + len(event.data)

"""Read the events of an LCM event log sequentially, with little memory; only damaged events are lost.

LCM's own reader drops the event before every damage and, after a damaged length, everything within that length.
"""

import os
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

from cmr.bus.messages import Received, RejectedMessage, decode
from cmr.bus.rejections import Rejections
from cmr.bus.streams import SELF_TESTS
from cmr.files import open_regular

SYNC = b"\xed\xa1\xda\x01"  # start of every event
HEADER = struct.Struct(">4sqqII")  # sync word, event number, time stamp, lengths of channel name and of data
LONGEST_CHANNEL = 999  # bytes, as in LCM's reader
LARGEST_DATA = 1 << 26  # bytes; a larger length is damaged
CHUNK = 1 << 20  # bytes of a log in memory at a time
MOST_CHANNELS_KEPT = 10_000  # names whose decoding is cached


class Event(NamedTuple):
    """One event of a log: its number, logging time [us since the Unix epoch], channel, and encoded message."""

    number: int
    utime: int
    channel: str
    data: bytes


def event_bytes(event: Event) -> bytes:
    """Return an event as stored in a log."""
    name = event.channel.encode()
    return HEADER.pack(SYNC, event.number, event.utime, len(name), len(event.data)) + name + event.data


class _Frame(NamedTuple):
    """The contents of an event's header, and where in the file [bytes] the event, its data, and its end are."""

    start: int
    number: int
    utime: int
    channel: str
    data: int
    end: int


class EventReader:
    """The intact events of the log at `path`, in the order in which they were logged.

    An event is intact if it is complete and followed by another or the end of the file; before damage, if neither such
    an event nor the damage seems to begin within it. Data added after opening are not read.

    `position` is how much of the file's `size` the latest iteration has read [bytes]; `damaged_bytes` how much of that
    is damaged, in `damaged_places` different places. Raises OSError when the file cannot be opened.
    """

    def __init__(self, path: Path | str) -> None:
        self.path = Path(path)
        with open_regular(self.path) as stream:
            self.size = os.fstat(stream.fileno()).st_size
        self._begin(0)

    def _begin(self, position: int) -> None:
        self.position = position
        self.damaged_bytes = 0
        self.damaged_places = 0
        self._damaged_until = -1  # end of the latest damage
        self._next_sure: _Frame | None = None  # the first event at or after position that is surely one
        self._sure_is_known = False
        self._channels: dict[bytes, str | None] = {}

    def __iter__(self) -> Iterator[Event]:
        return self.read()

    def read(self, begin: int = 0) -> Iterator[Event]:
        """Yield the intact events from this place in the file [bytes] on."""
        self._begin(begin)
        with self.path.open("rb", buffering=0) as stream:
            file = stream.fileno()
            while self.position < self.size:
                before = self.position
                yield from self._events_of_chunk(os.pread(file, min(CHUNK, self.size - before), before))
                if self.position == before:  # a large event, the last one, or damage
                    event = self._next_event(file)
                    if event is not None:
                        yield event

    def _events_of_chunk(self, chunk: bytes) -> Iterator[Event]:
        """Yield the events at the beginning of a chunk, as long as each is followed by another one."""
        channels, unpack, header_bytes = self._channels, HEADER.unpack_from, HEADER.size
        start, base, last = 0, self.position, len(chunk) - HEADER.size
        while start <= last:
            sync, number, utime, channel_bytes, data_bytes = unpack(chunk, start)
            name_start = start + header_bytes
            data_start = name_start + channel_bytes
            end = data_start + data_bytes
            if sync != SYNC or chunk[end : end + 4] != SYNC or not channel_bytes or data_bytes > LARGEST_DATA:
                return
            name = chunk[name_start:data_start]
            channel = channels[name] if name in channels else self._channel(name)
            if channel is None:
                return
            self.position = base + end
            yield Event(number, utime, channel, chunk[data_start:end])
            start = end

    def _channel(self, name: bytes) -> str | None:
        """Return the channel of this name, None for an invalid name."""
        if len(self._channels) >= MOST_CHANNELS_KEPT:
            self._channels.clear()
        try:
            channel = name.decode()
        except UnicodeDecodeError:
            channel = ""
        is_name = len(name) <= LONGEST_CHANNEL and channel.isprintable() and channel
        return self._channels.setdefault(name, channel if is_name else None)

    def _next_event(self, file: int) -> Event | None:
        """Return the next event, None if only damage was skipped."""
        sure = self._sure(file)
        limit = self.size if sure is None else sure.start
        frame = next(self._frames(file, self.position, limit), sure)
        self._note_damage(frame.start if frame is not None else self.size)
        if frame is None:
            return None
        data = os.pread(file, frame.end - frame.data, frame.data)
        if frame is not sure and self._may_be_overwritten(file, frame, data, sure):
            self._note_damage(frame.end)
            return None
        self.position = frame.end
        return Event(frame.number, frame.utime, frame.channel, data)

    def _sure(self, file: int) -> _Frame | None:
        """Return the next event from here on that is followed by another one or the end of the file."""
        if self._sure_is_known and (self._next_sure is None or self._next_sure.start >= self.position):
            return self._next_sure
        frames = self._frames(file, self.position, self.size)
        self._next_sure = next((frame for frame in frames if self._is_followed(file, frame.end)), None)
        self._sure_is_known = True
        return self._next_sure

    def _frames(self, file: int, first: int, limit: int) -> Iterator[_Frame]:
        """Yield possible events that begin at `first` or later and end at `limit` or before."""
        while first < limit:
            chunk = os.pread(file, min(CHUNK, limit - first), first)
            found = chunk.find(SYNC)
            while found >= 0:
                frame = self._frame(file, first + found)
                if frame is not None and frame.end <= limit:
                    yield frame
                found = chunk.find(SYNC, found + 1)
            if first + len(chunk) >= limit or len(chunk) < len(SYNC):
                return
            first += len(chunk) - len(SYNC) + 1  # a sync word may lie on the border of two chunks

    def _frame(self, file: int, start: int) -> _Frame | None:
        """Return the header at `start`, None if it is not a valid header."""
        head = os.pread(file, HEADER.size + LONGEST_CHANNEL, start)
        if len(head) < HEADER.size:
            return None
        _sync, number, utime, channel_bytes, data_bytes = HEADER.unpack_from(head)
        data = start + HEADER.size + channel_bytes
        end = data + data_bytes
        if not 0 < channel_bytes <= LONGEST_CHANNEL or data_bytes > LARGEST_DATA or end > self.size:
            return None
        channel = self._channel(head[HEADER.size : HEADER.size + channel_bytes])
        return None if channel is None else _Frame(start, number, utime, channel, data, end)

    def _is_followed(self, file: int, end: int) -> bool:
        """Return whether at `end` another event begins, or the file ends, possibly within a sync word."""
        rest = os.pread(file, min(len(SYNC), self.size - end), end)
        return SYNC.startswith(rest)

    def _may_be_overwritten(self, file: int, frame: _Frame, data: bytes, sure: _Frame | None) -> bool:
        """Return whether the damage after an event may begin within it: zeros there and here, and events are
        missing.
        """
        is_complete = sure is not None and sure.number == frame.number + 1  # something was only inserted
        return not is_complete and data.endswith(b"\0") and os.pread(file, 1, frame.end) == b"\0"

    def _note_damage(self, end: int) -> None:
        """Skip the damage from here to `end`."""
        if end > self.position:
            self.damaged_places += self.position != self._damaged_until
            self.damaged_bytes += end - self.position
            self.position = self._damaged_until = end


class LogReader:
    """The messages of an event log at `path`, in the order in which they were logged.

    `rejected` counts rejected messages by (channel, reason) while iterating; bus tests are ignored. A truncated log
    yields its intact events. Raises OSError when the file cannot be opened.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.rejected = Rejections()
        self._events = EventReader(path)

    def __iter__(self) -> Iterator[Received]:
        for event in self._events:
            if event.channel in SELF_TESTS:
                continue
            try:
                yield decode(event.channel, event.data)
            except RejectedMessage as rejected:
                self.rejected.note(event.channel, rejected.reason)

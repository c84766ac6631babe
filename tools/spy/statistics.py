"""What is said on a bus, channel by channel: type, rate, bytes, age, jitter and errors; nothing is decoded here."""

import math
from collections import deque
from functools import cache
from typing import NamedTuple

from cmr.bus.message import Message
from cmr.bus.older import as_of_today
from cmr.bus.streams import Stream, identify
from cmr.tools.replay.changes import FINGERPRINT_BYTES, TYPES

WINDOW = 5_000_000  # us over which rates and jitter are taken
MICROSECONDS = 1e6
LEAST_INTERVALS = 2  # of a slow channel that are taken together, however old
SILENT_INTERVALS = 3.0  # without a message for so many times what is usual, and the window: it has fallen silent
ROBOT_ID = slice(16, 20)  # where the robot's id is in the bytes of every type that has one, after fingerprint and utime


class Line(NamedTuple):
    """A channel at one moment.

    `heard` messages until now; `rate` [Hz]; `bytes_per_second`; `age` [s] since the last message; `jitter`: standard
    deviation of the time from message to message [s], NaN where there are fewer than three messages; `errors`:
    messages of another type than the channel's, of another robot, or too short; `data`, the last message, which arrived
    at `utime` [us].
    """

    channel: str
    type_name: str
    heard: int
    rate: float
    bytes_per_second: float
    age: float
    jitter: float
    errors: int
    utime: int
    data: bytes


class _Mark(NamedTuple):
    """How far a channel was at some moment [us]."""

    now: int
    utime: int
    heard: int
    size: int
    squares: int


class _Channel:
    """Sums over all messages of one channel; the rates follow from the differences to earlier marks."""

    __slots__ = ("count", "data", "errors", "fingerprint", "least", "marks", "robot_id", "size", "squares", "utime")

    def __init__(self, name: str, utime: int) -> None:
        identity = identify(name)
        stream, robot_id = identity or (None, None)
        self.fingerprint = _fingerprint(stream) if stream else None
        self.least = _least_bytes(stream) if stream else 0
        self.robot_id = None if robot_id is None else robot_id.to_bytes(4, "big")
        self.count = self.errors = self.size = self.squares = 0
        self.utime = utime
        self.data = b""
        self.marks: deque[_Mark] = deque()

    def mark(self, now: int) -> None:
        """Note how far it is."""
        self.marks.append(_Mark(now, self.utime, self.count, self.size, self.squares))

    def go_on_after(self, interval: int) -> None:
        """Begin to count again with the last message, if the interval before it [us] was a silence."""
        first = self.marks[0]
        intervals = self.count - 1 - first.heard
        if intervals and interval > SILENT_INTERVALS * (self.utime - interval - first.utime) / intervals:
            self.marks.clear()
            self.mark(self.utime)


class Statistics:
    """Counts messages as they arrive; `lines` returns the state of all channels."""

    def __init__(self) -> None:
        self._channels: dict[str, _Channel] = {}

    def handle(self, utime: int, channel: str, data: bytes) -> None:
        """Take a message that arrived at `utime` [us]."""
        data = as_of_today(data)
        state = self._channels.get(channel)
        if state is None:
            state = self._channels[channel] = _Channel(channel, utime)
            state.marks.append(_Mark(utime, utime, 1, len(data), 0))  # as it will be after this message
        interval = utime - state.utime
        state.utime = utime
        state.count += 1
        state.size += len(data)
        state.squares += interval * interval
        state.data = data
        if state.fingerprint is not None and (
            data[:FINGERPRINT_BYTES] != state.fingerprint
            or len(data) < state.least
            or (state.robot_id is not None and data[ROBOT_ID] != state.robot_id)
        ):
            state.errors += 1
        if interval > WINDOW:
            state.go_on_after(interval)

    def lines(self, now: int) -> list[Line]:
        """Return all channels, by name, as they are at `now` [us]."""
        return [_line(name, self._channels[name], now) for name in sorted(self._channels)]


def _line(name: str, state: _Channel, now: int) -> Line:
    marks = state.marks
    while len(marks) > 2 and marks[1].now <= now - WINDOW and state.count - marks[1].heard >= LEAST_INTERVALS:
        marks.popleft()
    first = marks[0]
    state.mark(now)
    intervals, span = state.count - first.heard, state.utime - first.utime  # us, of that many intervals
    mean = span / intervals if intervals else 0.0
    variance = (state.squares - first.squares) / intervals - mean * mean if intervals > 1 else math.nan
    age = now - state.utime
    if age > max(WINDOW, SILENT_INTERVALS * mean):
        intervals = 0
    elif age > 2.0 * mean:  # it has become slower
        span = now - first.utime
    size = state.size - first.size if intervals else 0
    return Line(
        channel=name,
        type_name=_type_name(state.data[:FINGERPRINT_BYTES]),
        heard=state.count,
        rate=intervals / max(span, 1) * MICROSECONDS,
        bytes_per_second=size / max(span, 1) * MICROSECONDS,
        age=age / MICROSECONDS,
        jitter=math.sqrt(max(variance, 0.0)) / MICROSECONDS,
        errors=state.errors,
        utime=state.utime,
        data=state.data,
    )


def _fingerprint(stream: Stream[Message]) -> bytes:
    return bytes(stream.message_type._get_packed_fingerprint())


@cache
def _least_bytes(stream: Stream[Message]) -> int:
    """Return how many bytes every message of a stream has at least: those of all that precedes arrays and strings."""
    message = stream.message_type()
    return len(message.encode())


@cache
def _type_name(fingerprint: bytes) -> str:
    """Return the name of the type that has this fingerprint, where it is one of ours."""
    message_type = TYPES.get(fingerprint)
    return message_type.__name__ if message_type is not None else "unknown"

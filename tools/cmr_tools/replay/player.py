"""Timing of a replay: speed, pause, jumps, loops and gaps, with any clock and sink."""

import math
from collections.abc import Callable, Iterator
from typing import Protocol

from cmr.recordings.events import Event

SLOWEST = 0.1
LADDER = (SLOWEST, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0, math.inf)  # the steps of faster and slower
LONGEST_CATCH_UP = 0.5  # s; after a longer interruption, such as Ctrl-Z, missed messages are not sent in a burst
BATCH = 500  # messages sent or skipped at once, so that keys are handled in between


class Tape(Protocol):
    """Logged messages that can be read from any time on, repeatedly."""

    def read(self, begin: float) -> Iterator[tuple[float, Event]]:
        """Yield the messages from `begin` on with their times [s since the log began], which never decrease."""


class Player:
    """Sends the messages of a tape at their time: `sink(event, due, speed)` with the time at which it was due [s].

    `clock` returns the time [s]; with any origin, but never decreasing. `speed` 1 is as recorded, inf as fast as
    possible. `begin` and `end` [s since the log began] bound what is played; a silence of more than `longest_gap` [s]
    is cut to that. `wanted` chooses channels. What is sent is counted in `sent`, loops done in `rounds`.
    """

    def __init__(
        self,
        tape: Tape,
        clock: Callable[[], float],
        sink: Callable[[Event, float, float], None],
        *,
        speed: float = 1.0,
        loop: bool = False,
        longest_gap: float = math.inf,
        begin: float = 0.0,
        end: float = math.inf,
        wanted: Callable[[str], bool] = lambda _channel: True,
    ) -> None:
        self.sent = 0
        self.rounds = 0
        self.speed = speed
        self._tape, self._clock, self._sink, self._wanted = tape, clock, sink, wanted
        self._loop, self._longest_gap, self._begin, self._end = loop, longest_gap, begin, end
        self._paused_at: float | None = None
        self._events: Iterator[tuple[float, Event]] = iter(())
        self._next: tuple[float, Event] | None = None  # the next message, and its time in the log
        self._due = 0.0  # when it is due, by the clock
        self._last = 0.0  # the time in the log from which the wait for it is counted
        self._sent_before_round = 0
        self._open(begin)

    @property
    def paused(self) -> bool:
        """Whether it is paused."""
        return self._paused_at is not None

    @property
    def position(self) -> float:
        """Position in the log [s since the log began]."""
        if self._next is None or math.isinf(self.speed):
            return self._last
        return max(self._last, self._next[0] - max(self._due - self._now(), 0.0) * self.speed)

    def play(self) -> float | None:
        """Send what is due, up to a batch.

        Return the time until the next message is due [s]: inf while paused, None at the end.
        """
        if self.paused:
            return math.inf
        for _ in range(BATCH):
            if self._next is None and not self._load():
                return None
            if self._next is None:
                continue
            seconds, event = self._next
            late = self._clock() - self._due
            if late < 0.0:
                return -late
            if late > LONGEST_CATCH_UP:
                self._due += late
            self._sink(event, self._due, self.speed)
            self.sent += 1
            self._last, self._next = seconds, None
        return 0.0

    def toggle(self) -> None:
        """Pause, or resume."""
        if self._paused_at is None:
            self._paused_at = self._clock()
        else:
            self._due += self._clock() - self._paused_at
            self._paused_at = None

    def faster(self) -> None:
        """Change to the next greater speed of the ladder."""
        self._set_speed(min((speed for speed in LADDER if speed > self.speed), default=self.speed))

    def slower(self) -> None:
        """Change to the next smaller speed of the ladder."""
        self._set_speed(max((speed for speed in LADDER if speed < self.speed), default=self.speed))

    def jump(self, seconds: float) -> None:
        """Jump forward or back in the log by this time, but not before the beginning."""
        self._open(max(self.position + seconds, self._begin))

    def _now(self) -> float:
        return self._clock() if self._paused_at is None else self._paused_at

    def _set_speed(self, speed: float) -> None:
        now = self._now()
        position = self.position
        self.speed = speed
        if self._next is not None:
            self._last = position
            self._due = now + self._gap_to(self._next[0])

    def _gap_to(self, seconds: float) -> float:
        """Return the time to wait [s] from the current position until this time in the log."""
        return min(seconds - self._last, self._longest_gap) / self.speed

    def _open(self, seconds: float) -> None:
        self._events = self._tape.read(seconds)
        self._next = None
        self._last = seconds
        self._due = self._now()

    def _load(self) -> bool:
        """Read one more message, which becomes the next if it is wanted; return whether there was one."""
        found = next(self._events, None)
        if found is None or found[0] > self._end:
            return self._begin_again()
        if self._wanted(found[1].channel):
            self._next = found
            self._due = self._clock() if math.isinf(self.speed) else self._due + self._gap_to(found[0])
        return True

    def _begin_again(self) -> bool:
        """Begin another round, if that is wanted and the last one had something to send."""
        if not self._loop or self.sent == self._sent_before_round:
            return False
        self.rounds += 1
        self._sent_before_round = self.sent
        self._open(self._begin)
        return True

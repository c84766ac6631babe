"""Time that goes on only when the process that is fuzzed sleeps, and only as far as the fuzzer lets it."""

import sys
import threading
import time
from types import ModuleType
from typing import Protocol

BEGAN = 1_800_000_000_000_000  # us; the time of day
PREFIXES = ("cmr.", "robot_driver.")
REST_OF_OTHERS = 0.002  # s that another thread really sleeps, whatever it asks for
SECOND = 10**9  # ns


class Clock(Protocol):
    """A clock, as `robot_driver.simulated.host.SimulatedHost` is one."""

    def monotonic_ns(self) -> int:
        """Return a steady time [ns]."""

    def utime(self) -> int:
        """Return the time of day [us]."""

    def sleep(self, seconds: float) -> None:
        """Let time pass."""


class PlainClock:
    """A clock of a computer on which nothing else happens. `offset` [us] is by how much the time of day was set."""

    def __init__(self) -> None:
        self.offset = 0
        self._now = 1000 * SECOND

    def monotonic_ns(self) -> int:
        """Return a steady time [ns]."""
        return self._now

    def utime(self) -> int:
        """Return the time of day [us]."""
        return BEGAN + self._now // 1000 + self.offset

    def sleep(self, seconds: float) -> None:
        """Let time pass: some, or who waits for a moment that is less than a nanosecond away would wait for ever."""
        self._now += max(round(seconds * SECOND), 1)


class Ended(BaseException):
    """Ends a process that does not come to its end by itself."""


class SteppedTime(ModuleType):
    """Stands in for the module `time` in all modules of ours.

    The thread that is `led` sleeps until the leader lets time go on to where it wants to be; others sleep a moment.
    """

    def __init__(self, clock: Clock) -> None:
        super().__init__("time")
        self.clock = clock
        self._until = clock.monotonic_ns()
        self._led: int | None = None
        self._go, self._rests = threading.Semaphore(0), threading.Semaphore(0)
        self._is_ending = False
        for name in vars(time).keys() - vars(type(self)).keys() - vars(self).keys():
            setattr(self, name, getattr(time, name))

    def clock_gettime(self, _clock: int) -> float:
        """Return the clock's steady time [s], whichever is asked for."""
        return self.clock.monotonic_ns() / SECOND

    def clock_gettime_ns(self, _clock: int) -> int:
        """Return the clock's steady time [ns], whichever is asked for."""
        return self.clock.monotonic_ns()

    def monotonic_ns(self) -> int:
        """Return the clock's steady time [ns]."""
        return self.clock.monotonic_ns()

    def monotonic(self) -> float:
        """Return the clock's steady time [s]."""
        return self.clock.monotonic_ns() / SECOND

    def time_ns(self) -> int:
        """Return the clock's time of day [ns]."""
        return self.clock.utime() * 1000

    def time(self) -> float:
        """Return the clock's time of day [s]."""
        return self.clock.utime() / 1e6

    def sleep(self, seconds: float) -> None:
        """Sleep: in the led thread as far as the leader lets it."""
        if threading.get_ident() != self._led:
            time.sleep(REST_OF_OTHERS)
            return
        self.clock.sleep(seconds)
        if self.clock.monotonic_ns() >= self._until:
            self.hand_over()
            self._go.acquire()
            if self._is_ending:
                raise Ended

    def lead_this_thread(self) -> None:
        """Have the thread that calls be the led one; it waits until it may go on."""
        self._led = threading.get_ident()
        self._go.acquire()

    def hand_over(self) -> None:
        """Say that the led thread rests, or has ended."""
        self._rests.release()

    def run(self, seconds: float, patience: float) -> bool:
        """Let the led thread go on for so long; return whether it came to rest within the patience [s, real]."""
        self._until = self.clock.monotonic_ns() + round(seconds * SECOND)
        self._go.release()
        return self._rests.acquire(timeout=patience)

    def end(self) -> None:
        """Have the led thread end where it rests."""
        self._is_ending = True
        self._go.release()

    def take_over(self) -> None:
        """Stand in for `time` in all modules of ours that are imported by now."""
        for name, module in list(sys.modules.items()):
            if name.startswith(PREFIXES) and isinstance(getattr(module, "time", None), ModuleType):
                setattr(module, "time", self)  # noqa: B010 - a module has no such attribute for mypy

"""Time that advances only when the fuzzed process sleeps, and only as far as the fuzzer allows."""

import sys
import threading
import time
from types import ModuleType
from typing import Protocol

BEGAN = 1_800_000_000_000_000  # us; time of day
PREFIXES = ("cmr.", "robot_driver.")
SLEEP_OF_OTHERS_S = 0.002  # real duration of a sleep in any other thread, whatever it asks for
NS_PER_S = 10**9


class Clock(Protocol):
    """A clock, with part of the interface of `robot_driver.simulated.host.SimulatedHost`."""

    def monotonic_ns(self) -> int:
        """Return a steady time [ns]."""

    def utime(self) -> int:
        """Return the time of day [us]."""

    def sleep(self, seconds: float) -> None:
        """Advance the time by `seconds`."""


class PlainClock:
    """A clock that advances only by sleeping. `offset` [us] is the shift of the time of day."""

    def __init__(self) -> None:
        self.offset = 0
        self._now = 1000 * NS_PER_S

    def monotonic_ns(self) -> int:
        """Return a steady time [ns]."""
        return self._now

    def utime(self) -> int:
        """Return the time of day [us]."""
        return BEGAN + self._now // 1000 + self.offset

    def sleep(self, seconds: float) -> None:
        """Advance the time by `seconds`, at least 1 ns, so that waiting for a shorter time ends."""
        self._now += max(round(seconds * NS_PER_S), 1)


class ForcedEnd(BaseException):
    """Raised in the fuzzed process to end it when it did not end by itself."""


class SteppedTime(ModuleType):
    """Replaces the module `time` in all modules of CMR.

    One thread is controlled: when it sleeps, the clock advances, up to the time that `run` allows; there it rests.
    A sleep in any other thread takes 2 ms of real time.
    """

    def __init__(self, clock: Clock) -> None:
        super().__init__("time")
        self.clock = clock
        self._until = clock.monotonic_ns()
        self._controlled: int | None = None
        self._go, self._rests = threading.Semaphore(0), threading.Semaphore(0)
        self._is_ending = False
        for name in vars(time).keys() - vars(type(self)).keys() - vars(self).keys():
            setattr(self, name, getattr(time, name))

    def clock_gettime(self, _clock: int) -> float:
        """Return the clock's steady time [s], whichever clock is requested."""
        return self.clock.monotonic_ns() / NS_PER_S

    def clock_gettime_ns(self, _clock: int) -> int:
        """Return the clock's steady time [ns], whichever clock is requested."""
        return self.clock.monotonic_ns()

    def monotonic_ns(self) -> int:
        """Return the clock's steady time [ns]."""
        return self.clock.monotonic_ns()

    def monotonic(self) -> float:
        """Return the clock's steady time [s]."""
        return self.clock.monotonic_ns() / NS_PER_S

    def time_ns(self) -> int:
        """Return the clock's time of day [ns]."""
        return self.clock.utime() * 1000

    def time(self) -> float:
        """Return the clock's time of day [s]."""
        return self.clock.utime() / 1e6

    def sleep(self, seconds: float) -> None:
        """Sleep; the controlled thread rests at the end of the allowed time."""
        if threading.get_ident() != self._controlled:
            time.sleep(SLEEP_OF_OTHERS_S)
            return
        self.clock.sleep(seconds)
        if self.clock.monotonic_ns() >= self._until:
            self.yield_control()
            self._go.acquire()
            if self._is_ending:
                raise ForcedEnd

    def control_this_thread(self) -> None:
        """Make the calling thread the controlled one, and wait for the first `run`."""
        self._controlled = threading.get_ident()
        self._go.acquire()

    def yield_control(self) -> None:
        """Signal that the controlled thread rests, or has ended."""
        self._rests.release()

    def run(self, seconds: float, timeout: float) -> bool:
        """Let the controlled thread run for `seconds`; return whether it rests within `timeout` [s] of real time."""
        self._until = self.clock.monotonic_ns() + round(seconds * NS_PER_S)
        self._go.release()
        return self._rests.acquire(timeout=timeout)

    def end(self) -> None:
        """End the controlled thread where it rests."""
        self._is_ending = True
        self._go.release()

    def install(self) -> None:
        """Replace `time` in all modules of CMR that are imported so far."""
        for name, module in list(sys.modules.items()):
            if name.startswith(PREFIXES) and isinstance(getattr(module, "time", None), ModuleType):
                setattr(module, "time", self)  # noqa: B010 - for mypy, a module has no such attribute

"""From the monotonic clock, which measures, to the time of day, which messages carry."""

import time
from collections.abc import Callable

SAMPLES = 3  # comparisons of the two clocks; another thread may run in the midst of one


def seconds_since_boot() -> float:
    """Return a steady time (s) that goes on while the computer is suspended: what was commanded before is old then."""
    return time.clock_gettime(time.CLOCK_BOOTTIME)


def utime_at(monotonic_nanoseconds: int) -> int:
    """Return the time of day (us since the Unix epoch) of a recent moment on the monotonic clock."""
    _, offset = min(_compare() for _ in range(SAMPLES))
    return (monotonic_nanoseconds + offset) // 1000


class Stamps:
    """Times of day of one stream of messages: strictly increasing, whatever happens to the clocks meanwhile."""

    def __init__(self, utime_at: Callable[[int], int] = utime_at) -> None:
        self._utime_at = utime_at
        self._last = 0

    def next(self, monotonic_nanoseconds: int) -> int:
        """Return the time of day (us) of a moment, but later than all before it."""
        self._last = max(self._utime_at(monotonic_nanoseconds), self._last + 1)
        return self._last


def _compare() -> tuple[int, int]:
    """Return how uncertain this comparison is, and time of day minus monotonic time (ns)."""
    before = time.monotonic_ns()
    time_of_day = time.time_ns()
    after = time.monotonic_ns()
    return after - before, time_of_day - (before + after) // 2

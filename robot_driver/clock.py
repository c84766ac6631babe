"""Convert the monotonic clock, used for measurements, to the time of day, used in messages."""

import time
from collections.abc import Callable

SAMPLES = 3  # comparisons of the two clocks; the scheduler may interrupt one
FURTHEST_BACK = 1_000_000  # us; a clock set back by more is followed at once
SLOWEST = 0.9  # s of stamps per second, while a clock set back by less catches up


def seconds_since_boot() -> float:
    """Return a monotonic time (s) that includes suspension, so that commands from before are old."""
    return time.clock_gettime(time.CLOCK_BOOTTIME)


def utime_at(monotonic_nanoseconds: int) -> int:
    """Return the time of day (us since the Unix epoch) of a recent moment on the monotonic clock."""
    _, offset = min(_compare() for _ in range(SAMPLES))
    return (monotonic_nanoseconds + offset) // 1000


class Stamps:
    """Times of day for one stream of messages: strictly increasing, unless the clock is set back by more than a second.

    They are based on the monotonic clock, and follow the time of day: at once if it is ahead or was set back far, and
    by running more slowly if it was set back less.
    """

    def __init__(self, utime_at: Callable[[int], int] = utime_at) -> None:
        self._utime_at = utime_at
        self._last: int | None = None  # us
        self._moment = 0  # the latest one, on the monotonic clock [ns]

    def next(self, monotonic_nanoseconds: int) -> int:
        """Return the time of day (us) of a time, later than all before."""
        utime, last = self._utime_at(monotonic_nanoseconds), self._last
        passed = (monotonic_nanoseconds - self._moment) // 1000
        # Relative to the latest time: an older one does not mean that the clock was set back.
        if last is not None and last - (utime - passed) <= FURTHEST_BACK:
            utime = max(utime, last + max(int(SLOWEST * passed), 1))
        self._last, self._moment = utime, max(self._moment, monotonic_nanoseconds)
        return utime


def _compare() -> tuple[int, int]:
    """Return the uncertainty of this comparison, and time of day minus monotonic time (ns)."""
    before = time.monotonic_ns()
    time_of_day = time.time_ns()
    after = time.monotonic_ns()
    return after - before, time_of_day - (before + after) // 2

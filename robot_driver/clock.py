"""From the monotonic clock, which measures, to the time of day, which messages carry."""

import time

SAMPLES = 3  # comparisons of the two clocks; another thread may run in the midst of one


def utime_at(monotonic_nanoseconds: int) -> int:
    """Return the time of day (us since the Unix epoch) of a recent moment on the monotonic clock."""
    _, offset = min(_compare() for _ in range(SAMPLES))
    return (monotonic_nanoseconds + offset) // 1000


def _compare() -> tuple[int, int]:
    """Return how uncertain this comparison is, and time of day minus monotonic time (ns)."""
    before = time.monotonic_ns()
    time_of_day = time.time_ns()
    after = time.monotonic_ns()
    return after - before, time_of_day - (before + after) // 2

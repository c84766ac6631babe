"""From the monotonic clock, which measures, to the time of day, which messages carry."""

import time


def utime_at(monotonic_nanoseconds: int) -> int:
    """Return the time of day (us since the Unix epoch) of a recent moment on the monotonic clock."""
    return (time.time_ns() - time.monotonic_ns() + monotonic_nanoseconds) // 1000

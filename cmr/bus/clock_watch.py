"""Detect changes to this computer's clock: stamps then jump, and earlier messages belong to another time."""

import time

UNNOTICED = 100_000  # us; a clock that is set by less is not reported
SPOKEN_OF = 60_000_000  # us for which a change of the clock is reported
TRIES = 10  # attempts to read both clocks at once; the scheduler may interrupt an attempt


class ClockWatch:
    """Compares the time of day with a monotonic clock that also runs while the computer sleeps; call `look` often."""

    def __init__(self) -> None:
        self._offset: int | None = None  # us, time of day minus monotonic clock
        self._steady = self._set = 0
        self._sentence = ""

    def look(self, utime: int, steady: int | None = None) -> str:
        """Compare the time of day with the monotonic clock [us]; return a sentence if the clock was set since the last
        call.
        """
        utime, self._steady = _compared() if steady is None else (utime, steady)
        offset, before = utime - self._steady, self._offset
        if before is not None and abs(offset - before) < UNNOTICED:
            return ""
        self._offset = offset
        if before is None:
            return ""
        ahead = offset - before
        self._set = self._steady
        self._sentence = (
            f"The clock of this computer was set {'ahead' if ahead > 0 else 'back'} by {abs(ahead) * 1e-6:.1f} s; "
            "stamps follow it."
        )
        return self._sentence

    def remark(self) -> str:
        """Return what happened to the clock within the last minute; empty if nothing did."""
        return self._sentence if self._steady - self._set <= SPOKEN_OF else ""


def _compared() -> tuple[int, int]:
    """Return the time of day and the monotonic time of the same moment [us], even if the scheduler interrupts between
    them.
    """
    for _ in range(TRIES):
        before = time.clock_gettime_ns(time.CLOCK_BOOTTIME) // 1000
        utime = time.time_ns() // 1000
        steady = time.clock_gettime_ns(time.CLOCK_BOOTTIME) // 1000
        if steady - before < UNNOTICED // 2:
            break
    return utime, steady

"""Whether the clock of this computer was set: stamps jump then, and messages from before are of another time."""

import time

UNNOTICED = 100_000  # us; a clock that is set by less is not reported
SPOKEN_OF = 60_000_000  # us
TRIES = 10  # to read both clocks at one moment: others may run in the midst of one


class ClockWatch:
    """Compares the time of day with a steady one that goes on while the computer sleeps; `look` often."""

    def __init__(self) -> None:
        self._offset: int | None = None  # us between the two
        self._steady = self._set = 0
        self._sentence = ""

    def look(self, utime: int, steady: int | None = None) -> str:
        """Take the time of day and the steady one [us]; return a sentence if the clock was set since the last look."""
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
    """Return the time of day and the steady one at the same moment [us], whoever runs between two looks at a clock."""
    for _ in range(TRIES):
        before = time.clock_gettime_ns(time.CLOCK_BOOTTIME) // 1000
        utime = time.time_ns() // 1000
        steady = time.clock_gettime_ns(time.CLOCK_BOOTTIME) // 1000
        if steady - before < UNNOTICED // 2:
            break
    return utime, steady

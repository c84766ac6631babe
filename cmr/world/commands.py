"""Commands as a robot obeys them: the newest one counts, for half a second, of whichever kind it is."""

import math

from cmr.bus.streams import COMMAND_LIFETIME

OTHER_CLOCK = 2 * COMMAND_LIFETIME  # us; what is older than the last command by more is of another clock


class CommandMemory:
    """The newest motor command of one robot."""

    def __init__(self) -> None:
        self._command = (0, 0.0, 0.0)

    def take(self, utime: int, left: float, right: float) -> None:
        """Take a command decided at `utime` [us].

        One that is no number, or a little older than the last, is passed over; one that is much older comes from
        another clock, and counts.
        """
        in_order = not 0 < self._command[0] - utime <= OTHER_CLOCK
        if in_order and math.isfinite(left) and math.isfinite(right):
            self._command = (utime, left, right)

    def at(self, utime: int) -> tuple[float, float]:
        """Return the duties (left, right) in force at `utime` [us]."""
        decided, left, right = self._command
        return (left, right) if abs(utime - decided) <= COMMAND_LIFETIME else (0.0, 0.0)

"""Commands in force: the newest one of any kind counts, for half a second."""

import math

from cmr.bus.streams import COMMAND_LIFETIME

OTHER_CLOCK = 2 * COMMAND_LIFETIME  # us; a command older than the last one by more comes from another clock


class CommandMemory:
    """The newest motor command of one robot."""

    def __init__(self) -> None:
        self._command = (0, 0.0, 0.0)

    def take(self, utime: int, left: float, right: float) -> None:
        """Store a command decided at `utime` [us].

        A command that is NaN or slightly older than the last is ignored; a much older one comes from another clock and
        is accepted.
        """
        in_order = not 0 < self._command[0] - utime <= OTHER_CLOCK
        if in_order and math.isfinite(left) and math.isfinite(right):
            self._command = (utime, left, right)

    def at(self, utime: int) -> tuple[float, float]:
        """Return the duties (left, right) in force at `utime` [us]."""
        decided, left, right = self._command
        return (left, right) if abs(utime - decided) <= COMMAND_LIFETIME else (0.0, 0.0)

"""Remove the jumps of the board's clock when it is set."""

from collections import deque
from statistics import median

STEPS = 15  # turns of the board's loop needed to know their length
JITTER = 50  # us; a larger deviation from whole turns is a jump
LARGEST_JUMP = 100_000  # us; beyond it the clock was set to another epoch, and is not smoothed
MEMORY = 2_000_000  # us over which a jump is corrected


class SteadyClock:
    """A steady version of the board's clock, at the board's own rate.

    The clock is set to ours four times a second, each time late by the transmission: up to 1 ms on USB. A wheel's
    velocity over 10 ms would be wrong by up to a tenth. The board's turns are regular, so a jump is detected, and
    spread over the next seconds.
    """

    def __init__(self) -> None:
        self._last: int | None = None
        self._steps: deque[int] = deque(maxlen=STEPS)
        self._ahead = 0.0

    def read(self, utime: int) -> int:
        """Return the steady time (us) for the next time of the board's clock (us), of the same or a later turn."""
        step = 0 if self._last is None else utime - self._last
        self._last = utime
        if abs(step) > LARGEST_JUMP:
            self._ahead = 0.0  # the turns of the board's loop still have the same length
        elif step:
            self._ahead += self._jump(step) - self._ahead * abs(step) / MEMORY
            self._steps.append(step)
        return utime - round(self._ahead)

    def _jump(self, step: int) -> float:
        """Return the jump of the clock (us), from its step between two turns (us)."""
        if len(self._steps) < STEPS:
            return 0.0
        turn = median(self._steps)
        jump = step - turn * max(1, round(step / turn))
        return jump if abs(jump) > JITTER else 0.0

"""The board's clock without the jumps that it makes each time it is set."""

from collections import deque
from statistics import median

STEPS = 15  # turns of the board's loop from which the length of one is known
JITTER = 50  # us; what differs by more from whole turns is a jump
LARGEST_JUMP = 100_000  # us; beyond it the clock was set from one age to another, and there is nothing to smooth
MEMORY = 2_000_000  # us in which a jump is made up for


class SteadyClock:
    """Follows the board's clock at the board's own pace.

    The clock is set to ours again four times a second, each time late by what the message took: up to 1 ms on USB. A
    wheel's velocity over 10 ms would be wrong by as much as a tenth. The board's turns are regular, though, so a jump
    shows, and is spread over the next seconds.
    """

    def __init__(self) -> None:
        self._last: int | None = None
        self._steps: deque[int] = deque(maxlen=STEPS)
        self._ahead = 0.0

    def read(self, utime: int) -> int:
        """Return the steady time (us) for the next time by the board's clock (us), of the same or a later turn."""
        step = 0 if self._last is None else utime - self._last
        self._last = utime
        if abs(step) > LARGEST_JUMP:
            self._ahead = 0.0  # but the turns of the board's loop are as long as they were
        elif step:
            self._ahead += self._jump(step) - self._ahead * abs(step) / MEMORY
            self._steps.append(step)
        return utime - round(self._ahead)

    def _jump(self, step: int) -> float:
        """Return by how much the clock has jumped ahead, given its step from one turn to another (us)."""
        if len(self._steps) < STEPS:
            return 0.0
        turn = median(self._steps)
        jump = step - turn * max(1, round(step / turn))
        return jump if abs(jump) > JITTER else 0.0

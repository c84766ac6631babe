"""Whether a simulator keeps up with real time."""

from collections import deque

from cmr.world.fleet import STEP

WINDOW = 1_000_000  # us
TOO_MANY = 10  # late steps in a window: a tenth of them
SENTENCE = (
    f"Steps come late by more than {STEP // 1000} ms: the computer is too busy. Simulate fewer robots here, or publish "
    "at a lower --rate."
)


class Lateness:
    """Counts the late steps of the last second."""

    def __init__(self) -> None:
        self._counts: deque[tuple[int, int]] = deque()

    def problem(self, utime: int, late_steps: int) -> str:
        """Return a sentence when more than a tenth of the last second's steps came late; empty otherwise.

        `late_steps` is how many came more than a step late, or were left out, until `utime` [us].
        """
        self._counts.append((utime, late_steps))
        while len(self._counts) > 2 and utime - self._counts[1][0] >= WINDOW:
            self._counts.popleft()
        return SENTENCE if late_steps - self._counts[0][1] > TOO_MANY else ""

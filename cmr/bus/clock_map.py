"""Map another computer's clock to this one's, from the arrival times of its messages.

Networks and schedulers delay messages and never advance them. The offset between the two clocks is therefore the lower
envelope of (arrival - time of sending), which over some seconds is a straight line because quartz drift is nearly
constant. The minimum delay that every message shares cannot be observed; together with the scatter of the envelope it
is the remaining uncertainty.
"""

from collections import deque
from itertools import pairwise

BLOCK = 0.5  # s; the length of a block; only its message with the least delay counts
WINDOW = 60  # blocks that the line is fitted to
DRIFT = 100e-6  # s/s by which two quartzes differ at most
FIRST_SIGHT = 0.5  # s of messages before the offset is trusted; some of them are surely on time
STEP = 0.5  # a larger change in one message means that the other clock was set [s]
# if all messages of so many blocks are late by this [s], that clock was set back by less than STEP
LATE, LATE_BLOCKS = 0.005, 8


class ClockMap:
    """The difference between this host's monotonic clock and another clock, both in s."""

    def __init__(self) -> None:
        self.restarts = 0
        self._begin()

    def _begin(self) -> None:
        self._blocks: deque[tuple[float, float]] = deque(maxlen=WINDOW)  # time there, least difference
        self._block = (0.0, 0.0)
        self._began = self._block_began = 0.0
        self._at = self._difference = self._slope = 0.0
        self._spread = 0.0
        self._is_new = True
        self._late_blocks = 0

    @property
    def is_known(self) -> bool:
        """Whether messages came for long enough."""
        return not self._is_new and self._block[0] - self._began >= FIRST_SIGHT

    @property
    def spread(self) -> float:
        """How far the least differences of the blocks lie above the line [s], for nine in ten of them."""
        return self._spread

    def add(self, sent: float, arrival: float) -> bool:
        """Add a message by its sending time there and its arrival time here [s]; return False if that clock was set."""
        difference = arrival - sent
        was_set = not self._is_new and abs(difference - self._line(sent)) > STEP and not self._is_old(sent, difference)
        if was_set:
            self.restarts += 1
            self._begin()
        if self._is_new:
            self._is_new = False
            self._began = self._block_began = sent
            self._block = (sent, difference)
            self._at, self._difference = sent, difference
            return not was_set
        if sent - self._block_began >= BLOCK:
            self._end_block(sent, difference)
        elif difference - DRIFT * (sent - self._block[0]) < self._block[1]:
            self._block = (sent, difference)
        self._difference = min(self._difference, difference - self._slope * (sent - self._at))
        return not was_set

    def here(self, there: float) -> float:
        """Return the time here [s] at a time there."""
        return there + self._line(there)

    def _line(self, there: float) -> float:
        return self._difference + self._slope * (there - self._at)

    def _is_old(self, sent: float, difference: float) -> bool:
        """Return whether a message was sent before the latest ones and only delayed."""
        return sent < self._block[0] and difference > self._line(sent) and self._block[0] - sent < 2.0 * STEP

    def _end_block(self, sent: float, difference: float) -> None:
        late = self._block[1] - self._line(self._block[0])
        self._late_blocks = self._late_blocks + 1 if late > LATE else 0
        if self._late_blocks >= LATE_BLOCKS:
            self._blocks.clear()
            self._late_blocks = 0
            self._difference = self._block[1]
            self._at = self._block[0]
        self._blocks.append(self._block)
        self._block, self._block_began = (sent, difference), sent
        self._fit()

    def _fit(self) -> None:
        """Fit a line below all blocks, with the median slope of their lower convex hull."""
        hull: list[tuple[float, float]] = []
        for point in self._blocks:
            while len(hull) >= 2 and _is_above(hull[-2], hull[-1], point):
                hull.pop()
            hull.append(point)
        middle = (hull[0][0] + hull[-1][0]) / 2.0
        slope = 0.0
        for (begin, low), (end, high) in pairwise(hull):
            if end >= middle:
                slope = (high - low) / (end - begin) if end > begin else 0.0
                break
        self._slope = min(max(slope, -DRIFT), DRIFT)
        self._at = self._blocks[-1][0]
        self._difference = min(low - self._slope * (time - self._at) for time, low in self._blocks)
        above = sorted(low - self._line(time) for time, low in self._blocks)
        self._spread = above[int(0.9 * (len(above) - 1))]


def _is_above(before: tuple[float, float], middle: tuple[float, float], after: tuple[float, float]) -> bool:
    """Return whether the middle point is not below the line from the one before it to the one after."""
    return (middle[1] - before[1]) * (after[0] - before[0]) >= (after[1] - before[1]) * (middle[0] - before[0])

"""Recent values, for sensors with latency."""

from collections import deque
from collections.abc import Sequence

Values = tuple[float, ...]


class Past:
    """Values of a robot over the last `seconds` (s), interpolated linearly between the times at which they were
    stored.
    """

    def __init__(self, seconds: float, values: Sequence[float]) -> None:
        self._seconds = seconds
        self._kept: deque[tuple[float, Values]] = deque([(0.0, tuple(values))])

    def keep(self, time: float, values: Sequence[float]) -> None:
        """Store the values at `time` (s), which never decreases; values older than twice the `seconds` are dropped."""
        self._kept.append((time, tuple(values)))
        while len(self._kept) > 2 and self._kept[1][0] <= time - 2.0 * self._seconds:
            self._kept.popleft()

    def at(self, time: float) -> Values:
        """Return the values at a time (s) up to `seconds` ago; before the first stored time, those of that time."""
        kept = self._kept
        while len(kept) > 2 and kept[1][0] <= time:
            kept.popleft()
        (begin, old), (end, new) = kept[0], kept[min(1, len(kept) - 1)]
        if not begin < time <= end:
            return old
        share = (time - begin) / (end - begin)
        return tuple(one + (other - one) * share for one, other in zip(old, new, strict=True))

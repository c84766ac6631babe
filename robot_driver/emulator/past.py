"""What a late sensor reports: values of the last moments."""

from collections import deque
from collections.abc import Sequence

Values = tuple[float, ...]


class Past:
    """Values of a robot in the last `seconds` (s), linear between the moments at which they were kept."""

    def __init__(self, seconds: float, values: Sequence[float]) -> None:
        self._seconds = seconds
        self._kept: deque[tuple[float, Values]] = deque([(0.0, tuple(values))])

    def keep(self, time: float, values: Sequence[float]) -> None:
        """Keep the values at `time` (s), which never goes back; what is older than twice the time asked for goes."""
        self._kept.append((time, tuple(values)))
        while len(self._kept) > 2 and self._kept[1][0] <= time - 2.0 * self._seconds:
            self._kept.popleft()

    def at(self, time: float) -> Values:
        """Return the values at a time (s) up to `seconds` ago; before the first moment they were as there."""
        kept = self._kept
        while len(kept) > 2 and kept[1][0] <= time:
            kept.popleft()
        (begin, old), (end, new) = kept[0], kept[min(1, len(kept) - 1)]
        if not begin < time <= end:
            return old
        share = (time - begin) / (end - begin)
        return tuple(one + (other - one) * share for one, other in zip(old, new, strict=True))

"""Measure how regularly a loop runs and how soon a device answers; report both in one sentence."""

import time
from collections import deque
from collections.abc import Callable

REMEMBERED = 1000  # cycles and round trips; 10 s at 100 Hz


class Rhythm:
    """The most recent periods of a loop and round-trip times of requests (s); thread-safe for two threads."""

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self.periods: deque[float] = deque(maxlen=REMEMBERED)
        self.round_trips: deque[float] = deque(maxlen=REMEMBERED)
        self._last_turn: float | None = None

    def note_turn(self) -> None:
        """Record the beginning of a cycle."""
        now = self._clock()
        if self._last_turn is not None:
            self.periods.append(now - self._last_turn)
        self._last_turn = now

    def pause(self) -> None:
        """Record that the loop pauses; the next cycle does not end a period."""
        self._last_turn = None

    def sentence(self) -> str:
        """Return rate and latency as text; "" while nothing was measured."""
        periods, round_trips = list(self.periods), list(self.round_trips)
        if not periods or not round_trips:
            return ""
        rate, period = len(periods) / sum(periods), 1e3 * quantile(periods, 0.99)
        median, slow = (1e3 * quantile(round_trips, share) for share in (0.5, 0.99))
        return (
            f"Motors served at {rate:.1f} Hz (99 % of periods within {period:.1f} ms); the controller answers in "
            f"{median:.1f} ms (99 % within {slow:.1f} ms)."
        )


def quantile(values: list[float], share: float) -> float:
    """Return the smallest value that is not exceeded by this share of the values."""
    return sorted(values)[min(int(share * len(values)), len(values) - 1)]

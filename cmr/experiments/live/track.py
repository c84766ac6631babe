"""Positions of robots over a run of any length, in bounded memory."""

from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

MOST_MOMENTS = 6_000
FEWEST_MOMENTS = 2_000  # half of them remain after thinning: fewer do not show a team's paths
MOST_PLACES = 2_000_000  # of all robots together, 16 MB

Integers: TypeAlias = NDArray[np.int64]
Places: TypeAlias = NDArray[np.float32]


class Track:
    """Stores the positions of `robots` at moments at least `period` [us] apart.

    When there are `most`, every second one is dropped, and the period doubles.
    """

    def __init__(self, robots: int, period: int) -> None:
        self.most = min(max(MOST_PLACES // max(robots, 1), FEWEST_MOMENTS), MOST_MOMENTS)
        self.period = period
        self._count = 0
        # Allocated once and filled, so that the memory is available: freeing it piece by piece would fragment it, and
        # memory not reserved at the start may not be available later.
        self._utime = np.full(self.most, 0, dtype=np.int64)
        self._places = np.full((self.most, 2, robots), np.nan, dtype=np.float32)

    def __len__(self) -> int:
        return self._count

    @property
    def utime(self) -> Integers:
        """The times of the moments [us], shape (moments,)."""
        return self._utime[: self._count]

    @property
    def places(self) -> Places:
        """The positions of robots at the moments [m], shape (moments, 2, robots): x and y, NaN for absent robots."""
        return self._places[: self._count]

    def add(self, utime: int, places: NDArray[np.float64]) -> None:
        """Keep the places at a moment, shape (2, robots), unless it comes too soon after the last."""
        if self._count and utime - self._utime[self._count - 1] < self.period:
            return
        if self._count == self.most:
            self._thin_out()
        self._utime[self._count], self._places[self._count] = utime, places
        self._count += 1

    def _thin_out(self) -> None:
        kept = (self._count + 1) // 2
        self._utime[:kept] = self._utime[: self._count : 2].copy()
        for number in range(kept):  # in place: a copy of all would be as large as they are
            self._places[number] = self._places[2 * number]
        self._count, self.period = kept, 2 * self.period

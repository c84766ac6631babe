"""Trails of robots: recent path segments."""

from collections import deque
from typing import NamedTuple

import numpy as np

from cmr.view.data.robots import Floats, Integers, Robots

PERIOD = 250_000  # us between the points of a trail
LONGEST = 60_000_000  # us that are kept
LEAST_STEP = 0.002  # m; a robot at rest adds no segments
LARGEST_STEP = 1.0  # m per period; a larger step means that the robot was moved by hand
MOST_PIECES = 4000  # segments shown; beyond, the oldest are dropped, as browsers draw thick lines slowly


class Trail(NamedTuple):
    """Pieces of path. `ends` (n, 2, 2): x and y [m] of both ends of each; `origin` (n): of the robot."""

    ends: Floats
    origin: Integers


class Trails:
    """The paths of all robots over the last minute."""

    def __init__(self) -> None:
        self._pieces: deque[tuple[int, Trail]] = deque()
        self._last: tuple[int, Integers, Floats] | None = None

    def due(self, now: int) -> bool:
        """Return whether it is time for another point, `now` [us]."""
        return self._last is None or now - self._last[0] >= PERIOD

    def sample(self, now: int, robots: Robots) -> None:
        """Add the robots' positions."""
        keys = robots.robot_id * 4 + robots.origin
        places = robots.pose[:2].T
        if self._last is not None:
            largest = LARGEST_STEP * max((now - self._last[0]) / PERIOD, 1.0)
            self._pieces.append((now, _pieces(self._last[1], self._last[2], keys, places, largest)))
        self._last = (now, keys, places.copy())
        while self._pieces and self._pieces[0][0] < now - LONGEST:
            self._pieces.popleft()

    def shown(self, now: int, seconds: float) -> Trail:
        """Return the segments of the last `seconds`, oldest first."""
        chosen: list[Trail] = []
        count = 0
        for utime, trail in reversed(self._pieces):
            count += len(trail.origin)
            if utime < now - seconds * 1e6 or count > MOST_PIECES:
                break
            chosen.append(trail)
        chosen.append(Trail(np.empty((0, 2, 2)), np.empty(0, np.int64)))
        chosen.reverse()
        return Trail(np.concatenate([trail.ends for trail in chosen]), np.concatenate([t.origin for t in chosen]))


def _pieces(keys: Integers, places: Floats, new_keys: Integers, new_places: Floats, largest: float) -> Trail:
    """Return the segments between two moments, for robots present at both that moved."""
    if not np.array_equal(keys, new_keys):
        keys, first, second = np.intersect1d(keys, new_keys, return_indices=True)
        places, new_places = places[first], new_places[second]
    steps = np.hypot(*(new_places - places).T)
    moved = (steps > LEAST_STEP) & (steps < largest)
    return Trail(np.stack([places[moved], new_places[moved]], axis=1), keys[moved] % 4)

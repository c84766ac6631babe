"""Delay of virtual robots, to match real ones, whose commands pass through a pilot and a driver."""

from collections import deque

import numpy as np
from numpy.typing import NDArray

from cmr.world.fleet import STEP
from cmr.world.view import VIRTUAL, Robots

Floats = NDArray[np.float64]


class Reaction:
    """Applies decisions of virtual robots `seconds` later, in whole steps of 10 ms; until then they stand.

    The robots' order never changes; new ones are appended.
    """

    def __init__(self, seconds: float = 0.0) -> None:
        steps = round(seconds * 1e6 / STEP)
        self._past = deque([np.zeros((0, 2))] * (steps + 1), maxlen=steps + 1)
        self._robots: tuple[int, ...] | None = None
        self._virtual: NDArray[np.bool_] = np.zeros((0, 1), dtype=bool)

    def late(self, duties: Floats, robots: Robots) -> Floats:
        """Return the delayed duties (n, 2) for the next step; `duties` are the present decisions of `robots`."""
        if self._past.maxlen == 1:
            return duties
        if robots.robot_id is not self._robots:
            self._robots, self._virtual = robots.robot_id, np.array(robots.origin)[:, None] == VIRTUAL
        self._past.append(np.array(duties))
        then, late = self._past[0], np.zeros_like(duties)
        late[: len(then)] = then
        return np.where(self._virtual, late, duties)

"""Limit duties to the range that robots accept."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cmr.world.lazy_module import LazyModule

robot_loops = LazyModule("cmr.world.robot_loops")


def bounded(duties: ArrayLike) -> NDArray[np.float64]:
    """Return duties (n, 2) clipped to [-1, 1]; a robot with a NaN gets 0."""
    sides = np.ascontiguousarray(np.asarray(duties, dtype=float).T)
    within = np.empty(sides.shape)
    robot_loops.bound(sides, within)
    return within.T

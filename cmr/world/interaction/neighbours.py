"""Who is near whom: neighbours within a radius, and where each sees them."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cmr.model.body import wrap
from cmr.model.compiled import compiled
from cmr.world.interaction.cells import close_pairs

Floats = NDArray[np.float64]
Indices = NDArray[np.int32]
FURTHEST = 1e12  # m; positions further from the origin, and larger radii, are mistakes


@dataclass(frozen=True)
class Neighbours:
    """Those of robot i are `index[start[i]:start[i + 1]]`, ascending, without i itself; `start` has n + 1 entries."""

    start: NDArray[np.int64]
    index: Indices

    def of(self, robot: int) -> Indices:
        """Return the neighbours of one robot."""
        return self.index[self.start[robot] : self.start[robot + 1]]

    def each(self) -> NDArray[np.int64]:
        """Return for every entry of `index` the robot whose neighbour it is."""
        return np.repeat(np.arange(len(self.start) - 1), np.diff(self.start))


def pairs_within(x: Any, y: Any, radius: float) -> Neighbours:
    """Return for each of n robots at (x, y) [m] those at most `radius` [m] away.

    Time and memory grow with the number of robots and of pairs found. Raises ValueError for positions of unequal
    number, that are no numbers or beyond 1e12 m, and for such a radius.
    """
    x, y = checked_positions(x, y)
    if not 0.0 <= radius <= FURTHEST:
        raise ValueError(f"the radius must be a number from 0 to {FURTHEST:g} m, not {radius}")
    return neighbours_of(x, y, float(radius))


def neighbours_of(x: Floats, y: Floats, radius: float) -> Neighbours:
    """Return the same for positions and a radius that are known to be sound."""
    if len(x) == 0:
        return Neighbours(np.zeros(1, np.int64), np.zeros(0, np.int32))
    return Neighbours(*_neighbours(x, y, radius))


def range_and_bearing(x: Any, y: Any, theta: Any, neighbours: Neighbours) -> tuple[Floats, Floats]:
    """Return distance [m] and bearing [rad] of every neighbour, in the order of `neighbours.index`.

    Bearings are seen from each robot itself: 0 ahead, positive to its left, in (-pi, pi].
    """
    x, y, theta = (np.asarray(values, dtype=float) for values in (x, y, theta))
    me, other = neighbours.each(), neighbours.index
    dx, dy = x[other] - x[me], y[other] - y[me]
    return np.hypot(dx, dy), np.asarray(wrap(np.arctan2(dy, dx) - theta[me]))


def checked_positions(x: Any, y: Any) -> tuple[Floats, Floats]:
    """Return positions [m] as the compiled functions take them.

    Raises ValueError where they differ in number, are no numbers or lie beyond 1e12 m.
    """
    x, y = (np.ascontiguousarray(values, dtype=float) for values in (x, y))
    if x.ndim != 1 or x.shape != y.shape:
        raise ValueError(f"x and y must be lists of the same length, not of shapes {x.shape} and {y.shape}")
    for name, values in (("x", x), ("y", y)):
        wrong = np.flatnonzero(~(np.abs(values) <= FURTHEST))
        if len(wrong):
            raise ValueError(
                f"{name} of robot {wrong[0]} is {values[wrong[0]]}; a position is a number of at most {FURTHEST:g} m"
            )
    return x, y


@compiled("Tuple((i8[::1], i4[::1]))(f8[::1], f8[::1], f8)")
def _neighbours(x: Floats, y: Floats, radius: float) -> Any:
    """Return `start` and `index` of Neighbours."""
    first, second = close_pairs(x, y, radius)
    return _listed(first, second, len(x))


@compiled("Tuple((i8[::1], i4[::1]))(i4[::1], i4[::1], i8)")
def _listed(first: Indices, second: Indices, n: int) -> Any:
    """Return `start` and `index` of Neighbours from pairs of n robots in any order."""
    start = np.zeros(n + 1, np.int64)
    for k in range(len(first)):
        start[first[k] + 1] += 1
        start[second[k] + 1] += 1
    for i in range(n):
        start[i + 1] += start[i]
    mixed = np.empty(2 * len(first), np.int32)
    index = np.empty(2 * len(first), np.int32)
    filled = start[:-1].copy()
    for k in range(len(first)):
        i, j = first[k], second[k]
        mixed[filled[i]], mixed[filled[j]] = j, i
        filled[i] += 1
        filled[j] += 1
    # Who is i's neighbour has i for a neighbour: going through all i in order, each list is filled in order.
    filled[:] = start[:-1]
    for i in range(n):
        for k in range(start[i], start[i + 1]):
            j = mixed[k]
            index[filled[j]] = i
            filled[j] += 1
    return start, index

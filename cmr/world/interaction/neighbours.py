"""Neighbours of robots within a radius, with range and bearing."""

from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cmr.model.body import wrap
from cmr.model.compiled import compiled
from cmr.world.interaction.cells import close_pairs

Floats = NDArray[np.float64]
Indices = NDArray[np.int32]
Lists: TypeAlias = tuple[NDArray[np.int64], Indices]  # `start` and `index` of Neighbours
SKIN = 0.25  # m; robots up to this much beyond the radius are listed, too
LISTS_HOLD = 0.49 * SKIN  # m; displacement up to which lists stay valid, with a reserve for rounding
FURTHEST = 1e12  # m; positions further from the origin, and larger radii, are mistakes


@dataclass(frozen=True)
class Neighbours:
    """Neighbour lists; those of robot i are `index[start[i]:start[i + 1]]`, ascending, without i itself; `start` has n
    + 1 entries.
    """

    start: NDArray[np.int64]
    index: Indices

    def of(self, robot: int) -> Indices:
        """Return the neighbours of one robot."""
        return self.index[self.start[robot] : self.start[robot + 1]]

    def each(self) -> NDArray[np.int64]:
        """Return for every entry of `index` the robot whose neighbour it is."""
        return np.repeat(np.arange(len(self.start) - 1), np.diff(self.start))


def pairs_within(x: ArrayLike, y: ArrayLike, radius: float) -> Neighbours:
    """Return for each of n robots at (x, y) [m] those at most `radius` [m] away.

    Time and memory grow with the number of robots and of pairs found. Raises ValueError if x and y differ in length, or
    if a position or the radius is not finite or beyond 1e12 m.
    """
    x, y = checked_positions(x, y)
    if not 0.0 <= radius <= FURTHEST:
        raise ValueError(f"the radius must be a number from 0 to {FURTHEST:g} m, not {radius}")
    if len(x) == 0:
        return Neighbours(np.zeros(1, np.int64), np.zeros(0, np.int32))
    return Neighbours(*_neighbours(x, y, float(radius)))


class NearList:
    """Neighbours within a radius, step after step, from lists with a margin.

    A list stays valid until a robot has moved further than the margin allows.
    """

    def __init__(self, radius: float) -> None:
        self._radius = radius
        self._members: object = None
        self._places: Floats = np.zeros((2, 0))
        self._pairs: tuple[Indices, Indices] = (np.zeros(0, np.int32), np.zeros(0, np.int32))

    def neighbours(self, members: object, x: Floats, y: Floats) -> Neighbours:
        """Return for each robot at (x, y) [m] those within the radius; positions must be finite.

        `members` is the same object as long as the robots and their order are the same.
        """
        if members is not self._members:
            self._look_around(members, x, y)
        holds, start, index = _still_near(x, y, self._radius, self._places, *self._pairs)
        if not holds:
            self._look_around(members, x, y)
            _, start, index = _still_near(x, y, self._radius, self._places, *self._pairs)
        return Neighbours(start, index)

    def _look_around(self, members: object, x: Floats, y: Floats) -> None:
        self._members, self._places = members, np.array([x, y])
        if len(x):
            self._pairs = close_pairs(x, y, self._radius + SKIN)


def range_and_bearing(x: ArrayLike, y: ArrayLike, theta: ArrayLike, neighbours: Neighbours) -> tuple[Floats, Floats]:
    """Return distance [m] and bearing [rad] of every neighbour, in the order of `neighbours.index`.

    Bearings are seen from each robot itself: 0 ahead, positive to its left, in (-pi, pi].
    """
    x, y, theta = (np.asarray(values, dtype=float) for values in (x, y, theta))
    me, other = neighbours.each(), neighbours.index
    dx, dy = x[other] - x[me], y[other] - y[me]
    return np.hypot(dx, dy), np.asarray(wrap(np.arctan2(dy, dx) - theta[me]))


def checked_positions(x: ArrayLike, y: ArrayLike) -> tuple[Floats, Floats]:
    """Convert positions [m] to arrays for the compiled functions.

    Raises ValueError if they differ in length, are not finite or lie beyond 1e12 m.
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
def _neighbours(x: Floats, y: Floats, radius: float) -> Lists:
    """Return `start` and `index` of Neighbours."""
    first, second = close_pairs(x, y, radius)
    return _listed(first, second, len(x))


@compiled("Tuple((b1, i8[::1], i4[::1]))(f8[::1], f8[::1], f8, f8[:, ::1], i4[::1], i4[::1])")
def _still_near(
    x: Floats, y: Floats, radius: float, places: Floats, first: Indices, second: Indices
) -> tuple[bool, NDArray[np.int64], Indices]:
    """Return whether the pairs listed for positions `places` (2, n) [m] are still valid, and which of them are near
    now.

    The pairs are returned as `start` and `index` of Neighbours; empty if the list is no longer valid.
    """
    furthest = 0.0
    for i in range(len(x)):
        dx, dy = x[i] - places[0, i], y[i] - places[1, i]
        furthest = max(furthest, dx * dx + dy * dy)
    holds = furthest <= LISTS_HOLD * LISTS_HOLD
    near, found = np.empty((2, len(first)), np.int32), 0
    for k in range(len(first) if holds else 0):
        i, j = first[k], second[k]
        dx, dy = x[j] - x[i], y[j] - y[i]
        near[0, found], near[1, found] = i, j
        found += dx * dx + dy * dy <= radius * radius
    start, index = _listed(near[0, :found], near[1, :found], len(x))
    return holds, start, index


@compiled("Tuple((i8[::1], i4[::1]))(i4[::1], i4[::1], i8)")
def _listed(first: Indices, second: Indices, n: int) -> Lists:
    """Return `start` and `index` of Neighbours from pairs of n robots in any order."""
    start = np.zeros(n + 1, np.int64)
    for k in range(len(first)):
        start[first[k] + 1] += 1
        start[second[k] + 1] += 1
    for i in range(n):
        start[i + 1] += start[i]
    mixed = np.empty(2 * len(first), np.int32)
    index = np.empty(2 * len(first), np.int32)
    filled = np.empty(n, np.int64)  # loops, because slices take seconds to compile
    for i in range(n):
        filled[i] = start[i]
    for k in range(len(first)):
        i, j = first[k], second[k]
        mixed[filled[i]], mixed[filled[j]] = j, i
        filled[i] += 1
        filled[j] += 1
    # The relation is symmetric: going through all i in order fills each list in ascending order.
    for i in range(n):
        filled[i] = start[i]
    for i in range(n):
        for k in range(start[i], start[i + 1]):
            j = mixed[k]
            index[filled[j]] = i
            filled[j] += 1
    return start, index

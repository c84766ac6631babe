"""Obstacles and geofences: discs, walls, and polygons."""

from collections.abc import Iterable, Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

Floats = NDArray[np.float64]
FURTHEST = 1e6  # m; larger coordinates are mistakes


class ObstacleError(ValueError):
    """An obstacle or geofence is invalid; the text says which, and why."""


class Obstacles:
    """Immovable objects, in the world frame.

    `discs` (3, n): x, y, radius [m]. `walls` (4, n): x1, y1, x2, y2 [m] of straight walls without thickness. Raises
    ObstacleError for a radius that is not above 0, a wall without length, and NaN.
    """

    def __init__(self, discs: Iterable[Sequence[float]] = (), walls: Iterable[Sequence[float]] = ()) -> None:
        self.discs = _columns("disc", discs, ("x", "y", "radius"))
        self.walls = _columns("wall", walls, ("x1", "y1", "x2", "y2"))
        for i, radius in enumerate(self.discs[2]):
            if radius <= 0.0:
                raise ObstacleError(f"disc {i}: the radius must be above 0, not {radius:g} m")
        for i, (x1, y1, x2, y2) in enumerate(self.walls.T):
            if x1 == x2 and y1 == y2:
                raise ObstacleError(f"wall {i} begins and ends at ({x1:g}, {y1:g}) m: give two different points")

    @classmethod
    def none(cls) -> "Obstacles":
        """Return an empty floor."""
        return cls()

    def __len__(self) -> int:
        return len(self.discs.T) + len(self.walls.T)


class Geofence:
    """A polygon [m; world frame] that robots stay inside of; its corners in order, without repeating the first.

    `outline` (2, n): x, y [m] of the corners. Raises ObstacleError for fewer than three corners, sides that cross or
    touch, and NaN.
    """

    def __init__(self, corners: Iterable[Sequence[float]]) -> None:
        self.outline = _columns("corner", corners, ("x", "y"))
        self._x, self._y = self.outline
        if len(self._x) < 3:
            raise ObstacleError(f"a geofence needs at least 3 corners, not {len(self._x)}")
        self._next_x, self._next_y = np.roll(self._x, -1), np.roll(self._y, -1)
        self._dx, self._dy = self._next_x - self._x, self._next_y - self._y
        self._refuse_crossings()

    def contains(self, x: ArrayLike, y: ArrayLike) -> np.bool_ | NDArray[np.bool_]:
        """Return whether points [m] lie inside; False for NaN. Shapes as x and y broadcast."""
        at_x, at_y = (np.asarray(values, dtype=float)[..., np.newaxis] for values in (x, y))
        # A ray from the point along +x crosses an odd number of sides exactly if the point is inside.
        spans = (self._y > at_y) != (self._next_y > at_y)
        with np.errstate(divide="ignore", invalid="ignore"):
            crossing = self._x + (at_y - self._y) * self._dx / self._dy
        inside: np.bool_ | NDArray[np.bool_] = (np.count_nonzero(spans & (at_x < crossing), axis=-1) % 2 == 1)[()]
        return inside

    def distance(self, x: ArrayLike, y: ArrayLike) -> np.float64 | NDArray[np.float64]:
        """Return how far [m] points are from the border, whichever side they are on; NaN for NaN."""
        at_x, at_y = (np.asarray(values, dtype=float)[..., np.newaxis] for values in (x, y))
        along = ((at_x - self._x) * self._dx + (at_y - self._y) * self._dy) / (self._dx**2 + self._dy**2)
        share = np.clip(along, 0.0, 1.0)
        away = np.hypot(self._x + share * self._dx - at_x, self._y + share * self._dy - at_y)
        nearest: np.float64 | NDArray[np.float64] = np.min(away, axis=-1)[()]
        return nearest

    def _refuse_crossings(self) -> None:
        """Raise ObstacleError for a side of length 0, or one that meets a side other than its neighbours."""
        n = len(self._x)
        for i in range(n):
            if self._dx[i] == 0.0 and self._dy[i] == 0.0:
                raise ObstacleError(f"corners {i} and {(i + 1) % n} of the geofence are the same point")
            for j in range(i + 1, n):
                if (j - i) % n in (1, n - 1):
                    continue
                if self._sides_meet(i, j):
                    raise ObstacleError(
                        f"sides {i} and {j} of the geofence meet: give its corners in order along the border"
                    )

    def _sides_meet(self, i: int, j: int) -> bool:
        def side_of(k: int, x: float, y: float) -> float:
            return float(np.sign(self._dx[k] * (y - self._y[k]) - self._dy[k] * (x - self._x[k])))

        apart_i = side_of(i, self._x[j], self._y[j]) * side_of(i, self._next_x[j], self._next_y[j])
        apart_j = side_of(j, self._x[i], self._y[i]) * side_of(j, self._next_x[i], self._next_y[i])
        if apart_i or apart_j:
            return apart_i <= 0.0 and apart_j <= 0.0
        return self._boxes_meet(i, j)

    def _boxes_meet(self, i: int, j: int) -> bool:
        """Return whether the boxes around two sides meet; those of sides on one line do exactly if the sides do."""
        return all(
            min(here[i], there[i]) <= max(here[j], there[j]) and min(here[j], there[j]) <= max(here[i], there[i])
            for here, there in ((self._x, self._next_x), (self._y, self._next_y))
        )


def _columns(what: str, rows: Iterable[Sequence[float]], names: tuple[str, ...]) -> Floats:
    """Return rows of numbers as columns, one array row for each name.

    Raises ObstacleError naming the first that cannot be used.
    """
    result = []
    for i, row in enumerate(rows):
        try:
            numbers = [float(value) for value in row]
        except (TypeError, ValueError):
            numbers = []
        if len(numbers) != len(names) or not all(abs(number) <= FURTHEST for number in numbers):
            raise ObstacleError(
                f"{what} {i} is {row!r}; it takes {', '.join(names)}: numbers in m, none beyond {FURTHEST:g}"
            )
        result.append(numbers)
    return np.ascontiguousarray(np.array(result, dtype=float).reshape(-1, len(names)).T)

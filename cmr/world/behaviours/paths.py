"""Paths of many robots: rows of points."""

import numpy as np

from cmr.world.behaviours.team import Floats, Indices

SHORTEST = 0.04  # m between points; nearer ones are left out
ROOM = 32  # points of a path for which there is room at first; it doubles whenever it is used up


class Paths:
    """Rows of points [m; world frame], each row as long as it is; `along` [m] is the length up to each point."""

    def __init__(self) -> None:
        self.x: Floats = np.zeros((0, ROOM))
        self.y: Floats = np.zeros((0, ROOM))
        self.along: Floats = np.zeros((0, ROOM))
        self.count: Indices = np.zeros(0, np.int64)

    def make_room(self, rows: int, points: int) -> None:
        """See to it that there are so many rows and that each has room for so many points."""
        old_rows, old_points = self.x.shape
        if rows <= old_rows and points <= old_points:
            return
        more_rows = max(2 * old_rows, rows) - old_rows if rows > old_rows else 0
        more_points = max(2 * old_points, points) - old_points if points > old_points else 0
        room = ((0, more_rows), (0, more_points))
        self.x, self.y, self.along = (np.pad(values, room) for values in (self.x, self.y, self.along))
        self.count = np.pad(self.count, (0, more_rows))

    def put(self, row: int, x: list[float], y: list[float]) -> None:
        """Replace one path; points nearer than SHORTEST to the one before are left out, except for the last."""
        from cmr.world.behaviours.path_following import thin  # imports Numba, which takes half a second

        points = np.array([x, y], dtype=float)
        count = thin(points, SHORTEST)
        self.make_room(row + 1, count)
        self.count[row] = count
        self.x[row, :count], self.y[row, :count] = kept = points[:, :count]
        self.along[row, :count] = np.cumsum(np.append(0.0, np.hypot(*np.diff(kept))))[:count]

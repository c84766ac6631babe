"""Paths of many robots: rows of points."""

import numpy as np

from cmr.world.behaviours.team import Floats, Indices
from cmr.world.lazy_module import LazyModule

path_following = LazyModule("cmr.world.behaviours.path_following")
SHORTEST = 0.04  # m between points; nearer ones are dropped
ROOM = 32  # initial capacity in points; doubled when full
X, Y, ALONG, ALONE = range(4)  # columns of a point
TARGET = 3  # index, in the points around a robot, of its target segment's first point; its current segment comes before


class Paths:
    """Rows of points [m; world frame], with a length of its own for each row.

    `points` (rows, room, 4) are x, y and the length [m] of the path up to each point, and ALONE: the distance [m] to
    the segment that begins there within which no segment a short way ahead, except the next, can be as near. `length`
    (rows,) [m] are the lengths of the whole paths. `around` (rows, 5, 4) are copies of the points around each robot, as
    `pursue` keeps them; ALONE of the first is 0 where there are none.
    """

    def __init__(self) -> None:
        self.points: Floats = np.zeros((0, ROOM, 4))
        self.count: Indices = np.zeros(0, np.int64)
        self.length: Floats = np.zeros(0)
        self.around: Floats = np.zeros((0, TARGET + 2, 4))

    @property
    def arrays(self) -> tuple[Floats, Indices, Floats, Floats]:
        """The arrays for compiled functions: points, count, length, around."""
        return self.points, self.count, self.length, self.around

    @property
    def room(self) -> int:
        """The capacity of each row in points."""
        return int(self.points.shape[1])

    def make_room(self, rows: int, points: int) -> None:
        """Grow the arrays to at least this many rows and points."""
        old_rows, old_points, _ = self.points.shape
        if rows <= old_rows and points <= old_points:
            return
        more_rows = max(2 * old_rows, rows) - old_rows if rows > old_rows else 0
        # An odd number, so that the same points of many rows do not map to the same cache lines.
        more_points = (max(2 * old_points, points) | 1) - old_points if points > old_points else 0
        self.points = np.pad(self.points, ((0, more_rows), (0, more_points), (0, 0)))
        self.count, self.length = np.pad(self.count, (0, more_rows)), np.pad(self.length, (0, more_rows))
        self.around = np.pad(self.around, ((0, more_rows), (0, 0), (0, 0)))

    def put(self, row: int, x: list[float], y: list[float]) -> None:
        """Replace one path; points nearer than SHORTEST to the one before are dropped, except for the last."""
        points = np.array([x, y], dtype=float)
        count = path_following.thin(points, SHORTEST)
        self.make_room(row + 1, count)
        self.count[row] = count
        kept = points[:, :count]
        self.points[row, :count, :ALONG] = kept.T
        self.points[row, :count, ALONG] = np.cumsum(np.append(0.0, np.hypot(*np.diff(kept))))[:count]
        self.length[row] = self.points[row, count - 1, ALONG] if count else 0.0
        self.around[row] = 0.0
        path_following.look_around(self.points, row, 0, count - 1)

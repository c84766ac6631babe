"""Paths of many robots: rows of points."""

import numpy as np

from cmr.world.behaviours.team import Floats, Indices
from cmr.world.lazy_module import LazyModule

path_following = LazyModule("cmr.world.behaviours.path_following")
SHORTEST = 0.04  # m between points; nearer ones are left out
ROOM = 32  # points of a path for which there is room at first; it doubles whenever it is used up
X, Y, ALONG, ALONE = range(4)  # what is known of each point
TARGET = 3  # of the points around a robot, the first of the piece that it heads for; before are those it is between


class Paths:
    """Rows of points [m; world frame], each row as long as it is.

    `points` (rows, room, 4) are x, y and the length [m] of the path up to each point, and in ALONE how near [m] a robot
    must be to the piece that begins there so that none of the pieces a little ahead, but the next, can be as near.
    `length` (rows,) [m] are the lengths of the whole paths. `around` (rows, 5, 4) are copies of the points around each
    robot, as `pursue` keeps them; ALONE of the first is 0 where there are none.
    """

    def __init__(self) -> None:
        self.points: Floats = np.zeros((0, ROOM, 4))
        self.count: Indices = np.zeros(0, np.int64)
        self.length: Floats = np.zeros(0)
        self.around: Floats = np.zeros((0, TARGET + 2, 4))

    @property
    def arrays(self) -> tuple[Floats, Indices, Floats, Floats]:
        """What the compiled functions take: points, count, length, around."""
        return self.points, self.count, self.length, self.around

    @property
    def room(self) -> int:
        """For how many points there is room in each row."""
        return int(self.points.shape[1])

    def make_room(self, rows: int, points: int) -> None:
        """See to it that there are so many rows and that each has room for so many points."""
        old_rows, old_points, _ = self.points.shape
        if rows <= old_rows and points <= old_points:
            return
        more_rows = max(2 * old_rows, rows) - old_rows if rows > old_rows else 0
        # An odd number, so that the same points of many rows do not fight for the same few places of a cache.
        more_points = (max(2 * old_points, points) | 1) - old_points if points > old_points else 0
        self.points = np.pad(self.points, ((0, more_rows), (0, more_points), (0, 0)))
        self.count, self.length = np.pad(self.count, (0, more_rows)), np.pad(self.length, (0, more_rows))
        self.around = np.pad(self.around, ((0, more_rows), (0, 0), (0, 0)))

    def put(self, row: int, x: list[float], y: list[float]) -> None:
        """Replace one path; points nearer than SHORTEST to the one before are left out, except for the last."""
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

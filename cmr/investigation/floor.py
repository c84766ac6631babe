"""Where the robot may be: inside a polygon, away from its border, from obstacles, and from other robots."""

import math
from collections.abc import Sequence

import numpy as np

from cmr.geometry.obstacles import Geofence, Obstacles
from cmr.recordings.signal import Floats

MARGIN = 0.14  # m between the robot's centre and the border: half a small robot, and the error of predictions
ROBOT_RADIUS = 0.12  # m, of another robot


class Floor:
    """The floor of a robot: its centre keeps `margin` [m] from the border of `fence` and from obstacles."""

    def __init__(self, fence: Geofence, *, margin: float = MARGIN, obstacles: Obstacles | None = None) -> None:
        self.fence, self.margin = fence, margin
        self.obstacles = obstacles or Obstacles.none()

    @property
    def middle(self) -> tuple[float, float]:
        """The point [m; world frame] of a coarse grid that is furthest from all borders."""
        x, y = self.fence.outline
        grid = np.meshgrid(np.linspace(x.min(), x.max(), 41), np.linspace(y.min(), y.max(), 41))
        room = self.room(*grid)
        best = np.unravel_index(int(np.argmax(room)), room.shape)
        return float(grid[0][best]), float(grid[1][best])

    @property
    def extent(self) -> float:
        """Half of the floor's larger side [m]."""
        return 0.5 * float(np.max(np.ptp(self.fence.outline, axis=1)))

    def with_robots(self, places: Sequence[tuple[float, float]]) -> "Floor":
        """Return the floor on which other robots stand at these places [m; world frame]."""
        discs = [*self.obstacles.discs.T.tolist(), *([x, y, ROBOT_RADIUS] for x, y in places)]
        obstacles = Obstacles(discs, self.obstacles.walls.T.tolist())
        return Floor(self.fence, margin=self.margin, obstacles=obstacles)

    def room(self, x: Floats, y: Floats) -> Floats:
        """Return the distance [m] of places from obstacles and borders beyond the required one; below 0 if too near.

        A place that is not a number has minus infinity. The shape is that of x and y.
        """
        away = self.fence.distance(x, y)
        room = np.where(self.fence.contains(x, y), away, -away)
        for disc in self.obstacles.discs.T:
            room = np.minimum(room, np.hypot(x - disc[0], y - disc[1]) - disc[2])
        for wall in self.obstacles.walls.T:
            room = np.minimum(room, _from_wall(x, y, wall))
        return np.asarray(np.where(np.isfinite(room), room - self.margin, -math.inf))


def _from_wall(x: Floats, y: Floats, wall: Floats) -> Floats:
    """Return how far [m] places are from a wall x1, y1, x2, y2."""
    along = wall[2:] - wall[:2]
    share = np.clip(((x - wall[0]) * along[0] + (y - wall[1]) * along[1]) / float(along @ along), 0.0, 1.0)
    return np.asarray(np.hypot(x - wall[0] - share * along[0], y - wall[1] - share * along[1]))

"""A leader: drives a figure-eight, so that others can follow and be calibrated on it."""

import math

import numpy as np

from cmr.world.behaviours.seeking import CLEARANCE
from cmr.world.behaviours.waypoints import MOST_POINTS, Path, Waypoints

POINTS = 200  # of one figure-eight


def figure_eight(x: float, y: float, theta: float, size: float, laps: int = 1) -> Path:
    """Return the points [m; world frame] of a figure-eight that starts and ends at its crossing.

    The curve is Gerono's lemniscate, `size` [m] from the crossing to each tip; the robot leaves (x, y) with heading
    `theta` [rad], turns right through the first lobe and left through the second.
    """
    t = np.linspace(0.0, 2.0 * np.pi * laps, POINTS * laps + 1)
    along, across = size * np.sin(t), size * np.sin(t) * np.cos(t)
    rotation = theta - math.pi / 4.0  # the curve leaves its crossing at 45 degrees
    return (
        (x + along * math.cos(rotation) - across * math.sin(rotation)).tolist(),
        (y + along * math.sin(rotation) + across * math.cos(rotation)).tolist(),
    )


class FigureEight(Waypoints):
    """Drive a figure-eight of `size` [m] at `speed` [m/s] `laps` times, `start` [s] after the beginning, then stop.

    Waypoints received later replace the path. With laps=0 the robot waits for them.
    """

    def __init__(
        self,
        size: float = 0.7,
        speed: float = 0.3,
        laps: int = 1,
        start: float = 2.0,
        clearance: float = CLEARANCE,
    ) -> None:
        if size <= 0.0 or speed <= 0.0 or not 0 <= laps <= MOST_POINTS // POINTS:
            raise ValueError(f"size and speed must be above 0, laps 0 to {MOST_POINTS // POINTS}")
        super().__init__(speed=speed, clearance=clearance)
        self.size, self.laps, self.start = size, laps, start
        self._began: dict[int, int] = {}  # [us], by row

    def begins(self, utime: int, row: int, x: float, y: float, theta: float) -> Path | None:
        """Return the figure-eight from this pose [m, m, rad], once its time has come."""
        waited = utime - self._began.setdefault(row, utime)
        if not self.laps or waited < self.start * 1e6:
            return None
        return figure_eight(x, y, theta, self.size, self.laps)

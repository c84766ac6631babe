"""A leader: drives a figure-eight, so that others can follow and be calibrated on it."""

import math
from collections.abc import Sequence

import numpy as np

from cmr.geometry.figures import LENGTH, POINTS, figure_eight
from cmr.world.behaviours.paths import SHORTEST
from cmr.world.behaviours.seeking import CLEARANCE, Goals, Team
from cmr.world.behaviours.waypoints import MOST_POINTS, Path, Waypoints
from cmr.world.view import Robots, WorldView

# At a single speed, friction, drag and battery sag look like a different k1, and slip that grows with turning like a
# different base width; two speeds separate them.
SPEEDS = "0.2/0.5"  # m/s, of the calibration drive


def read_speeds(text: str) -> tuple[float, ...]:
    """Return the speeds [m/s] of `0.3` or `0.2/0.5`. Raises ValueError for anything else."""
    try:
        speeds = tuple(float(part) for part in text.split("/"))
    except ValueError:
        speeds = ()
    if not speeds or not all(0.0 < speed < math.inf for speed in speeds):
        raise ValueError(f"speeds are written as speed=0.3 or speed=0.2/0.5, in m/s, each above 0; {text!r} is not")
    return speeds


def seconds_of(length: float, speeds: Sequence[float]) -> float:
    """Return the duration [s] of a path of this length [m] driven at each of these speeds for the same time."""
    return length * len(speeds) / sum(speeds)


def laps_within(seconds: float, size: float, speeds: Sequence[float]) -> int:
    """Return the number of whole figure-eights of `size` [m] that comes nearest to this duration [s]; at least 1."""
    return max(1, round(seconds / seconds_of(LENGTH * size, speeds)))


class FigureEight(Waypoints):
    """Drive a figure-eight of `size` [m] `laps` times, `start` [s] after the start, then stop.

    `speed` [m/s] is one speed, or several, as in `speed=0.2/0.5`: one after the other, each for the same time, without
    a stop between. Waypoints received later replace the path. With laps=0 the robot waits for them.
    """

    def __init__(
        self,
        size: float = 0.7,
        speed: str | float = SPEEDS,
        laps: int = 1,
        start: float = 2.0,
        clearance: float = CLEARANCE,
    ) -> None:
        if size <= 0.0 or not 0 <= laps <= MOST_POINTS // POINTS:
            raise ValueError(f"size must be above 0, laps 0 to {MOST_POINTS // POINTS}")
        self.speeds = np.array(read_speeds(str(speed)))
        super().__init__(speed=float(self.speeds.max()), clearance=clearance)
        self.size, self.laps, self.start = size, laps, start
        self._began: dict[int, int] = {}  # [us], by row

    def goals(self, utime: int, team: Team, me: Robots, world: WorldView) -> Goals:
        """Return targets, and the speed of the part of the path that each robot is on."""
        goals = super().goals(utime, team, me, world)
        if len(self.speeds) > 1:
            share = self.memory["progress"][team.row] / np.maximum(self._paths.length[team.row], SHORTEST)
            borders = np.cumsum(self.speeds)[:-1] / self.speeds.sum()  # equal time at each speed
            np.minimum(goals.speed, self.speeds[np.searchsorted(borders, share, side="right")], out=goals.speed)
        return goals

    def begins(self, utime: int, row: int, x: float, y: float, theta: float) -> Path | None:
        """Return the figure-eight from this pose [m, m, rad], once `start` has passed."""
        waited = utime - self._began.setdefault(row, utime)
        if not self.laps or waited < self.start * 1e6:
            return None
        return figure_eight(x, y, theta, self.size, self.laps)

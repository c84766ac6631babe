"""A leader: drives a path, by default a figure-eight, so that others can follow and be calibrated on it."""

import math

import numpy as np

from cmr.model.parameters import RobotParameters
from cmr.world.behaviours.behaviour import Behaviour
from cmr.world.behaviours.pursuit import Path, steer
from cmr.world.view import Robot, WorldView

LOOK_AHEAD = 0.15  # m
ARRIVED = 0.02  # m before the end of the path
POINTS = 200  # of one figure-eight
ACCELERATION = 0.5  # m/s^2


def figure_eight(x: float, y: float, theta: float, size: float, laps: int = 1) -> tuple[list[float], list[float]]:
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


class FigureEight(Behaviour):
    """Drive a figure-eight of `size` [m] at `speed` [m/s] `laps` times, `start` [s] after the beginning, then stop.

    Waypoints received later replace the path. With laps=0 the robot waits for them.
    """

    def __init__(self, size: float = 0.7, speed: float = 0.3, laps: int = 1, start: float = 2.0) -> None:
        if size <= 0.0 or speed <= 0.0 or laps < 0:
            raise ValueError("size and speed must be above 0, laps 0 or more")
        self.size, self.speed, self.laps, self.start = size, speed, laps, start
        self._path: Path | None = None
        self._began: int | None = None
        self._last_utime = 0
        self._current_speed = 0.0

    def take_waypoints(self, x: list[float], y: list[float]) -> None:
        """Drive this path from now on."""
        self.laps = 0
        self._path = Path() if x else None
        for point in zip(x, y, strict=True):
            self._path.append(*point) if self._path else None

    def command(self, utime: int, me: Robot, _world: WorldView, parameters: RobotParameters) -> tuple[float, float]:
        """Return the duties that keep the robot on its path."""
        self._began = self._began or utime
        if self._path is None and self.laps and utime - self._began >= self.start * 1e6:
            self.take_waypoints(*figure_eight(me.state.x, me.state.y, me.state.theta, self.size, self.laps))
        dt, self._last_utime = min((utime - self._last_utime) * 1e-6, 0.1), utime
        if self._path is None:
            self._current_speed = 0.0
            return 0.0, 0.0
        self._path.advance(me.state.x, me.state.y)
        remaining = self._path.length - self._path.progress
        if remaining < ARRIVED:
            self._path = None
            return 0.0, 0.0
        slow_enough_to_stop = math.sqrt(2.0 * ACCELERATION * remaining)
        self._current_speed = min(self._current_speed + ACCELERATION * dt, self.speed, slow_enough_to_stop)
        return steer(me, self._path.at(self._path.progress + LOOK_AHEAD), self._current_speed, parameters)

"""Metrics of a team experiment: small functions of the robots' trajectories.

`x` and `y` [m; world frame] have a row for each moment and a column for each robot, shape (t, n); `time` [s], shape
(t,), counts from the start of the experiment. An undefined metric is NaN.
"""

import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
UNITS = {
    "formation_error": "m",
    "time_to_goal": "s",
    "minimum_separation": "m",
    "path_spread": "m",
    "distance_driven": "m",
}
ARRIVED = 0.1  # m; distance at which a robot has reached its goal, the last of its waypoints
PASSED = 0.15  # m; distance at which it has passed earlier waypoints: robots that look ahead cut corners

Way = Sequence[tuple[float, float]]  # waypoints [m]


class Bond(NamedTuple):
    """One robot's place relative to another: columns of both, and the desired distance [m].

    `follows` says whether the robot should drive on the other's path.
    """

    robot: int
    leader: int
    distance: float
    follows: bool = True


def formation_error(x: Floats, y: Floats, bonds: Sequence[Bond]) -> float:
    """Return the RMS, over time and bonds, of the distance between two robots minus the desired one [m]."""
    if not bonds:
        return float("nan")
    errors = [np.hypot(x[:, a] - x[:, b], y[:, a] - y[:, b]) - distance for a, b, distance, _ in bonds]
    return float(np.sqrt(np.mean(np.square(errors))))


def passed(x: float, y: float, way: Way, before: int) -> int:
    """Return the number of waypoints that a robot at x, y [m] has passed, given that it had passed `before` of them.

    They are passed in order, so a path may end where it began. If all are passed, the robot has reached its goal.
    """
    while before < len(way):
        near = PASSED if before < len(way) - 1 else ARRIVED
        if not math.dist((x, y), way[before]) <= near:  # also for a robot that is not seen, with NaN positions
            break
        before += 1
    return before


def time_to_goal(time: Floats, x: Floats, y: Floats, ways: Mapping[int, Way]) -> float:
    """Return when the last robot had passed all its waypoints [s]; the whole time if one never had.

    `ways` are waypoints by the column of the robot.
    """
    if not ways:
        return float("nan")
    return float(max(time[_arrival(x[:, column], y[:, column], way)] for column, way in ways.items()))


def _arrival(x: Floats, y: Floats, way: Way) -> int:
    """Return the row at which a robot has passed all its waypoints; the last row if it never has."""
    count = 0
    for row, place in enumerate(zip(x.tolist(), y.tolist(), strict=True)):
        count = passed(*place, way, count)
        if count == len(way):
            return row
    return len(x) - 1


def minimum_separation(x: Floats, y: Floats) -> float:
    """Return the least distance between the centres of two robots [m]."""
    count = x.shape[1]
    if count < 2:
        return float("nan")
    nearest = np.inf
    for column in range(count - 1):
        apart = np.hypot(x[:, column + 1 :] - x[:, [column]], y[:, column + 1 :] - y[:, [column]])
        nearest = min(nearest, float(apart.min()))
    return nearest


def path_spread(x: Floats, y: Floats, bonds: Sequence[Bond]) -> float:
    """Return the root mean square, over time and bonds, of a robot's distance to the path its leader drove [m]."""
    if not bonds:
        return float("nan")
    squares = [_to_path(x[:, a], y[:, a], x[:, b], y[:, b]) ** 2 for a, b, *_ in bonds]
    return float(np.sqrt(np.mean(squares)))


def distance_driven(x: Floats, y: Floats) -> float:
    """Return the mean distance driven [m]."""
    return float(np.hypot(np.diff(x, axis=0), np.diff(y, axis=0)).sum(axis=0).mean())


def _to_path(x: Floats, y: Floats, path_x: Floats, path_y: Floats) -> Floats:
    """Return the distance [m] of each point to a polyline."""
    dx, dy = np.diff(path_x), np.diff(path_y)
    squared = np.maximum(dx**2 + dy**2, 1e-12)
    from_x, from_y = x[:, None] - path_x[:-1], y[:, None] - path_y[:-1]
    share = np.clip((from_x * dx + from_y * dy) / squared, 0.0, 1.0)
    distance = np.hypot(from_x - share * dx, from_y - share * dy).min(axis=1)
    return np.asarray(distance, dtype=float)

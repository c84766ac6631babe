"""What an experiment with a team comes to, in numbers: each metric is a small function of where the robots went.

`x` and `y` [m; world frame] have a row for each moment and a column for each robot, shape (t, n); `time` [s], shape
(t,), counts from the start of the experiment. A metric that means nothing for a team is NaN.
"""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

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
ARRIVED = 0.1  # m; a robot this near to its goal is there


class Bond(NamedTuple):
    """One robot's place relative to another: columns of both, and the distance [m] that is wanted between them.

    `follows` tells whether the robot is to drive on the path of the other.
    """

    robot: int
    leader: int
    distance: float
    follows: bool = True


def formation_error(x: Floats, y: Floats, bonds: Sequence[Bond]) -> float:
    """Return the root mean square, over time and bonds, of the distance between two robots less the one wanted [m]."""
    if not bonds:
        return float("nan")
    errors = [np.hypot(x[:, a] - x[:, b], y[:, a] - y[:, b]) - distance for a, b, distance, _ in bonds]
    return float(np.sqrt(np.mean(np.square(errors))))


def has_arrived(x: Any, y: Any, goal: tuple[float, float]) -> Any:
    """Tell whether a robot at x, y [m], numbers or arrays, is at its goal."""
    return np.hypot(x - goal[0], y - goal[1]) <= ARRIVED


def time_to_goal(time: Floats, x: Floats, y: Floats, goals: Mapping[int, tuple[float, float]]) -> float:
    """Return when the last robot was for the first time within 0.1 m of its goal [s]; the whole time if one never was.

    `goals` are points [m] by the column of the robot.
    """
    if not goals:
        return float("nan")
    arrivals = []
    for column, goal in goals.items():
        there = has_arrived(x[:, column], y[:, column], goal)
        arrivals.append(time[np.argmax(there)] if there.any() else time[-1])
    return float(max(arrivals))


def minimum_separation(x: Floats, y: Floats) -> float:
    """Return the least distance that the centres of two robots ever had [m]."""
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
    """Return the length of the way that the robots drove, on average [m]."""
    return float(np.hypot(np.diff(x, axis=0), np.diff(y, axis=0)).sum(axis=0).mean())


def _to_path(x: Floats, y: Floats, path_x: Floats, path_y: Floats) -> Floats:
    """Return the distance [m] of each point to a polyline."""
    dx, dy = np.diff(path_x), np.diff(path_y)
    squared = np.maximum(dx**2 + dy**2, 1e-12)
    from_x, from_y = x[:, None] - path_x[:-1], y[:, None] - path_y[:-1]
    share = np.clip((from_x * dx + from_y * dy) / squared, 0.0, 1.0)
    distance: Any = np.hypot(from_x - share * dx, from_y - share * dy).min(axis=1)
    return np.asarray(distance, dtype=float)

"""Compiled loops over many robots for a crossing."""

import math

import numpy as np

from cmr.model.compiled import compiled
from cmr.world.behaviours.team import Floats, Indices


@compiled("i8[::1](f8, f8, f8, f8[::1], f8[::1])")
def near_to(at_x: float, at_y: float, radius: float, x: Floats, y: Floats) -> Indices:
    """Return which of n robots at (x, y) [m] are less than `radius` [m] from (at_x, at_y) [m]."""
    near, found = np.empty(len(x), np.int64), 0
    for i in range(len(x)):
        dx, dy = at_x - x[i], at_y - y[i]
        if math.sqrt(dx * dx + dy * dy) < radius:
            near[found] = i
            found += 1
    return near[:found].copy()


@compiled("void(f8, f8, f8[::1], f8[::1], f8[::1], f8[::1], f8[::1], b1[::1])")
def head_in(at_x, at_y, x: Floats, y: Floats, goal_x: Floats, goal_y: Floats, speed: Floats, inward) -> None:  # type: ignore[no-untyped-def]
    """Write which of n robots at (x, y) [m] head for (at_x, at_y) [m]; robots at rest do not."""
    for k in range(len(x)):
        dx, dy, goal_dx, goal_dy = x[k] - at_x, y[k] - at_y, goal_x[k] - at_x, goal_y[k] - at_y
        inward[k] = goal_dx * goal_dx + goal_dy * goal_dy < dx * dx + dy * dy and speed[k] > 0.0


@compiled("void(f8, f8, f8, f8, i8, i8, f8, f8, f8, i8[::1], f8[::1], f8[::1], b1[::1], f8[::1])")
def wait_before(  # type: ignore[no-untyped-def]
    at_x,
    at_y,
    zone,
    core,
    next_in,
    into_core,
    stop_short,
    reaction,
    braking,
    robot_id: Indices,
    x: Floats,
    y: Floats,
    inward,
    speed: Floats,
) -> None:
    """Lower the speeds [m/s] of n robots at (x, y) [m] so that each can stop before a zone that it may not enter.

    Over the line `zone` [m] from (at_x, at_y) only `next_in` may go, from there into the `core` [m] only `into_core`.
    """
    for k in range(len(x)):
        dx, dy = x[k] - at_x, y[k] - at_y
        away = math.sqrt(dx * dx + dy * dy)
        line, free = (zone, next_in) if away >= zone else (core, into_core)
        if inward[k] and away >= core and robot_id[k] != free:
            late, room = braking * reaction, max(away - line - stop_short, 0.0)
            speed[k] = min(speed[k], math.sqrt(late * late + 2.0 * braking * room) - late)

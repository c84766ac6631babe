"""Targets and speeds that keep robots at their places in a moving formation."""

import math

from cmr.model.compiled import compiled
from cmr.world.behaviours.team import Floats

SPEED_PER_DISTANCE = 1.5  # 1/s: speed per metre of distance from the place
AT_REST = 0.05  # m and m/s: a robot this near to a place that moves slower than this stops
AHEAD = 0.4  # s of driving to the target point
NEAREST = 0.15  # m to that point


@compiled("void(f8[::1], f8[::1], f8[::1], f8[::1], f8[::1], f8, f8[::1], f8[::1], f8[::1], f8[::1])")
def keep_places(
    anchor: Floats,
    ahead: Floats,
    left: Floats,
    x: Floats,
    y: Floats,
    fastest: float,
    target_x: Floats,
    target_y: Floats,
    speed: Floats,
    distance: Floats,
) -> None:
    """Write targets [m], speeds [m/s] and the distances [m] to their places of n robots at (x, y) [m].

    `anchor` is the pose, speed and yaw rate of the frame of the places (ahead, left) [m]. If it contains NaN, robots
    stop. A robot ahead of its moving place waits for it.
    """
    cos, sin = math.cos(anchor[2]), math.sin(anchor[2])
    for k in range(len(x)):
        from_x, from_y = cos * ahead[k] - sin * left[k], sin * ahead[k] + cos * left[k]
        moves_x, moves_y = anchor[3] * cos - anchor[4] * from_y, anchor[3] * sin + anchor[4] * from_x
        to_x, to_y = anchor[0] + from_x - x[k], anchor[1] + from_y - y[k]
        away, moves = math.sqrt(to_x * to_x + to_y * to_y), math.sqrt(moves_x * moves_x + moves_y * moves_y)
        distance[k] = away
        wanted_x, wanted_y = moves_x + SPEED_PER_DISTANCE * to_x, moves_y + SPEED_PER_DISTANCE * to_y
        wanted = math.sqrt(wanted_x * wanted_x + wanted_y * wanted_y)
        there = away < AT_REST and moves < AT_REST
        too_far = moves >= AT_REST and wanted_x * moves_x + wanted_y * moves_y <= 0.0
        target_x[k], target_y[k], speed[k] = x[k], y[k], 0.0
        if there or too_far or not wanted > 0.0:  # also NaN
            continue
        reach = max(wanted * AHEAD, NEAREST) / wanted
        target_x[k], target_y[k] = x[k] + wanted_x * reach, y[k] + wanted_y * reach
        speed[k] = min(wanted, fastest)

"""The border of a geofence, which robots never cross."""

import math

from cmr.model.compiled import compiled
from cmr.world.behaviours.clearance import BRAKING
from cmr.world.behaviours.team import Floats


@compiled("UniTuple(f8, 3)(f8, f8, f8[:, ::1], i8)")
def way_to_side(x: float, y: float, corners: Floats, side: int) -> tuple[float, float, float]:
    """Return the direction from (x, y) to the nearest point of one side, and how far away [m] it is.

    `corners` (2, n) [m] are those of a polygon; side i ends at corner i. On the side, the direction is 0.
    """
    ax, ay, bx, by = corners[0, side - 1], corners[1, side - 1], corners[0, side], corners[1, side]
    dx, dy = bx - ax, by - ay
    share = ((x - ax) * dx + (y - ay) * dy) / (dx * dx + dy * dy)
    share = min(max(share, 0.0), 1.0)
    way_x, way_y = ax + share * dx - x, ay + share * dy - y
    away = math.sqrt(way_x * way_x + way_y * way_y)
    return way_x / max(away, 1e-9), way_y / max(away, 1e-9), away


@compiled("b1(f8, f8, f8[:, ::1])")
def is_inside(x: float, y: float, corners: Floats) -> bool:
    """Return whether (x, y) lies inside a polygon (2, n)."""
    inside = False
    for i in range(corners.shape[1]):
        ax, ay, bx, by = corners[0, i - 1], corners[1, i - 1], corners[0, i], corners[1, i]
        if (ay > y) != (by > y) and x < ax + (y - ay) / (by - ay) * (bx - ax):
            inside = not inside
    return inside


@compiled("i8(f8, f8, f8[:, ::1])")
def nearest_side(x: float, y: float, corners: Floats) -> int:
    """Return the side of a polygon (2, n) that is nearest to (x, y)."""
    chosen, nearest = 0, math.inf
    for side in range(corners.shape[1]):
        away = way_to_side(x, y, corners, side)[2]
        if away < nearest:
            chosen, nearest = side, away
    return chosen


@compiled("UniTuple(f8, 2)(f8, f8, f8, f8, f8[:, ::1], f8, f8)")
def turned_back(  # type: ignore[no-untyped-def]
    x, y, wanted_x, wanted_y, corners: Floats, border, cruise
):
    """Return a desired velocity [m/s] reduced so that it does not cross the border.

    At a distance of `border` [m] from a side, the velocity towards it is at most `cruise` [m/s]; at half that distance,
    0; on the side and outside it is -`cruise`.
    """
    if not is_inside(x, y, corners):
        way_x, way_y, _ = way_to_side(x, y, corners, nearest_side(x, y, corners))
        too_slow = max(cruise - wanted_x * way_x - wanted_y * way_y, 0.0)
        return wanted_x + too_slow * way_x, wanted_y + too_slow * way_y
    for side in range(corners.shape[1]):
        way_x, way_y, away = way_to_side(x, y, corners, side)
        if away < border:
            too_fast = wanted_x * way_x + wanted_y * way_y - cruise * (2.0 * away / border - 1.0)
            wanted_x -= max(too_fast, 0.0) * way_x
            wanted_y -= max(too_fast, 0.0) * way_y
    return wanted_x, wanted_y


@compiled("void(f8[::1], f8[::1], f8[::1], f8[:, ::1], f8, f8, f8[::1])")
def stop_before(
    x: Floats, y: Floats, theta: Floats, corners: Floats, clearance: float, reaction: float, forward: Floats
) -> None:
    """Limit the speeds of n robots along their headings [m/s] so that they stop `clearance` [m] before the border.

    `corners` (2, m) may be empty. Robots continue for `reaction` [s] and then brake with BRAKING. Robots outside may
    only go towards the border.
    """
    if not corners.shape[1]:
        return
    late = BRAKING * reaction
    for k in range(len(x)):
        along_x, along_y = math.cos(theta[k]), math.sin(theta[k])
        if not is_inside(x[k], y[k], corners):
            way_x, way_y, _ = way_to_side(x[k], y[k], corners, nearest_side(x[k], y[k], corners))
            if way_x * along_x + way_y * along_y <= 0.0:
                forward[k] = 0.0
            continue
        for side in range(corners.shape[1]):
            way_x, way_y, away = way_to_side(x[k], y[k], corners, side)
            towards = way_x * along_x + way_y * along_y
            if towards > 0.0:
                allowed = math.sqrt(late * late + 2.0 * BRAKING * max(away - clearance, 0.0)) - late
                forward[k] = min(forward[k], allowed / towards)

"""How far along its path each of many robots is, where it heads for, and trails that grow behind leaders.

What is nearest to a robot is looked for only a little ahead, so that a crossing is not mistaken for the piece of path
that the robot is on.
"""

import math

from cmr.model.compiled import compiled
from cmr.world.behaviours.paths import SHORTEST
from cmr.world.behaviours.team import Floats, Indices

ROUNDING = 1e-6  # m
SEARCH_AHEAD = 0.5  # m of path looked at for the point nearest to the robot


@compiled(
    "void(i8[::1], i8[::1], f8[:, ::1], f8[:, ::1], f8[:, ::1], i8[::1], f8[::1], f8[::1], f8, f8[::1], i8[::1],"
    " f8[::1], f8[::1], f8[::1])"
)
def pursue(  # type: ignore[no-untyped-def]
    row: Indices,
    path: Indices,
    path_x: Floats,
    path_y: Floats,
    along: Floats,
    count: Indices,
    x: Floats,
    y: Floats,
    look_ahead: float,
    progress: Floats,
    piece: Indices,
    target_x: Floats,
    target_y: Floats,
    remaining: Floats,
):
    """Move the progress of n robots at (x, y) [m] on to the points of their paths nearest to them, never back.

    Robot k is on path `path[k]`; its progress [m] and the piece of path it is on are in `progress`, `piece` at
    `row[k]`. Writes the points `look_ahead` [m] further on to the targets, and what remains of the paths [m] to
    `remaining`: -1 where there is no path.
    """
    for k in range(len(row)):
        r, p = row[k], path[k]
        if p < 0 or count[p] == 0:
            remaining[k] = -1.0
            continue
        last = count[p] - 1
        px, py, pa = path_x[p], path_y[p], along[p]
        nearest, best, reached = math.inf, piece[r], progress[r]
        i = piece[r]
        while i < last and pa[i] <= progress[r] + SEARCH_AHEAD:
            dx, dy, span = px[i + 1] - px[i], py[i + 1] - py[i], pa[i + 1] - pa[i]
            share = ((x[k] - px[i]) * dx + (y[k] - py[i]) * dy) / (span * span)
            share = min(max(share, 0.0, (progress[r] - pa[i]) / span), 1.0)
            ex, ey = px[i] + share * dx - x[k], py[i] + share * dy - y[k]
            away = ex * ex + ey * ey
            if away < nearest:
                nearest, best, reached = away, i, pa[i] + share * span
            else:  # pieces that end before the path can have come as near again need no look
                near_again = pa[i] + share * span + math.sqrt(away) - math.sqrt(nearest) - ROUNDING
                while i + 2 < last and pa[i + 2] < near_again:
                    i += 1
            i += 1
        progress[r], piece[r] = reached, best
        remaining[k] = pa[last] - reached
        ahead = reached + look_ahead
        while best < last and pa[best + 1] < ahead:
            best += 1
        if best >= last:
            target_x[k], target_y[k] = px[last], py[last]
        else:
            share = (ahead - pa[best]) / (pa[best + 1] - pa[best])
            target_x[k] = px[best] + share * (px[best + 1] - px[best])
            target_y[k] = py[best] + share * (py[best + 1] - py[best])


@compiled("i8(f8[:, ::1], f8)")
def thin(points: Floats, shortest: float) -> int:
    """Move the points (2, n) [m] that are kept to the front; return how many there are.

    Left out are those nearer than `shortest` [m] to the one kept before; in the end, the last point takes its place.
    """
    kept, last = 0, points.shape[1] - 1
    for k in range(last + 1):
        x, y = points[0, k], points[1, k]
        near = kept > 0 and math.sqrt((x - points[0, kept - 1]) ** 2 + (y - points[1, kept - 1]) ** 2) < shortest
        if near and k == last and kept > 1:
            kept -= 1
        if not near or k == last:
            points[0, kept], points[1, kept] = x, y
            kept += 1
    return kept


@compiled(
    "i8(i8[::1], i8[::1], f8[:, ::1], f8[:, ::1], f8[:, ::1], i8[::1], f8[::1], f8[::1], f8[::1], f8[::1], f8[::1],"
    " i8[::1], f8[::1])"
)
def trail(
    row: Indices,
    leader: Indices,
    path_x: Floats,
    path_y: Floats,
    along: Floats,
    count: Indices,
    all_x: Floats,
    all_y: Floats,
    x: Floats,
    y: Floats,
    progress: Floats,
    piece: Indices,
    length: Floats,
) -> int:
    """Let the trails of n followers at (x, y) [m] grow to where their leaders are; return the most points of any.

    Follower k keeps its trail in the path `row[k]`; `leader[k]` is its leader's place among everybody at (all_x,
    all_y), or -1: then the trail is forgotten, and the next one begins where the follower is. Writes the lengths of the
    trails [m] up to the leaders. What lies behind the follower is dropped when there is no more room.
    """
    most, room = 0, path_x.shape[1]
    for k in range(len(row)):
        r, j = row[k], leader[k]
        if j < 0:
            count[r] = 0
            length[k] = 0.0
            continue
        px, py, pa = path_x[r], path_y[r], along[r]
        if count[r] == 0:
            px[0], py[0], pa[0] = x[k], y[k], 0.0
            count[r], piece[r], progress[r] = 1, 0, 0.0
        last = count[r] - 1
        dx, dy = all_x[j] - px[last], all_y[j] - py[last]
        step = math.sqrt(dx * dx + dy * dy)
        length[k] = pa[last] + step
        if step < SHORTEST:
            continue
        if last + 1 == room:
            behind = piece[r]
            for i in range(behind, room):
                px[i - behind], py[i - behind], pa[i - behind] = px[i], py[i], pa[i]
            last, piece[r] = last - behind, 0
        if last + 1 < room:
            px[last + 1], py[last + 1], pa[last + 1] = all_x[j], all_y[j], pa[last] + step
            last += 1
        count[r] = last + 1
        most = max(most, last + 1 - piece[r])
    return most

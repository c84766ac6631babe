"""Path following of many robots: progress along paths, target points, and trails that grow behind leaders.

The nearest point is searched only a short way ahead, so that at a crossing the robot stays on its own branch of the
path.
"""

import math

from cmr.model.compiled import compiled, inlined
from cmr.world.behaviours.paths import ALONE, ALONG, SHORTEST, TARGET, X, Y
from cmr.world.behaviours.team import Floats, Indices

ROUNDING = 1e-6  # m
SEARCH_AHEAD = 0.5  # m of path searched for the point nearest to the robot
LONGEST_PIECE = 0.25  # m, longest segment of a trail while the leader drives straight
ASIDE = 0.001  # m; a trail point this close to the line between its neighbours is dropped


@compiled(
    "void(i8[::1], f8[:, :, ::1], i8[::1], f8[::1], f8[:, :, ::1],"
    "f8[::1], f8[::1], f8, f8[::1], i8[::1], f8[::1], f8[::1], f8[::1])"
)
def pursue(
    row: Indices, points: Floats, count: Indices, length: Floats, around: Floats,
    x: Floats, y: Floats, look_ahead: float, progress: Floats, piece: Indices,
    target_x: Floats, target_y: Floats, remaining: Floats,
) -> None:  # fmt: skip
    """Advance the progress of n robots at (x, y) [m] to the nearest points of their paths, never backwards.

    Robot k is on the path `row[k]` of Paths; there, `progress` and `piece` hold its progress [m] and its current
    segment. Writes the points `look_ahead` [m] further on to the targets, and the remaining lengths of the paths [m] to
    `remaining`: -1 without a path.
    """
    for k in range(len(row)):
        r = row[k]
        if count[r] == 0:
            remaining[k] = -1.0
            continue
        reached, away = _nearest_of(around, r, 0, x[k], y[k], progress[r])
        stays = away < around[r, 0, ALONE] ** 2
        if stays:
            stays = away <= _nearest_of(around, r, 1, x[k], y[k], progress[r])[1]
        if stays and reached + look_ahead <= around[r, TARGET + 1, ALONG]:
            target_x[k], target_y[k] = _point_at(around, r, TARGET, reached + look_ahead)
        else:
            last = count[r] - 1
            piece[r], reached = _nearest(points, r, last, x[k], y[k], progress[r], piece[r])
            ahead = _piece_at(points, r, last, piece[r], reached + look_ahead)
            if ahead < last:
                target_x[k], target_y[k] = _point_at(points, r, ahead, reached + look_ahead)
            else:
                target_x[k], target_y[k] = points[r, last, X], points[r, last, Y]
            _remember(points, r, last, piece[r], ahead, around)
        progress[r] = reached
        remaining[k] = length[r] - reached


@inlined
def _nearest_of(points, r, i, x, y, progress):  # type: ignore[no-untyped-def]
    """Return the path length [m] of a segment's point nearest to (x, y), not before the progress, and its distance.

    The distance is squared [m^2].
    """
    begin = points[r, i, ALONG]
    dx, dy = points[r, i + 1, X] - points[r, i, X], points[r, i + 1, Y] - points[r, i, Y]
    span = points[r, i + 1, ALONG] - begin
    share = ((x - points[r, i, X]) * dx + (y - points[r, i, Y]) * dy) / (span * span)
    share = min(max(share, 0.0, (progress - begin) / span), 1.0)
    ex, ey = points[r, i, X] + share * dx - x, points[r, i, Y] + share * dy - y
    return begin + share * span, ex * ex + ey * ey


@inlined
def _piece_at(points, r, last, piece, along):  # type: ignore[no-untyped-def]
    """Return the segment of path `r`, from `piece` on, that contains the path length `along` [m]; `last` if the path is
    shorter.
    """
    i = piece
    while i < last and points[r, i + 1, ALONG] < along:
        i += 1
    return i


@inlined
def _point_at(points, r, i, along):  # type: ignore[no-untyped-def]
    """Return the point (x, y) [m] of segment `i` at the path length `along` [m]."""
    begin = points[r, i, ALONG]
    share = (along - begin) / (points[r, i + 1, ALONG] - begin)
    x, y = points[r, i, X], points[r, i, Y]
    return x + share * (points[r, i + 1, X] - x), y + share * (points[r, i + 1, Y] - y)


@inlined
def _nearest(points, r, last, x, y, progress, piece):  # type: ignore[no-untyped-def]
    """Return the segment of path `r` nearest to (x, y) [m], not before the progress, and the path length [m] there."""
    nearest, best, reached = math.inf, piece, progress
    i = piece
    while i < last and points[r, i, ALONG] <= progress + SEARCH_AHEAD:
        there, away = _nearest_of(points, r, i, x, y, progress)
        if away < nearest:
            nearest, best, reached = away, i, there
        elif nearest < points[r, best, ALONE] ** 2:
            break
        else:  # segments that end before the path can come as near again are skipped
            near_again = there + math.sqrt(away) - math.sqrt(nearest) - ROUNDING
            while i + 2 < last and points[r, i + 2, ALONG] < near_again:
                i += 1
        i += 1
    return best, reached


@inlined
def _remember(points, r, last, piece, ahead, around):  # type: ignore[no-untyped-def]
    """Copy the points of a robot's current and next segment, and of its target's segment, next to each other.

    Usually these are all it needs, and the paths of many robots are far apart in memory.
    """
    if piece + 2 > last or ahead >= last:
        around[r, 0, ALONE] = 0.0
        return
    same = around[r, 0, ALONE] == points[r, piece, ALONE] and around[r, 0, ALONG] == points[r, piece, ALONG]
    if same and around[r, TARGET, ALONG] == points[r, ahead, ALONG]:
        return
    for what in range(points.shape[2]):
        for i in range(3):
            around[r, i, what] = points[r, piece + i, what]
        for i in range(2):
            around[r, TARGET + i, what] = points[r, ahead + i, what]


@compiled("void(f8[:, :, ::1], i8, i8, i8)")
def look_around(points: Floats, row: int, first: int, end: int) -> None:
    """Write to ALONE how near new segments of a path, from `first` to `end`, come to earlier ones.

    Adjacent segments do not count. The distance of two segments is at least that of their midpoints minus half of both
    lengths.
    """
    p = points[row]
    for piece in range(first, end):
        p[piece, ALONE] = math.inf
        i = piece - 2
        while i >= 0 and p[piece, ALONG] <= p[i + 1, ALONG] + SEARCH_AHEAD:
            dx = p[piece, X] + p[piece + 1, X] - p[i, X] - p[i + 1, X]
            dy = p[piece, Y] + p[piece + 1, Y] - p[i, Y] - p[i + 1, Y]
            lengths = p[piece + 1, ALONG] - p[piece, ALONG] + p[i + 1, ALONG] - p[i, ALONG]
            apart = 0.5 * (math.sqrt(dx * dx + dy * dy) - lengths)
            p[i, ALONE] = min(p[i, ALONE], max(0.5 * apart - ROUNDING, 0.0))
            i -= 1


@compiled("void(i8[::1], i8[::1], f8[::1], f8[::1], f8, f8, f8, f8[::1], b1[::1])")
def stop_at_end(  # type: ignore[no-untyped-def]
    row: Indices, count: Indices, remaining: Floats, apart: Floats, arrived, braking, fastest, speed: Floats, round_it
) -> None:
    """Write the speeds [m/s], at most `fastest`, at which n robots can stop at the ends of their paths.

    Also write whether each is far enough from its end to go round obstacles, which it passes at `apart` [m]. A robot
    within `arrived` [m] of the end stops, and its path is deleted.
    """
    for k in range(len(row)):
        round_it[k] = remaining[k] > 2.0 * apart[k]
        if remaining[k] < arrived:
            count[row[k]] = 0
            speed[k] = 0.0
        else:
            speed[k] = min(math.sqrt(2.0 * braking * remaining[k]), fastest)


@compiled("void(i8[::1], f8[::1], f8[::1], f8[::1], f8[::1], f8, f8, f8, f8[::1])")
def keep_gaps(  # type: ignore[no-untyped-def]
    row: Indices, length: Floats, remaining: Floats, progress: Floats, gap: Floats, rate, dead_zone, fastest, speed
) -> None:
    """Write the speeds [m/s], at most `fastest`, that bring n robots to `gap` [m] behind their leaders.

    Leaders are at `length` [m] along the trails, with `remaining` [m] left to them, -1 without a trail. Speeds are
    `rate` [1/s] times the distances; robots nearer than `dead_zone` [m] stop.
    """
    for k in range(len(row)):
        behind = length[k] - progress[row[k]] - gap[row[k]]
        rests = behind < dead_zone or remaining[k] < 0.0
        speed[k] = 0.0 if rests else min(rate * behind, fastest)


@compiled("i8(f8[:, ::1], f8)")
def thin(points: Floats, shortest: float) -> int:
    """Move the points (2, n) [m] to keep to the front; return their number.

    Points nearer than `shortest` [m] to the one kept before are dropped; the last point is always kept.
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


@inlined
def _straight_on(points, r, last, x, y):  # type: ignore[no-untyped-def]
    """Return whether the last segment of a path may be extended to (x, y) [m], because the path is straight there."""
    before_x, before_y = points[r, last, X] - points[r, last - 1, X], points[r, last, Y] - points[r, last - 1, Y]
    dx, dy = x - points[r, last - 1, X], y - points[r, last - 1, Y]
    whole, aside = dx * dx + dy * dy, before_x * dy - before_y * dx
    ahead = before_x * (dx - before_x) + before_y * (dy - before_y)
    return ahead > 0.0 and whole < LONGEST_PIECE * LONGEST_PIECE and aside * aside < ASIDE * ASIDE * whole


@inlined
def _end_at(points, r, last, x, y):  # type: ignore[no-untyped-def]
    """Move the end of a path's last segment to (x, y) [m]; return the path length [m] there."""
    dx, dy = x - points[r, last - 1, X], y - points[r, last - 1, Y]
    along = points[r, last - 1, ALONG] + math.sqrt(dx * dx + dy * dy)
    points[r, last, X], points[r, last, Y], points[r, last, ALONG] = x, y, along
    look_around(points, r, last - 1, last)
    return along


@inlined
def _begin_at(points, r, x, y, count, length, around, progress, piece):  # type: ignore[no-untyped-def]
    """Begin a path at (x, y) [m]."""
    points[r, 0, X], points[r, 0, Y], points[r, 0, ALONG] = x, y, 0.0
    count[r], piece[r], progress[r], length[r], around[r, 0, ALONE] = 1, 0, 0.0, 0.0, 0.0


@inlined
def _drop_behind(points, r, last, piece):  # type: ignore[no-untyped-def]
    """Drop the points of a path before `piece`; return the new index of the last one."""
    for i in range(piece, last + 1):
        for what in range(points.shape[2]):  # a slice would take seconds to compile
            points[r, i - piece, what] = points[r, i, what]
    return last - piece


@inlined
def _go_on_to(points, r, new, x, y, along, piece, around):  # type: ignore[no-untyped-def]
    """Add the point (x, y) [m] at the path length `along` [m] as point `new`."""
    points[r, new, X], points[r, new, Y], points[r, new, ALONG] = x, y, along
    look_around(points, r, new - 1, new)
    around[r, 0, ALONE] = min(around[r, 0, ALONE], points[r, piece, ALONE])


@compiled(
    "i8(i8[::1], i8[::1], f8[:, :, ::1], i8[::1], f8[::1], f8[:, :, ::1],"
    "f8[::1], f8[::1], f8[::1], f8[::1], f8[::1], i8[::1], f8[::1])"
)
def trail(
    row: Indices, leader: Indices, points: Floats, count: Indices, length: Floats, around: Floats,
    all_x: Floats, all_y: Floats, x: Floats, y: Floats, progress: Floats,
    piece: Indices, up_to_leader: Floats,
) -> int:  # fmt: skip
    """Extend the trails of n followers at (x, y) [m] to their leaders' positions; return the largest number of points.

    Follower k keeps its trail in the path `row[k]`; `leader[k]` is its leader's index in (all_x, all_y), or -1: then
    the trail is deleted, and the next one begins at the follower. Writes the lengths of the trails [m] up to the
    leaders. Points behind the follower are dropped when there is no room left.
    """
    most, room = 0, points.shape[1]
    for k in range(len(row)):
        r, j = row[k], leader[k]
        if j < 0:
            count[r] = 0
            up_to_leader[k] = 0.0
            continue
        if count[r] == 0:
            _begin_at(points, r, x[k], y[k], count, length, around, progress, piece)
        last = count[r] - 1
        dx, dy = all_x[j] - points[r, last, X], all_y[j] - points[r, last, Y]
        step = math.sqrt(dx * dx + dy * dy)
        up_to_leader[k] = length[r] + step
        if step < SHORTEST:
            continue
        if last > 0 and _straight_on(points, r, last, all_x[j], all_y[j]):
            length[r] = _end_at(points, r, last, all_x[j], all_y[j])
            up_to_leader[k], around[r, 0, ALONE] = length[r], 0.0
            most = max(most, last + 1 - piece[r])
            continue
        if last + 1 == room:
            last, piece[r] = _drop_behind(points, r, last, piece[r]), 0
        if last + 1 < room:
            last, length[r] = last + 1, up_to_leader[k]
            _go_on_to(points, r, last, all_x[j], all_y[j], length[r], piece[r], around)
        count[r] = last + 1
        most = max(most, last + 1 - piece[r])
    return most

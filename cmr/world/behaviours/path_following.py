"""How far along its path each of many robots is, where it heads for, and trails that grow behind leaders.

What is nearest to a robot is looked for only a little ahead, so that a crossing is not mistaken for the piece of path
that the robot is on.
"""

import math

from cmr.model.compiled import compiled, inlined
from cmr.world.behaviours.paths import ALONE, ALONG, SHORTEST, TARGET, X, Y
from cmr.world.behaviours.team import Floats, Indices

ROUNDING = 1e-6  # m
SEARCH_AHEAD = 0.5  # m of path looked at for the point nearest to the robot
LONGEST_PIECE = 0.25  # m, to which pieces of a trail grow while the leader drives straight on
ASIDE = 0.001  # m; a point of a trail so near to the line between its neighbours is left out


@compiled(
    "void(i8[::1], f8[:, :, ::1], i8[::1], f8[::1], f8[:, :, ::1],"
    "f8[::1], f8[::1], f8, f8[::1], i8[::1], f8[::1], f8[::1], f8[::1])"
)
def pursue(
    row: Indices, points: Floats, count: Indices, length: Floats, around: Floats,
    x: Floats, y: Floats, look_ahead: float, progress: Floats, piece: Indices,
    target_x: Floats, target_y: Floats, remaining: Floats,
) -> None:  # fmt: skip
    """Move the progress of n robots at (x, y) [m] on to the points of their paths nearest to them, never back.

    Robot k is on the path `row[k]` of Paths; there in `progress` and `piece` are its progress [m] and the piece of path
    it is on. Writes the points `look_ahead` [m] further on to the targets, and what remains of the paths [m] to
    `remaining`: -1 where there is no path.
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
    """Return the length [m] up to the point of one piece, from the progress on, nearest to (x, y), and how far away.

    That is the square of the distance [m^2].
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
    """Return the piece of path `r`, from `piece` on, on which it is `along` [m] long; `last` where it is shorter."""
    i = piece
    while i < last and points[r, i + 1, ALONG] < along:
        i += 1
    return i


@inlined
def _point_at(points, r, i, along):  # type: ignore[no-untyped-def]
    """Return the point (x, y) [m] of piece `i` up to which the path is so long [m]."""
    begin = points[r, i, ALONG]
    share = (along - begin) / (points[r, i + 1, ALONG] - begin)
    x, y = points[r, i, X], points[r, i, Y]
    return x + share * (points[r, i + 1, X] - x), y + share * (points[r, i + 1, Y] - y)


@inlined
def _nearest(points, r, last, x, y, progress, piece):  # type: ignore[no-untyped-def]
    """Return the piece of path `r` nearest to (x, y) [m], from the progress on, and the length [m] up to there."""
    nearest, best, reached = math.inf, piece, progress
    i = piece
    while i < last and points[r, i, ALONG] <= progress + SEARCH_AHEAD:
        there, away = _nearest_of(points, r, i, x, y, progress)
        if away < nearest:
            nearest, best, reached = away, i, there
        elif nearest < points[r, best, ALONE] ** 2:
            break
        else:  # pieces that end before the path can have come as near again need no look
            near_again = there + math.sqrt(away) - math.sqrt(nearest) - ROUNDING
            while i + 2 < last and points[r, i + 2, ALONG] < near_again:
                i += 1
        i += 1
    return best, reached


@inlined
def _remember(points, r, last, piece, ahead, around):  # type: ignore[no-untyped-def]
    """Keep the points of a robot's own and next piece of path, and of the one it heads for, together.

    Most of the time it needs no others, and the paths of many robots are far apart in memory.
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
    """Note in ALONE how near new pieces of a path, from `first` on up to `end`, come to those before them.

    The next but one is the first that counts. Pieces are at least as far apart as their middles, less half of both
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

    And whether each is far enough from there to go round what is in its way, which keeps it `apart` [m]. A robot
    that has `arrived` [m] stands, and its path is forgotten.
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
    """Write the speeds [m/s], at most `fastest`, that take n robots to where they are `gap` [m] behind their leaders.

    Those are `length` [m] along their trails, of which `remaining` [m] remain, -1 where there is none. Speeds are
    `rate` [1/s] times the distances; robots nearer than `dead_zone` [m] stand.
    """
    for k in range(len(row)):
        behind = length[k] - progress[row[k]] - gap[row[k]]
        rests = behind < dead_zone or remaining[k] < 0.0
        speed[k] = 0.0 if rests else min(rate * behind, fastest)


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


@inlined
def _straight_on(points, r, last, x, y):  # type: ignore[no-untyped-def]
    """Return whether the last piece of a path may end at (x, y) [m] instead, as what it leaves out is straight."""
    before_x, before_y = points[r, last, X] - points[r, last - 1, X], points[r, last, Y] - points[r, last - 1, Y]
    dx, dy = x - points[r, last - 1, X], y - points[r, last - 1, Y]
    whole, aside = dx * dx + dy * dy, before_x * dy - before_y * dx
    ahead = before_x * (dx - before_x) + before_y * (dy - before_y)
    return ahead > 0.0 and whole < LONGEST_PIECE * LONGEST_PIECE and aside * aside < ASIDE * ASIDE * whole


@inlined
def _end_at(points, r, last, x, y):  # type: ignore[no-untyped-def]
    """Let the last piece of a path end at (x, y) [m] instead; return the length [m] up to there."""
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
    """Drop the points of a path before `piece`; return which one is the last now."""
    for i in range(piece, last + 1):
        for what in range(points.shape[2]):  # a slice would take seconds to compile
            points[r, i - piece, what] = points[r, i, what]
    return last - piece


@inlined
def _go_on_to(points, r, new, x, y, along, piece, around):  # type: ignore[no-untyped-def]
    """Add the point (x, y) [m], up to which a path is `along` [m] long, as its point `new`."""
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
    """Let the trails of n followers at (x, y) [m] grow to where their leaders are; return the most points of any.

    Follower k keeps its trail in the path `row[k]`; `leader[k]` is its leader's place among everybody at (all_x,
    all_y), or -1: then the trail is forgotten, and the next one begins where the follower is. Writes the lengths of the
    trails [m] up to the leaders. What lies behind the follower is dropped when there is no more room.
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

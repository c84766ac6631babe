"""Keep clear of what is in the way: the speed at which a robot can still stop, and the way round on the right.

A robot may go as fast as lets it brake before it comes too near to what is ahead, if that brakes, too: the rule of
Shalev-Shwartz, Shammah and Shashua, On a formal model of safe and scalable self-driving cars, 2017.
"""

import math

import numpy as np

from cmr.model.compiled import compiled, inlined
from cmr.model.elementary import sincos
from cmr.world.behaviours.team import Floats, Indices

BRAKING = 0.5  # m/s^2, which wheels on a smooth floor hold
VIEW_STEP = 0.25  # m
WIDE = 1.05  # of the distance to be kept, at which others are passed
REACTION = 0.15  # s until a robot follows its command: the time constant of its motors


def view_needed(apart: float, speed: float, reaction: float) -> float:
    """Return how far [m] a robot that drives at `speed` [m/s] has to look so that centres stay `apart` [m].

    It is rounded up, so that those who need about the same can share a search.
    """
    needed = apart + speed * reaction + speed * speed / BRAKING  # each of two that meet brakes
    return math.ceil(float(needed) / VIEW_STEP) * VIEW_STEP


@compiled("f8(f8, f8, f8, f8, f8, f8, f8, f8, f8)")
def speed_before(dx, dy, along_x, along_y, speed_x, speed_y, clearance, reaction, fastest):  # type: ignore[no-untyped-def]
    """Return the speed [m/s], at most `fastest`, that keeps `clearance` [m] from what is at (dx, dy) [m] from here.

    (along_x, along_y) is the direction in which the robot goes, of length 1; (speed_x, speed_y) [m/s] is how the other
    moves. The robot does nothing for `reaction` [s] and then brakes with BRAKING.
    """
    ahead = dx * along_x + dy * along_y
    aside = dx * along_y - dy * along_x
    if ahead <= 0.0 or abs(aside) >= clearance:
        return fastest
    free = ahead - math.sqrt(clearance * clearance - aside * aside)
    flees = speed_x * along_x + speed_y * along_y
    free += flees * abs(flees) / (2.0 * BRAKING)  # what the other needs to stop, towards us or away
    if free <= 0.0:
        return 0.0
    late = BRAKING * reaction
    return min(fastest, math.sqrt(late * late + 2.0 * BRAKING * free) - late)


@compiled("UniTuple(f8, 2)(f8, f8, f8, b1)")
def tangent(dx: float, dy: float, apart: float, left: bool) -> tuple[float, float]:
    """Return the direction in which what is at (dx, dy) [m] is passed at a distance of `apart` [m], on our left or not.

    A robot that is nearer than that already goes a little away from it.
    """
    away = max(math.sqrt(dx * dx + dy * dy), 1e-9)
    if away >= apart:
        sine = apart / away
        cosine = math.sqrt(1.0 - sine * sine)
    else:
        sine = away / apart
        cosine = -math.sqrt(1.0 - sine * sine)
    if left:
        sine = -sine
    return (dx * cosine - dy * sine) / away, (dy * cosine + dx * sine) / away


@inlined
def _see_robots(things, near, start, end, i, x, y, speed_x, speed_y, apart):  # type: ignore[no-untyped-def]
    """Write the neighbours of robot `i`, near[start:end], to `things`; it stays `apart` [m] from each."""
    for n in range(end - start):
        j = near[start + n]
        things[n, 0], things[n, 1], things[n, 2], things[n, 3] = x[j] - x[i], y[j] - y[i], speed_x[j], speed_y[j]
        things[n, 4] = apart


@inlined
def _see_discs(things, first, discs, x, y, radius, clearance):  # type: ignore[no-untyped-def]
    """Write discs, as a robot at (x, y) [m] of this radius [m] sees them, to `things` from the row `first` on."""
    for n in range(discs.shape[1]):
        m = first + n
        things[m, 0], things[m, 1], things[m, 2], things[m, 3] = discs[0, n] - x, discs[1, n] - y, 0.0, 0.0
        things[m, 4] = discs[2, n] + radius + clearance


@inlined
def _first_in_way(things, count, along_x, along_y, reaction, fastest):  # type: ignore[no-untyped-def]
    """Return how fast [m/s] a robot may go along a direction of length 1, and which of so many things allows least.

    That is -1 if none does. For each, `things` has the way there [m], its velocity [m/s], and how far to stay away [m].
    """
    slowest, blocking = fastest, -1
    for n in range(count):
        dx, dy, speed_x, speed_y, apart = things[n, 0], things[n, 1], things[n, 2], things[n, 3], things[n, 4]
        allowed = speed_before(dx, dy, along_x, along_y, speed_x, speed_y, apart, reaction, fastest)
        if allowed < slowest:
            slowest, blocking = allowed, n
    return slowest, blocking


@inlined
def _on_the_right(things, blocking, robots, sine, cosine):  # type: ignore[no-untyped-def]
    """Return the direction in which a robot that is turned to (cosine, sine) goes round what blocks it.

    The first `robots` of the things are robots: each is passed with it on the left. A disc is passed on that side to
    which the robot is turned already.
    """
    dx, dy, apart = things[blocking, 0], things[blocking, 1], things[blocking, 4]
    left = blocking < robots or dx * sine - dy * cosine <= 0.0
    return tangent(dx, dy, WIDE * apart, left)


@compiled(
    "void(i8[::1], f8[::1], i8[::1], i4[::1], f8[::1], f8[::1], f8[::1], f8[::1], f8[:, ::1], b1[::1],"
    " f8[::1], f8, f8, f8[::1], f8[::1], f8[::1], f8[::1])"
)
def keep_clear(  # type: ignore[no-untyped-def]
    me: Indices, theta: Floats, start: Indices, near, x: Floats, y: Floats, speed_x: Floats, speed_y: Floats,
    discs: Floats, round_it, radius: Floats, clearance: float, reaction: float,
    target_x: Floats, target_y: Floats, speed: Floats, forward: Floats,
):  # fmt: skip
    """Lower the speeds [m/s] of n robots that head for targets [m] to where each can stop before what is in its way.

    `me` (n,) are their places in `x`, `y`, `speed_x`, `speed_y`, which hold everybody, `theta` [rad] their headings;
    the neighbours of robot i are near[start[i]:start[i + 1]], as of `pairs_within`. Bodies keep `clearance` [m] from
    one another and from the discs (x, y, radius); others are taken to be as large as oneself, `radius` [m] (n,). Who
    may go round (`round_it` (n,)) and is held up gets a target on the right of what is in its way, or on that side of a
    disc to which it is turned already, and so never changes its mind. Writes `speed` and the targets, and how fast they
    may go along their headings while they turn to the targets: `forward`, all (n,).
    """
    things = np.empty((len(x) + discs.shape[1], 5))
    for k in range(len(me)):
        i, wanted = me[k], speed[k]
        if i < 0:
            speed[k] = forward[k] = 0.0
            continue
        forward[k] = wanted
        robots = start[i + 1] - start[i]
        count = robots + discs.shape[1]
        dx, dy = target_x[k] - x[i], target_y[k] - y[i]
        distance = math.sqrt(dx * dx + dy * dy)
        if count == 0 or distance < 1e-9 or wanted <= 0.0:
            continue
        _see_robots(things, near, start[i], start[i + 1], i, x, y, speed_x, speed_y, 2.0 * radius[k] + clearance)
        _see_discs(things, robots, discs, x[i], y[i], radius[k], clearance)
        sine, cosine = sincos(theta[k])
        speed[k], blocking = _first_in_way(things, count, dx / distance, dy / distance, reaction, wanted)
        if blocking >= 0 and round_it[k]:
            along_x, along_y = _on_the_right(things, blocking, robots, sine, cosine)
            speed[k], _ = _first_in_way(things, count, along_x, along_y, reaction, wanted)
            target_x[k], target_y[k] = x[i] + distance * along_x, y[i] + distance * along_y
        forward[k], _ = _first_in_way(things, count, cosine, sine, reaction, wanted)

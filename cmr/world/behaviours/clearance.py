"""Avoid collisions: limit the speed so that a robot can still stop, and pass obstacles on the right.

The speed limit is the highest from which a robot can brake in time, assuming that a robot ahead also brakes: the rule
of Shalev-Shwartz, Shammah and Shashua, On a formal model of safe and scalable self-driving cars, 2017.
"""

import math

import numpy as np

from cmr.model.compiled import compiled, inlined
from cmr.model.elementary import sincos
from cmr.world.behaviours.team import Floats, Indices

BRAKING = 0.5  # m/s^2, that wheels can brake with on a smooth floor
VIEW_STEP = 0.25  # m
WIDE = 1.05  # times the required distance, at which others are passed
REACTION = 0.15  # s until a robot follows its command: the time constant of its motors


def view_needed(apart: float, speed: float, reaction: float) -> float:
    """Return how far [m] a robot that drives at `speed` [m/s] must look ahead to keep centres `apart` [m].

    It is rounded up so that robots with similar needs can share a neighbour search.
    """
    needed = apart + speed * reaction + speed * speed / BRAKING  # both of two approaching robots brake
    return math.ceil(float(needed) / VIEW_STEP) * VIEW_STEP


@compiled("f8(f8, f8, f8, f8, f8, f8, f8, f8, f8)")
def speed_before(dx, dy, along_x, along_y, speed_x, speed_y, clearance, reaction, fastest):  # type: ignore[no-untyped-def]
    """Return the speed [m/s], at most `fastest`, that keeps `clearance` [m] from an object at (dx, dy) [m], relative to
    the robot.

    (along_x, along_y) is the robot's direction of motion, a unit vector; (speed_x, speed_y) [m/s] is the object's
    velocity. The robot continues for `reaction` [s] and then brakes with BRAKING.
    """
    ahead = dx * along_x + dy * along_y
    aside = dx * along_y - dy * along_x
    if ahead <= 0.0 or abs(aside) >= clearance:
        return fastest
    free = ahead - math.sqrt(clearance * clearance - aside * aside)
    flees = speed_x * along_x + speed_y * along_y
    free += flees * abs(flees) / (2.0 * BRAKING)  # stopping distance of the object, moving towards us or away
    if free <= 0.0:
        return 0.0
    late = BRAKING * reaction
    return min(fastest, math.sqrt(late * late + 2.0 * BRAKING * free) - late)


@compiled("UniTuple(f8, 2)(f8, f8, f8, b1)")
def tangent(dx: float, dy: float, apart: float, left: bool) -> tuple[float, float]:
    """Return the direction that passes an object at (dx, dy) [m] at a distance of `apart` [m], keeping it on the left
    or right.

    A robot that is already nearer moves slightly away from it.
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
    """Return the speed limit [m/s] along a unit direction, and the index of the object that sets it.

    The index is -1 if no object limits the speed. Each row of `things` has the vector to the object [m], its velocity
    [m/s], and the distance to keep [m].
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
    """Return the direction in which a robot heading along (cosine, sine) goes round the blocking object.

    The first `robots` of the things are robots: each is passed with it on the left. A disc is passed on the side that
    the robot already faces.
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
    """Limit the speeds [m/s] of n robots heading for targets [m] so that each can stop before any object in its way.

    `me` (n,) are their indices in `x`, `y`, `speed_x`, `speed_y`, which hold all robots, `theta` [rad] their headings;
    the neighbours of robot i are near[start[i]:start[i + 1]], as of `pairs_within`. Bodies keep `clearance` [m] from
    one another and from the discs (x, y, radius); other robots are assumed to have the same size, `radius` [m] (n,). A
    blocked robot that may go round (`round_it` (n,)) gets a target to the right of the obstacle, or on the side of a
    disc that it already faces, so its choice is stable. Writes `speed`, the targets, and `forward`, the speed limit
    along the heading while turning to the target, all (n,).
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

"""Contacts between robots: overlapping discs are pushed apart, and lose their speed towards each other.

Positions. Each of two overlapping robots moves by half of the overlap along the line of centres; real robots, obstacles
and walls do not move. All pairs push at once from the same positions (Jacobi's method). Each push is divided by the
larger number of pairs that either robot is in, so the order of robots and pairs does not matter, and both robots of a
pair move by the same distance: their common centre stays. Sweeps are repeated until no overlap exceeds TOLERANCE. At
the end of each sweep, robots that overlap an obstacle are moved to its border.

Speeds. A robot with speed v along its heading h that approaches a body (normal n, pointing away from it) faster than
the body recedes (at b) loses (|v h.n| - b) |h.n| of its speed: all of it head-on, little when sliding along. Of several
contacts the largest loss counts. No robot is accelerated, so kinetic energy never grows; the yaw rate stays.

Neighbour lists hold for several steps, until a robot has moved far enough.
"""

import numpy as np
from numpy.typing import NDArray

from cmr.geometry.obstacles import Obstacles
from cmr.model.compiled import compiled, inlined
from cmr.model.elementary import sincos
from cmr.world.interaction.cells import close_pairs

Floats = NDArray[np.float64]
Flags = NDArray[np.uint8]
Pairs = NDArray[np.int32]  # (2, n): indices of both bodies

TOLERANCE = 1e-4  # m of overlap that may remain
MOST_SWEEPS = 40
SKIN = 2.0  # of the largest radius: robots that are nearer than that to touching are in the lists
LARGEST_PUSH = 0.125  # of the skin: limit per step, so that the lists stay valid and robots do not jump
FURTHEST = 1e12  # m; robots further away, or at NaN, have no contacts
GOLDEN_ANGLE = 2.399963229728653  # rad; spreads the directions in which coincident robots are separated


class Contacts:
    """Resolves the contacts of a fleet, step after step. `touched` says which robots the last step changed."""

    def __init__(self, obstacles: Obstacles) -> None:
        x, y, radius = obstacles.discs
        # Discs and walls have one representation, a line segment with a radius: discs have length 0, walls radius 0.
        self._obstacles: Floats = np.hstack(
            [np.array([x, y, x, y, radius]), np.vstack([obstacles.walls, np.zeros(obstacles.walls.shape[1])])]
        )
        self.touched: Flags = np.zeros(0, np.uint8)
        self._radius: Floats = np.zeros(0)
        self._lists: tuple[Floats, Floats, Pairs, Pairs, float] | None = None
        self._fixed_places: Floats = np.zeros((2, 0))

    def resolve(self, state: Floats, radius: Floats, wheel_radius: Floats, standing: Floats) -> bool:
        """Separate overlapping robots in place; return whether any state changed.

        `state` (5, n) has rows x, y [m], theta [rad], psi_left and psi_right [rad/s]; `radius` and `wheel_radius` (n,)
        [m] are the same arrays at each step until they change. A robot with radius 0 has no contacts. `standing` (3, m)
        are x, y and radius [m] of robots that cannot be pushed.
        """
        fixed = self._with(standing) if standing.shape[1] else self._obstacles
        if radius is not self._radius or fixed.shape[1] != self._fixed_places.shape[1]:
            self._radius, self.touched = radius, np.zeros(len(radius), np.uint8)
            self._look_around(state, fixed)
        sweeps = self._part(state, wheel_radius, fixed)
        if sweeps < 0:
            self._look_around(state, fixed)
            sweeps = self._part(state, wheel_radius, fixed)
        return sweeps > 0

    def _part(self, state: Floats, wheel_radius: Floats, fixed: Floats) -> int:
        assert self._lists is not None
        sweeps: int = _part(state, self._radius, wheel_radius, fixed, *self._lists, self.touched)
        return sweeps

    def _with(self, standing: Floats) -> Floats:
        """Return obstacles and standing robots in one array (5, m)."""
        return np.ascontiguousarray(np.hstack([self._obstacles, standing[[0, 1, 0, 1, 2]]]))

    def _look_around(self, state: Floats, fixed: Floats) -> None:
        """Build the neighbour lists, and store the positions they are based on."""
        skin = SKIN * float(np.max(self._radius, initial=0.0))
        places, self._fixed_places = np.array(state[:2], order="C"), fixed[:2].copy()
        pairs, obstacles = _near(places, self._radius, fixed, skin)
        self._lists = (places, self._fixed_places, pairs, obstacles, skin)


@compiled("Tuple((i4[:, ::1], i4[:, ::1]))(f8[:, ::1], f8[::1], f8[:, ::1], f8)")
def _near(places, radius, fixed, skin):  # type: ignore[no-untyped-def]
    """Return pairs of robots, and of robot and obstacle, that are less than `skin` [m] from touching."""
    taking_part = np.empty(len(radius), np.int32)
    x, y = np.empty(len(radius)), np.empty(len(radius))
    n = 0
    largest = 0.0
    for i in range(len(radius)):
        if radius[i] > 0.0 and abs(places[0, i]) <= FURTHEST and abs(places[1, i]) <= FURTHEST:
            taking_part[n], x[n], y[n] = i, places[0, i], places[1, i]
            n += 1
            largest = max(largest, radius[i])
    taking_part, x, y = taking_part[:n], x[:n], y[:n]
    first, second = close_pairs(x, y, 2.0 * largest + skin)
    pairs = np.empty((2, len(first)), np.int32)
    for k in range(len(first)):
        i, j = taking_part[first[k]], taking_part[second[k]]
        pairs[0, k], pairs[1, k] = min(i, j), max(i, j)
    nobody = np.empty((2, 0), np.int32)
    there_are = _near_obstacles(taking_part, x, y, radius, fixed, skin, nobody)
    obstacles = np.empty((2, there_are), np.int32)
    _near_obstacles(taking_part, x, y, radius, fixed, skin, obstacles)
    return pairs, obstacles


@compiled("i8(i4[::1], f8[::1], f8[::1], f8[::1], f8[:, ::1], f8, i4[:, ::1])")
def _near_obstacles(robots, x, y, radius, fixed, skin, found):  # type: ignore[no-untyped-def]
    """Write pairs of robot and obstacle, as many as fit; return their total number."""
    n = 0
    for f in range(fixed.shape[1]):
        for k in range(len(robots)):
            reach = radius[robots[k]] + fixed[4, f] + skin
            dx, dy = _towards(x[k], y[k], fixed, f)
            if dx * dx + dy * dy <= reach * reach:
                if n < found.shape[1]:
                    found[0, n], found[1, n] = robots[k], f
                n += 1
    return n


@inlined
def _towards(x, y, fixed, f):  # type: ignore[no-untyped-def]
    """Return the vector from a position to the nearest point of an obstacle's line."""
    ex, ey = fixed[2, f] - fixed[0, f], fixed[3, f] - fixed[1, f]
    squared = ex * ex + ey * ey
    share = ((x - fixed[0, f]) * ex + (y - fixed[1, f]) * ey) / squared if squared > 0.0 else 0.0
    share = min(max(share, 0.0), 1.0)
    return fixed[0, f] + share * ex - x, fixed[1, f] + share * ey - y


@inlined
def _unit(dx, dy, tie):  # type: ignore[no-untyped-def]
    """Return length and direction of a vector; for a zero vector `tie` determines the direction."""
    length = (dx * dx + dy * dy) ** 0.5
    sine, cosine = sincos(GOLDEN_ANGLE * tie)
    there = length > 0.0
    nx, ny = (dx / length if there else cosine), (dy / length if there else sine)
    return length, nx, ny


@compiled("i8(f8[:, :], f8[::1], f8[::1], f8[:, ::1], f8[:, ::1], f8[:, ::1], i4[:, ::1], i4[:, ::1], f8, u1[::1])")
def _part(state, radius, wheel_radius, fixed, places, fixed_places, pairs, obstacles, skin, touched):  # type: ignore[no-untyped-def]
    """Resolve all contacts; return the number of sweeps, or -1 if the lists are no longer valid."""
    largest_push = LARGEST_PUSH * skin
    if _moved(state, places) + _moved(fixed, fixed_places) > 0.5 * skin - largest_push:
        return -1
    for i in range(len(radius)):
        touched[i] = 0
    loss = np.zeros(len(radius))
    if not _slowed(state, radius, wheel_radius, fixed, pairs, obstacles, loss, touched):
        return 0
    for i in range(len(radius)):
        lost = 0.5 * loss[i] * (state[3, i] + state[4, i])
        state[3, i] -= lost
        state[4, i] -= lost
    before = np.empty((2, len(radius)))
    for i in range(len(radius)):
        before[0, i], before[1, i] = state[0, i], state[1, i]
    push = np.zeros((2, len(radius)))
    number = np.zeros(len(radius), np.int32)
    overlapping = np.empty(pairs.shape[1], np.int32)
    sweeps = 0
    overlap = np.inf
    while overlap > TOLERANCE and sweeps < MOST_SWEEPS:
        overlap = _push(state, radius, pairs, push, number, overlapping, touched)
        overlap = max(overlap, _put_back(state, radius, fixed, obstacles, touched))
        sweeps += 1
    for i in range(len(radius)):
        dx, dy = state[0, i] - before[0, i], state[1, i] - before[1, i]
        length = (dx * dx + dy * dy) ** 0.5
        if length > largest_push:
            state[0, i] = before[0, i] + dx * largest_push / length
            state[1, i] = before[1, i] + dy * largest_push / length
    return sweeps


@compiled("f8(f8[:, :], f8[:, ::1])")
def _moved(now, before):  # type: ignore[no-untyped-def]
    """Return the largest displacement [m]."""
    furthest = 0.0
    for i in range(before.shape[1]):
        dx, dy = now[0, i] - before[0, i], now[1, i] - before[1, i]
        furthest = max(furthest, dx * dx + dy * dy)
    return furthest**0.5


@compiled("b1(f8[:, :], f8[::1], f8[::1], f8[:, ::1], i4[:, ::1], i4[:, ::1], f8[::1], u1[::1])")
def _slowed(state, radius, wheel_radius, fixed, pairs, obstacles, loss, touched):  # type: ignore[no-untyped-def]
    """Compute the share of speed that each robot loses, and which robots touch; return whether any do."""
    anybody = False
    for k in range(pairs.shape[1]):
        i, j = pairs[0, k], pairs[1, k]
        dx, dy = state[0, j] - state[0, i], state[1, j] - state[1, i]
        reach = radius[i] + radius[j]
        if dx * dx + dy * dy < reach * reach:
            _, nx, ny = _unit(dx, dy, float(i + j))
            speed_i, ahead_i = _along(state, wheel_radius, i, nx, ny)
            speed_j, ahead_j = _along(state, wheel_radius, j, nx, ny)
            loss[i] = max(loss[i], _lost(speed_i, ahead_i, speed_j * ahead_j))
            loss[j] = max(loss[j], _lost(speed_j, -ahead_j, -speed_i * ahead_i))
            touched[i] = touched[j] = 1
            anybody = True
    for k in range(obstacles.shape[1]):
        i, f = obstacles[0, k], obstacles[1, k]
        dx, dy = _towards(state[0, i], state[1, i], fixed, f)
        reach = radius[i] + fixed[4, f]
        if dx * dx + dy * dy < reach * reach:
            _, nx, ny = _unit(dx, dy, float(i + f))
            speed, ahead = _along(state, wheel_radius, i, nx, ny)
            loss[i] = max(loss[i], _lost(speed, ahead, 0.0))
            touched[i] = 1
            anybody = True
    return anybody


@inlined
def _along(state, wheel_radius, i, nx, ny):  # type: ignore[no-untyped-def]
    """Return a robot's speed [m/s] and the component of its heading along a direction."""
    sine, cosine = sincos(state[2, i])
    return 0.5 * wheel_radius[i] * (state[3, i] + state[4, i]), cosine * nx + sine * ny


@inlined
def _lost(speed, ahead, gives_way):  # type: ignore[no-untyped-def]
    """Return the share of its speed that a robot loses to a body that recedes at `gives_way` [m/s] (negative:
    approaches).
    """
    excess = speed * ahead - max(gives_way, 0.0)
    return excess * ahead / speed if excess > 0.0 else 0.0


@compiled("f8(f8[:, :], f8[::1], i4[:, ::1], f8[:, ::1], i4[::1], i4[::1], u1[::1])")
def _push(state, radius, pairs, push, number, overlapping, touched):  # type: ignore[no-untyped-def]
    """Push apart all pairs that overlap; return the largest overlap [m]."""
    found = 0
    for k in range(pairs.shape[1]):
        i, j = pairs[0, k], pairs[1, k]
        if touched[i] | touched[j]:  # other pairs have not moved
            dx, dy = state[0, j] - state[0, i], state[1, j] - state[1, i]
            reach = radius[i] + radius[j]
            if dx * dx + dy * dy < reach * reach:
                overlapping[found] = k
                found += 1
                number[i] += 1
                number[j] += 1
    worst = 0.0
    for k in overlapping[:found]:
        i, j = pairs[0, k], pairs[1, k]
        length, nx, ny = _unit(state[0, j] - state[0, i], state[1, j] - state[1, i], float(i + j))
        overlap = radius[i] + radius[j] - length
        worst = max(worst, overlap)
        way = 0.5 * overlap / max(number[i], number[j])
        push[0, i] -= way * nx
        push[1, i] -= way * ny
        push[0, j] += way * nx
        push[1, j] += way * ny
    for k in overlapping[:found]:
        for side in range(2):
            i = pairs[side, k]
            state[0, i] += push[0, i]
            state[1, i] += push[1, i]
            push[0, i] = push[1, i] = 0.0
            number[i] = 0
            touched[i] = 1
    return worst


@compiled("f8(f8[:, :], f8[::1], f8[:, ::1], i4[:, ::1], u1[::1])")
def _put_back(state, radius, fixed, obstacles, touched):  # type: ignore[no-untyped-def]
    """Move robots that overlap an obstacle to its border; return the largest overlap [m]."""
    worst = 0.0
    for k in range(obstacles.shape[1]):
        i, f = obstacles[0, k], obstacles[1, k]
        dx, dy = _towards(state[0, i], state[1, i], fixed, f)
        reach = radius[i] + fixed[4, f]
        if dx * dx + dy * dy < reach * reach:
            length, nx, ny = _unit(dx, dy, float(i + f))
            worst = max(worst, reach - length)
            state[0, i] -= (reach - length) * nx
            state[1, i] -= (reach - length) * ny
            touched[i] = 1
    return worst

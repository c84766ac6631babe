"""The parts of the composed model that are the same whatever effects there are: loops, packets, coefficients.

It is text because the step, which it calls, exists only once the effects are known; see `cmr.model.compose`.
"""

IMPORTS = '''"""Composed by cmr.model.compose: do not edit, it is written again whenever an effect changes."""

from math import inf, sqrt

import numpy as np

from cmr.model.compiled import compiled, inlined
from cmr.model.elementary import cos, exp, expm1, sin, sincos
from cmr.model.step_helpers import after, random_number, share, sign

FIRST, SECOND = 0.21132486540518713, 0.7886751345948129  # Gauss-Legendre points, as shares of a step
first_BY_FIRST, first_BY_SECOND = 0.25, -0.038675134594812866
second_BY_FIRST, second_BY_SECOND = 0.5386751345948129, 0.25
'''

LOOPS = '''

@compiled("void(f8[::1], f8)")
def advance(rows, dt):
    """Let a step of dt [s] pass for all robots."""
    for block in range(len(rows) // SIZE):
        first = block * SIZE
        for i in range(LANES):
    STEP


@inlined
def _coefficients(rate, t, dt):
    """Return how a wheel speed is kept over t [s], and how it responds to a constant and to a growing source."""
    lost = expm1(-rate * t)
    z = rate * t
    gained = -lost / rate
    series = t * t * (0.5 - z * (1 / 6 - z * (1 / 24 - z * (1 / 120 - z / 720)))) / dt
    return 1.0 + lost, gained, series if z < 0.02 else (t - gained) / (rate * dt)


@compiled("void(f8[::1], f8)")
def prepare(rows, dt):
    """Compute the coefficients of all robots for steps of dt [s]."""
    for block in range(len(rows) // SIZE):
        first = block * SIZE
        for i in range(first, first + LANES):
            rate = rows[K1 + i] * rows[K2_OVER_K3 + i]
            rows[KEPT_FIRST + i], rows[GAINED_FIRST + i], rows[GROWN_FIRST + i] = _coefficients(rate, FIRST * dt, dt)
            rows[KEPT_SECOND + i], rows[GAINED_SECOND + i], rows[GROWN_SECOND + i] = _coefficients(
                rate, SECOND * dt, dt
            )
            rows[KEPT_END + i], rows[GAINED_END + i], rows[GROWN_END + i] = _coefficients(rate, dt, dt)


@compiled("void(f8[::1], i8)")
def start(rows, robot):
    """Set a robot's memory to what it is where a drive begins."""
    first, i = robot // LANES * SIZE, robot % LANES
    START


@compiled("f8(f8[::1], i8, i8, i8, i8)")
def lateness(rows, slot, seed, number, robot):
    """Return the delay [s] of a packet, infinite if it is lost; seed, number and robot fix its random numbers."""
    first, i = slot // LANES * SIZE, slot % LANES
    PACKET
    return inf if lost else delay


@compiled("void(f8[::1], i8, i8, f8, f8, f8[:, :], f8[:, :], i8, f8[:, :])")
def receive(rows, slot, number, now, dt, left, right, column, arrival):
    """Set a robot's commands to the mean over a step of those in force.

    Rows of left, right and arrival are a ring of the last packets, `number` the newest. In force is the newest that
    has arrived; before the first of all, the duty that held the speed at the start.
    """
    first, i = slot // LANES * SIZE, slot % LANES
    ring = len(arrival)
    newest = number % ring
    if arrival[newest, slot] <= now:
        rows[first + COMMAND_LEFT + i], rows[first + COMMAND_RIGHT + i] = left[newest, column], right[newest, column]
        return
    until, mean_left, mean_right = now + dt, 0.0, 0.0
    for k in range(number, max(number - ring, -1), -1):
        here = k % ring
        since = max(arrival[here, slot], now)
        if since < until:
            mean_left += (until - since) / dt * left[here, column]
            mean_right += (until - since) / dt * right[here, column]
            until = since
        if until <= now:
            break
    rest = (until - now) / dt
    rows[first + COMMAND_LEFT + i] = mean_left + rest * rows[first + LEFT_BEFORE + i]
    rows[first + COMMAND_RIGHT + i] = mean_right + rest * rows[first + RIGHT_BEFORE + i]


@compiled("void(f8[::1], i8, f8[:, :], f8[:, :], f8[::1], f8[:, :], b1, i8, i8[::1], f8[:, :, ::1])")
def drive(rows, robots, left, right, dt, arrival, late, seed, at, recorded):
    """Drive T spans with every robot and record the states at the borders `at`.

    Shapes: left, right (T, 1); dt (T,); arrival (T, robots), to be filled if commands are late; at (R,), ascending;
    recorded (R, robots, 7): x, y, theta, psi and angle of both sides.
    """
    for block in range((robots + LANES - 1) // LANES):
        first = block * SIZE
        here = rows[first : first + SIZE]
        lanes = min(LANES, robots - block * LANES)
        prepared, border, now = -1.0, 0, rows[first + TIME]
        for r in range(len(at)):
            while border < at[r]:
                if dt[border] != prepared:
                    prepared = dt[border]
                    prepare(here, prepared)
                for i in range(LANES):
                    rows[first + COMMAND_LEFT + i] = left[border, 0]
                    rows[first + COMMAND_RIGHT + i] = right[border, 0]
                if late:
                    for slot in range(block * LANES, block * LANES + lanes):
                        arrival[border, slot] = now + lateness(rows, slot, seed, border, 0)
                        receive(rows, slot, border, now, prepared, left, right, 0, arrival)
                advance(here, prepared)
                now += prepared
                border += 1
            for i in range(lanes):
                for field in range(7):
                    recorded[r, block * LANES + i, field] = rows[first + field * LANES + i]


@compiled("void(f8[::1], i8[::1], i8[::1], i8[::1], f8[:, ::1], i8, f8, f8[:, ::1], f8[:, ::1], f8[:, ::1])")
def receive_all(rows, slots, robots, numbers, duty, seed, dt, left, right, arrival):
    """Send a packet to each robot of a fleet whose commands may be late, and set what is in force.

    `slots` are those robots' places, `robots` their indices, `numbers` how many packets each had before; `duty`
    (2, slots) are the commands of all, and the rings left, right and arrival have a column for each slot.
    """
    ring = len(arrival)
    for k in range(len(slots)):
        slot, number = slots[k], numbers[k]
        first, i = slot // LANES * SIZE, slot % LANES
        now = rows[first + TIME + i]
        late = lateness(rows, slot, seed, number, robots[k])
        here, before = number % ring, (number - 1) % ring
        arrival[here, slot] = now + late
        left[here, slot], right[here, slot] = duty[0, slot], duty[1, slot]
        if late == inf:
            # What was before stays, for good: the ring forgets.
            arrival[here, slot] = now if number == 0 else arrival[before, slot]
            left[here, slot] = rows[first + LEFT_BEFORE + i] if number == 0 else left[before, slot]
            right[here, slot] = rows[first + RIGHT_BEFORE + i] if number == 0 else right[before, slot]
        receive(rows, slot, number, now, dt, left, right, slot, arrival)
        numbers[k] = number + 1
'''

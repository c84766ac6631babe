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


@inlined
def lateness(rows, slot, seed, number, robot):
    """Return the delay [s] of a packet, infinite if it is lost; seed, number and robot fix its random numbers."""
    first, i = slot // LANES * SIZE, slot % LANES
    PACKET
    return inf if lost else delay


@compiled("void(f8[::1], i8, f8[::1], i8, i8, i8, i8, f8, f8, f8)")
def command(rows, slot, packets, ring, number, seed, robot, dt, duty_left, duty_right):
    """Send a robot its next packet and set its commands to the mean over the step of those in force.

    In force is the newest packet that has arrived; before the first, the duty that held the speed at the start.
    `packets` holds the last ones, `ring` for each slot: left, right, arrival. `number` counts the robot's packets.
    """
    first, i = slot // LANES * SIZE, slot % LANES
    now = rows[first + TIME + i]
    late = lateness(rows, slot, seed, number, robot)
    ring_start = 3 * ring * slot
    position = number % ring
    newest = ring_start + 3 * position
    before = newest - 3 if position > 0 else newest + 3 * (ring - 1)
    packets[newest], packets[newest + 1], packets[newest + 2] = duty_left, duty_right, now + late
    if late == inf and number > 0:
        # A lost packet leaves the one before in force.
        packets[newest], packets[newest + 1] = packets[before], packets[before + 1]
        packets[newest + 2] = packets[before + 2]
    elif late == inf:
        packets[newest], packets[newest + 1] = rows[first + LEFT_BEFORE + i], rows[first + RIGHT_BEFORE + i]
        packets[newest + 2] = now
    if packets[newest + 2] <= now:
        rows[first + COMMAND_LEFT + i], rows[first + COMMAND_RIGHT + i] = packets[newest], packets[newest + 1]
        return
    until, sum_left, sum_right = now + dt, 0.0, 0.0
    here = newest
    for _ in range(min(number + 1, ring)):
        since = max(packets[here + 2], now)
        if since < until:
            sum_left += (until - since) * packets[here]
            sum_right += (until - since) * packets[here + 1]
            until = since
            if until <= now:
                break
        here = here - 3 if here > ring_start else here + 3 * (ring - 1)
    rows[first + COMMAND_LEFT + i] = (sum_left + (until - now) * rows[first + LEFT_BEFORE + i]) / dt
    rows[first + COMMAND_RIGHT + i] = (sum_right + (until - now) * rows[first + RIGHT_BEFORE + i]) / dt


@compiled("void(f8[::1], i8[::1], i8[::1], i8[::1], f8[:, ::1], i8, f8, f8[::1], i8)")
def command_all(rows, slots, robots, numbers, duty, seed, dt, packets, ring):
    """Send the next packet to the robots of a fleet whose commands may be late.

    `slots` are their places, `robots` their indices, `numbers` counts their packets; `duty` (2, all slots).
    """
    for k in range(len(slots)):
        slot = slots[k]
        command(rows, slot, packets, ring, numbers[k], seed, robots[k], dt, duty[0, slot], duty[1, slot])
        numbers[k] += 1


@compiled("void(f8[::1], i8, f8[::1], f8[::1], f8[::1], f8[::1], i8, i8[::1], f8[:, :, ::1])")
def drive(rows, robots, left, right, dt, packets, seed, at, recorded):
    """Drive T spans with every robot and record the states at the borders `at`.

    Shapes: left, right, dt (T,); packets (3 T robots) to be filled, or empty where no commands are late; at (R,),
    ascending; recorded (R, robots, 7): x, y, theta, psi and angle of both sides.
    """
    for block in range((robots + LANES - 1) // LANES):
        first = block * SIZE
        here = rows[first : first + SIZE]
        lanes = min(LANES, robots - block * LANES)
        prepared, border = -1.0, 0
        for r in range(len(at)):
            while border < at[r]:
                if dt[border] != prepared:
                    prepared = dt[border]
                    prepare(here, prepared)
                for i in range(LANES):
                    rows[first + COMMAND_LEFT + i], rows[first + COMMAND_RIGHT + i] = left[border], right[border]
                if len(packets) > 0:
                    for slot in range(block * LANES, block * LANES + lanes):
                        command(
                            rows, slot, packets, len(dt), border, seed, 0, prepared, left[border], right[border]
                        )
                advance(here, prepared)
                border += 1
            for i in range(lanes):
                for field in range(7):
                    recorded[r, block * LANES + i, field] = rows[first + field * LANES + i]
'''

"""The parts of the composed model that are the same whatever effects there are: loops, packets, coefficients.

It is text because the step, which it calls, exists only once the effects are known; see `cmr.model.compose`.
"""

IMPORTS = '''"""Composed by cmr.model.compose: do not edit, it is written again whenever an effect changes."""

from math import inf, sqrt

import numpy as np

from cmr.model.compiled import compiled, inlined
from cmr.model.elementary import cos, exp, expm1, sin, sincos
from cmr.model.selecting import select
from cmr.model.step_helpers import after, random_number, share, sign

FIRST, SECOND = 0.21132486540518713, 0.7886751345948129  # Gauss-Legendre points, as shares of a step
first_BY_FIRST, first_BY_SECOND = 0.25, -0.038675134594812866
second_BY_FIRST, second_BY_SECOND = 0.5386751345948129, 0.25
end_BY_FIRST, end_BY_SECOND = 0.5, 0.5
'''

LOOPS = '''

@compiled("void(f8[::1], f8[::1], i8[::1], i8)")
def advance(rows, work, varying, lanes):
    """Let a step pass for the first `lanes` robots of each block: all, or as many as ABREAST goes into.

    How long it is, each robot has in its row DT, with the coefficients that go with it: see `prepare`.

    The rows of a block of LANES robots are the first ones, up to OWN, and then those of `varying`, by their place in
    `work`, where a block is computed. It holds the other parameters, which all robots share.
    """
    stride = OWN + len(varying) * LANES
    for block in range(len(rows) // stride):
        here = rows[block * stride : (block + 1) * stride]
        for j in range(OWN):
            work[j] = here[j]
        for row in range(len(varying)):
            place = work[varying[row] : varying[row] + LANES]
            for i in range(LANES):
                place[i] = here[OWN + row * LANES + i]
    STEP
        for j in range(CHANGED):
            here[j] = work[j]


@inlined
def _coefficients(rate, t, dt):
    """Return how a wheel speed is kept over t [s], and how it responds to a constant and to a growing source."""
    lost = expm1(-rate * t)
    z = rate * t
    gained = -lost / rate
    series = t * t * (0.5 - z * (1 / 6 - z * (1 / 24 - z * (1 / 120 - z / 720)))) / dt
    return 1.0 + lost, gained, series if z < 0.02 else (t - gained) / (rate * dt)


@inlined
def _prepare(rows, i, dt):
    """Compute the coefficients of the robot in place `i` for a step of dt [s]."""
    rate = rows[K1 + i] * rows[K2_OVER_K3 + i]
    rows[DT + i] = dt
    rows[KEPT_FIRST + i], rows[GAINED_FIRST + i], rows[GROWN_FIRST + i] = _coefficients(rate, FIRST * dt, dt)
    rows[KEPT_SECOND + i], rows[GAINED_SECOND + i], rows[GROWN_SECOND + i] = _coefficients(rate, SECOND * dt, dt)
    rows[KEPT_END + i], rows[GAINED_END + i], rows[GROWN_END + i] = _coefficients(rate, dt, dt)


@compiled("void(f8[::1], i8, f8)")
def prepare(rows, stride, dt):
    """Prepare all robots for steps of dt [s]; a block takes `stride` numbers."""
    for block in range(len(rows) // stride):
        for i in range(block * stride, block * stride + LANES):
            _prepare(rows, i, dt)


@compiled("void(f8[::1], f8[::1])")
def prepare_each(here, durations):
    """Prepare the robots of one block for steps of `durations` [s], (LANES,)."""
    for i in range(LANES):
        _prepare(here, i, durations[i])


@compiled("void(f8[::1], i8)")
def start(rows, robots):
    """Set the memory of the first `robots` to what it is where a drive begins; blocks have all rows here."""
    for robot in range(robots):
        first, i = robot // LANES * SIZE, robot % LANES
    START


@compiled("void(f8[::1], i8, f8[:, ::1], i8[::1], i8, i8, f8[::1], i8, i8, f8)")
def send(rows, stride, duty, robots, seed, count, packets, ring, number, dt):
    """Send each robot its `duty` (2, robots), and set its commands to the mean over the step of those in force.

    In force is the newest packet that has arrived; before the first, the duty that held the speed at the start.
    `packets` holds the last `ring` ones of each block: left, right, arrival. `number` is 0 for the first packet;
    seed, count and the index in `robots` fix a packet's random numbers.
    """
    duty_left, duty_right = duty[0], duty[1]
    packet, per_dt = 3 * LANES, 1.0 / dt
    mean = np.empty(3 * LANES)  # of left, of right; and until when the step's commands are not known yet
    for block in range(len(rows) // stride):
        here = rows[block * stride : (block + 1) * stride]
        sent = packets[block * ring * packet : (block + 1) * ring * packet]
        index = robots[block * LANES : (block + 1) * LANES]
        wanted_left = duty_left[block * LANES : (block + 1) * LANES]
        wanted_right = duty_right[block * LANES : (block + 1) * LANES]
        if number == 0:
            for k in range(ring):
                for i in range(LANES):
                    sent[k * packet + i] = here[LEFT_BEFORE + i]
                    sent[k * packet + LANES + i] = here[RIGHT_BEFORE + i]
                    sent[k * packet + 2 * LANES + i] = -inf
        position = number % ring
        newest = sent[position * packet : (position + 1) * packet]
        position = (number + ring - 1) % ring
        before = sent[position * packet : (position + 1) * packet]
        for i in range(LANES):
            robot = index[i]
            now = here[TIME + i]
    PACKET
            # A lost packet leaves the one before in force.
            left = before[i] if lost else wanted_left[i]
            right = before[LANES + i] if lost else wanted_right[i]
            arrival = before[2 * LANES + i] if lost else now + delay
            newest[i], newest[LANES + i], newest[2 * LANES + i] = left, right, arrival
            mean[i], mean[LANES + i], mean[2 * LANES + i] = 0.0, 0.0, now + dt
        for k in range(ring):
            position = (number + ring - k) % ring
            one = sent[position * packet : (position + 1) * packet]
            for i in range(LANES):
                since = max(one[2 * LANES + i], here[TIME + i])
                share = max(mean[2 * LANES + i] - since, 0.0) * per_dt
                mean[i] += share * one[i]
                mean[LANES + i] += share * one[LANES + i]
                mean[2 * LANES + i] = min(mean[2 * LANES + i], since)
        for i in range(LANES):
            arrived = newest[2 * LANES + i] <= here[TIME + i]
            here[COMMAND_LEFT + i] = newest[i] if arrived else mean[i]
            here[COMMAND_RIGHT + i] = newest[LANES + i] if arrived else mean[LANES + i]


@compiled("void(f8[::1], f8[::1], i8[::1], i8, f8[::1], f8[::1], f8[::1], i8, i8, i8[::1], f8[:, :, ::1])")
def drive(rows, work, varying, robots, left, right, dt, ring, seed, at, recorded):
    """Drive T spans with every robot and record the states at the borders `at`.

    Shapes: left, right, dt (T,); at (R,), ascending; recorded (R, robots, 7): x, y, theta, psi and angle of both
    sides. `ring` is the number of packets that may be under way, 0 where none is late. All robots have the same luck.
    """
    stride = OWN + len(varying) * LANES
    packets = np.empty(ring * 3 * LANES)
    index = np.zeros(LANES, dtype=np.int64)
    duty = np.empty((2, LANES))
    for block in range((robots + LANES - 1) // LANES):
        here = rows[block * stride : (block + 1) * stride]
        lanes = min(LANES, robots - block * LANES)
        prepared, border = -1.0, 0
        for r in range(len(at)):
            while border < at[r]:
                if dt[border] != prepared:
                    prepared = dt[border]
                    prepare(here, stride, prepared)
                for i in range(LANES):
                    here[COMMAND_LEFT + i], here[COMMAND_RIGHT + i] = left[border], right[border]
                if ring > 0:
                    duty[0], duty[1] = left[border], right[border]
                    send(here, stride, duty, index, seed, border, packets, ring, border, prepared)
                advance(here, work, varying, LANES)
                border += 1
            for i in range(lanes):
                for field in range(7):
                    recorded[r, block * LANES + i, field] = here[field * LANES + i]
'''

"""The loops around the composed step: over blocks of robots, commands in transit, and spans of a drive.

They are compiled once, whatever effects there are, and call the composed functions of `Equations`.
"""

from collections.abc import Callable
from math import inf
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cmr.model.compiled import call, compiled, inlined, structure
from cmr.model.extended.compose import (
    COMMAND_LEFT,
    COMMAND_RIGHT,
    DT,
    GAINED_END,
    GAINED_FIRST,
    GAINED_SECOND,
    GROWN_END,
    GROWN_FIRST,
    GROWN_SECOND,
    K1,
    K2_OVER_K3,
    KEPT_END,
    KEPT_FIRST,
    KEPT_SECOND,
    LANES,
    LEFT_BEFORE,
    RECORDED,
    RIGHT_BEFORE,
    TIME,
    Layout,
    X,
)
from cmr.model.extended.step_helpers import coefficients
from cmr.model.extended.step_statements import FIRST, SECOND

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]


class Equations(NamedTuple):
    """The equations of effects, as addresses of composed functions."""

    step: Callable[[Floats, Floats, Indices, int], None]
    begin: Callable[[Floats], None]
    packet: Callable[[Floats, Indices, int, int, Floats], None]


class Robots(NamedTuple):
    """Robots in blocks of LANES, as arranged by `cmr.model.extended.model.Blocks`.

    In `rows` a block has each robot's own values, and then the rows of `varying`, by their offset in `work`, where a
    block is computed. `work` also holds the shared parameters.
    """

    rows: Floats
    work: Floats
    varying: Indices


class Spans(NamedTuple):
    """Commands of T spans, and their durations [s]; shape (T,)."""

    left: Floats
    right: Floats
    dt: Floats


EQUATIONS = structure(Equations, "i8", "i8", "i8")
LAYOUT = structure(Layout, "i8", "i8", "i8")
ROBOTS = structure(Robots, "f8[::1]", "f8[::1]", "i8[::1]")
SPANS = structure(Spans, "f8[::1]", "f8[::1]", "f8[::1]")


@inlined
def _prepare(rows: Floats, i: int, dt: float) -> None:
    """Compute the coefficients of the robot in lane `i` for a step of dt [s]."""
    rate = rows[K1 + i] * rows[K2_OVER_K3 + i]
    rows[DT + i] = dt
    rows[KEPT_FIRST + i], rows[GAINED_FIRST + i], rows[GROWN_FIRST + i] = coefficients(rate, FIRST * dt, dt)
    rows[KEPT_SECOND + i], rows[GAINED_SECOND + i], rows[GROWN_SECOND + i] = coefficients(rate, SECOND * dt, dt)
    rows[KEPT_END + i], rows[GAINED_END + i], rows[GROWN_END + i] = coefficients(rate, dt, dt)


@compiled("void(f8[::1], i8, f8)")
def prepare(rows: Floats, stride: int, dt: float) -> None:
    """Prepare all robots for steps of dt [s]; a block takes `stride` numbers."""
    for block in range(len(rows) // stride):
        for i in range(block * stride, block * stride + LANES):
            _prepare(rows, i, dt)


@compiled("void(f8[::1], f8[::1])")
def prepare_each(here: Floats, durations: Floats) -> None:
    """Prepare the robots of one block for steps of `durations` [s], (LANES,)."""
    for i in range(LANES):
        _prepare(here, i, durations[i])


@compiled("void(i8, f8[::1], i8)")
def start(begin: Callable[[Floats], None], rows: Floats, size: int) -> None:
    """Initialise the memory of all robots; blocks have all rows here, `size` numbers."""
    for block in range(len(rows) // size):
        call(begin, rows[block * size : (block + 1) * size])


@compiled("void(i8, f8[::1], i8, f8[:, ::1], i8[::1], i8, i8, f8[::1], i8, i8, f8)")
def send(
    packet: Callable[[Floats, Indices, int, int, Floats], None],
    rows: Floats,
    stride: int,
    duty: Floats,
    robots: Indices,
    seed: int,
    count: int,
    packets: Floats,
    ring: int,
    number: int,
    dt: float,
) -> None:
    """Send each robot its `duty` (2, robots), and set its command to the mean over the step of the commands in force.

    The newest packet that has arrived is in force; before the first, the duty that held the speed at the start.
    `packets` holds the last `ring` ones of each block: left, right, arrival. `number` is 0 for the first packet; seed,
    count and the index in `robots` determine a packet's random numbers.
    """
    length = 3 * LANES
    lateness = np.empty((2, LANES))
    mean = np.empty(length)  # mean of left and of right; and the end of the part of the step without known commands
    for block in range(len(rows) // stride):
        here = rows[block * stride : (block + 1) * stride]
        first = block * LANES
        sent = packets[block * ring * length : (block + 1) * ring * length]
        if number == 0:
            _forget(here, sent, ring)
        call(packet, here, robots[first : first + LANES], seed, count, lateness)
        newest, before = _packet(sent, ring, number), _packet(sent, ring, number + ring - 1)
        _put(here, newest, before, duty, first, lateness)
        for i in range(LANES):
            mean[i], mean[LANES + i], mean[2 * LANES + i] = 0.0, 0.0, here[TIME + i] + dt
        _average(here, sent, ring, number, mean, 1.0 / dt)
        for i in range(LANES):
            arrived = newest[2 * LANES + i] <= here[TIME + i]
            here[COMMAND_LEFT + i] = newest[i] if arrived else mean[i]
            here[COMMAND_RIGHT + i] = newest[LANES + i] if arrived else mean[LANES + i]


@inlined
def _packet(sent: Floats, ring: int, number: int) -> Floats:
    """Return the packets with this number of a block's robots."""
    position = number % ring * 3 * LANES
    return sent[position : position + 3 * LANES]


@inlined
def _put(here: Floats, newest: Floats, before: Floats, duty: Floats, first: int, lateness: Floats) -> None:
    """Put a block's `newest` packets in transit; a lost one keeps the one `before` in force."""
    for i in range(LANES):
        lost, now = lateness[1, i] > 0.0, here[TIME + i]
        newest[i] = before[i] if lost else duty[0, first + i]
        newest[LANES + i] = before[LANES + i] if lost else duty[1, first + i]
        newest[2 * LANES + i] = before[2 * LANES + i] if lost else now + lateness[0, i]


@inlined
def _forget(here: Floats, sent: Floats, ring: int) -> None:
    """Fill a block's packets with the duties that hold its speeds, as if always in force."""
    for k in range(0, ring * 3 * LANES, 3 * LANES):
        for i in range(k, k + LANES):
            sent[i] = here[LEFT_BEFORE + i - k]
            sent[LANES + i] = here[RIGHT_BEFORE + i - k]
            sent[2 * LANES + i] = -inf


@inlined
def _average(here: Floats, sent: Floats, ring: int, number: int, mean: Floats, per_dt: float) -> None:
    """Add each packet of a block to the `mean` weighted by its share of the step in force, newest first."""
    for k in range(ring):
        one = _packet(sent, ring, number + ring - k)
        for i in range(LANES):
            since = max(one[2 * LANES + i], here[TIME + i])
            share = max(mean[2 * LANES + i] - since, 0.0) * per_dt
            mean[i] += share * one[i]
            mean[LANES + i] += share * one[LANES + i]
            mean[2 * LANES + i] = min(mean[2 * LANES + i], since)


@compiled(EQUATIONS, "i8", ROBOTS, "i8", SPANS, "i8", "i8", "i8[::1]", "f8[:, :, ::1]")
def drive(
    equations: Equations,
    own: int,
    robots: Robots,
    count: int,
    spans: Spans,
    ring: int,
    seed: int,
    at: Indices,
    recorded: Floats,
) -> None:
    """Drive T spans with `count` robots and record their states at the borders `at`, ascending.

    `own` is that of `Layout`; `recorded` has shape (len(at), count, RECORDED). `ring` is the largest number of packets
    in transit, 0 without delays. All robots have the same random numbers.
    """
    stride = own + len(robots.varying) * LANES
    packets, index, duty = np.empty(ring * 3 * LANES), np.zeros(LANES, dtype=np.int64), np.empty((2, LANES))
    for first in range(0, count, LANES):
        here = robots.rows[first // LANES * stride : (first // LANES + 1) * stride]
        prepared, border = -1.0, 0
        for r in range(len(at)):
            while border < at[r]:
                left, right, dt = spans.left[border], spans.right[border], spans.dt[border]
                if dt != prepared:
                    prepared = dt
                    prepare(here, stride, dt)
                for i in range(LANES):
                    here[COMMAND_LEFT + i], here[COMMAND_RIGHT + i] = left, right
                if ring > 0:
                    duty[0], duty[1] = left, right
                    send(equations.packet, here, stride, duty, index, seed, border, packets, ring, border, dt)
                call(equations.step, here, robots.work, robots.varying, LANES)
                border += 1
            for i in range(min(LANES, count - first)):
                for field in range(RECORDED):
                    recorded[r, first + i, field] = here[X + field * LANES + i]

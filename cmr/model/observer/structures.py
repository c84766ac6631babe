"""The structures that the compiled observer takes, and their Numba types.

It observes K drives, which have `steps` steps together, with C candidates, one in each of the `lanes`: blocks of LANES.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cmr.model.compiled import structure
from cmr.model.extended.compose import Layout
from cmr.model.extended.stepping import EQUATIONS, LAYOUT, ROBOTS, Equations, Robots

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]
Flags = NDArray[np.uint8]


class Sensors(NamedTuple):
    """The effects of sensors, as addresses of functions composed by `sensor_effects`.

    Each function changes rows of a block's `own` at a stamped `time` [s], in the first `lanes` lanes. `gyro_moves` and
    `pose_moves` say whether readings depend on the robot's speed or place as well, which are computed only then.
    """

    gyro_time: Callable[[Floats, float, int], None]
    gyro: Callable[[Floats, float, int], None]
    encoder: Callable[[Floats, float, int], None]
    pose_time: Callable[[Floats, float, int], None]
    pose: Callable[[Floats, float, int], None]
    gyro_moves: bool
    pose_moves: bool


class Model(NamedTuple):
    """The model of all candidates, compiled. Memory at the rows `lasting` outlasts the gap between two drives."""

    equations: Equations
    layout: Layout
    lasting: Indices
    sensors: Sensors


class CandidateRows(NamedTuple):
    """Candidates in blocks; `at_rest` are the blocks with all rows, from which each drive starts.

    `numbers`, (rows, lanes), are the rows of `own` from GAIN_ANGLE on; `profile` and `streams`, (lanes,), the number of
    the candidate's profile of commands, and the one that determines its random numbers.
    """

    robots: Robots
    at_rest: Floats
    numbers: Floats
    profile: Indices
    streams: Indices


class CommandRows(NamedTuple):
    """Commands of all drives: `profiles` (P, steps, 5), and whether a step is split at a command, (steps,).

    `ring` is the largest number of commands in transit, 0 if delays are not random; `seed` determines them.
    """

    profiles: Floats
    splitting: Flags
    ring: int
    seed: int


class Ends(NamedTuple):
    """The ends of each of K drives in joined arrays, shape (K + 1,), starting with 0."""

    steps: Indices
    wheel: Indices
    gyro: Indices
    pose: Indices
    given: Indices


class Readings(NamedTuple):
    """The arrays of `Observations` of all drives, joined."""

    wheel_time: Floats
    wheel: Floats
    wheel_use: Flags
    gyro_time: Floats
    gyro: Floats
    pose_time: Floats
    pose: Floats
    pose_use: Flags
    given: Floats


class Recorded(NamedTuple):
    """What was recorded of K drives, one after another; `ends` are the ends of each drive's rows.

    `start` (K, 7) is x, y, theta, psi_left, psi_right and the wheel rotations there [rad], `began` (K,) [s] the time
    since the robot set off. A `continued` (K,) drive follows the previous one after a gap: lasting memory, such as the
    battery's charge, is kept.
    """

    start: Floats
    began: Floats
    continued: Flags
    ends: Ends
    readings: Readings


class Innovations(NamedTuple):
    """Prediction errors of C candidates: wheel (W, 2, C) [rad], gyro (G, C) [rad/s], pose (P, 3, C) [m, m, rad; world].

    `motion`, shape (T + 1, 10), is the motion of the first candidate: columns `observer.MOTION`.
    """

    wheel: Floats
    gyro: Floats
    pose: Floats
    motion: Floats


class Buffers(NamedTuple):
    """What the compiled observer writes on the way: it allocates nothing itself.

    `own` and `past` are described in `helpers`. `whole`, `before` and `behind` are the coefficients of whole steps, and
    of both parts of split ones; `duty` is the command sent, (2, LANES), and `packets` are those in transit.
    """

    own: Floats
    past: Floats
    whole: Floats
    before: Floats
    behind: Floats
    duty: Floats
    packets: Floats


class Block(NamedTuple):
    """A block of candidates: `lanes` ones from number `first` on, for which the first `filled` lanes are computed.

    `here` are its rows of `robots`, `yaw_rates` those of its last step; `profile` and `streams` are those of its lanes.
    """

    first: int
    lanes: int
    filled: int
    robots: Robots
    here: Floats
    yaw_rates: Floats
    profile: Indices
    streams: Indices
    buffers: Buffers


LINE, TABLE, CUBE, NUMBERS, FLAGS = "f8[::1]", "f8[:, ::1]", "f8[:, :, ::1]", "i8[::1]", "u1[::1]"
SENSORS = structure(Sensors, *["i8"] * 5, "b1", "b1")
MODEL = structure(Model, EQUATIONS, LAYOUT, NUMBERS, SENSORS)
CANDIDATE_ROWS = structure(CandidateRows, ROBOTS, LINE, TABLE, NUMBERS, NUMBERS)
COMMAND_ROWS = structure(CommandRows, CUBE, FLAGS, "i8", "i8")
ENDS = structure(Ends, *[NUMBERS] * len(Ends._fields))
READINGS = structure(Readings, LINE, TABLE, "u1[:, ::1]", LINE, LINE, LINE, TABLE, FLAGS, TABLE)
RECORDED = structure(Recorded, TABLE, LINE, FLAGS, ENDS, READINGS)
INNOVATIONS = structure(Innovations, CUBE, TABLE, CUBE, TABLE)
BUFFERS = structure(Buffers, LINE, TABLE, LINE, LINE, LINE, TABLE, LINE)

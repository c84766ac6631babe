"""History of steps and candidate data of the compiled observer, and their access; compiled into its loops.

The history is `past`, shape (history, PAST_ROWS): the pose at the end of each step, and the course of the yaw rate
within it. Other data of a candidate are in one array, `own`. Both have rows of LANES, like the model's rows in `here`:
only then does the compiler know that they do not overlap, and vectorises.
"""

import numpy as np
from numpy.typing import NDArray

from cmr.model.compiled import inlined
from cmr.model.elementary import cos, sin
from cmr.model.extended.compose import ANGLE_LEFT, ANGLE_RIGHT, KEPT_END, LANES, PSI_LEFT, PSI_RIGHT, THETA, X, Y
from cmr.model.parameters import DEFINITIONS as PAPER

Floats = NDArray[np.float64]

EARLY = 1e-3  # of a step: smaller differences between times do not count
NEARBY = 1e-3  # m
# Rows of the history, for each step: the pose at its end; the share of its split, the mean yaw rate before it and its
# growth there, then the same after it, then the curvatures before and after: parabolas.
PAST_X, PAST_Y, PAST_THETA, SPLIT_AT, MEAN_BEFORE, GROWTH_BEFORE = range(0, 6 * LANES, LANES)
MEAN, GROWTH, CURVE_BEFORE, CURVE, PAST_ROWS = range(6 * LANES, 11 * LANES, LANES)
TWELFTH = 1.0 / 12.0
# Ratio of the growth of a line between the ends of a step to that between its two Gauss points.
STEEP = 1.7320508075688772

# Changing rows: the first six are the accumulated corrections of pose and wheels.
OFFSET_X, OFFSET_Y, OFFSET_THETA, OFFSET_LEFT, OFFSET_RIGHT, OFFSET_YAW_RATE = range(0, 6 * LANES, LANES)
# A step: wheel angles where it begins, and at the share HALF, where it is split; the bows of both parts; the mean yaw
# rate, its growth and its curvature. Steps were last split at SHARE; PART is the duration of a part [s].
BEFORE_LEFT, BEFORE_RIGHT, HALF, MIDDLE_LEFT, MIDDLE_RIGHT, SHARE, PART = range(6 * LANES, 13 * LANES, LANES)
BOW_BEFORE_LEFT, BOW_BEFORE_RIGHT, BOW_LEFT, BOW_RIGHT = range(13 * LANES, 17 * LANES, LANES)
TURNING, GROWING, CURVING = range(17 * LANES, 20 * LANES, LANES)
# Encoders: what they read, and their errors.
READING_LEFT, READING_RIGHT, ERROR_LEFT, ERROR_RIGHT = range(20 * LANES, 24 * LANES, LANES)
# The gyro: the moment of a reading [s], then its position [steps]; what it reads; the motion besides.
GYRO_AT, GYRO_READING, GYRO_SPEED, GYRO_X, GYRO_Y, GYRO_THETA = range(24 * LANES, 30 * LANES, LANES)
# Poses: the moment [s], the time constant of the filter [s], the pose then, and the motion besides; what the sensor
# reads there, and displaced by NEARBY; the errors.
AT_TIME, FILTERED, AT_X, AT_Y, AT_THETA, POSE_SPEED, POSE_YAW_RATE = range(30 * LANES, 37 * LANES, LANES)
SEEN_X, SEEN_Y, SEEN_THETA, EAST_X, EAST_Y, NORTH_X, NORTH_Y = range(37 * LANES, 44 * LANES, LANES)
ERROR_X, ERROR_Y, ERROR_THETA = range(44 * LANES, 47 * LANES, LANES)
# Given rows: gains, wheel radians per encoder radian, radii [m], and the time of slip [s]; then the parameters of
# sensors.
GAIN_ANGLE, GAIN_PSI, GAIN_POSITION, GAIN_THETA = range(47 * LANES, 51 * LANES, LANES)
SCALE_LEFT, SCALE_RIGHT, RADIUS_LEFT, RADIUS_RIGHT, SLIP_TIME = range(51 * LANES, 56 * LANES, LANES)
SENSORS = 56 * LANES  # the paper's parameters, and those of effects of sensors
K2_OVER_K3, K1, BASE_WIDTH = (SENSORS + LANES * [*PAPER].index(name) for name in ("k2_over_k3", "k1", "base_width"))


@inlined
def border_of(past: Floats, border: int) -> Floats:
    """Return the history at a border, whose length is a power of two.

    The index is unsigned, so that no access checks for negative values.
    """
    there: Floats = past[np.uint64(border & (len(past) - 1))]
    return there


@inlined
def begin_past(past: Floats, own: Floats, here: Floats, dt: float) -> None:
    """Initialise the history with motion at the initial speeds: the first poses of a late sensor show it."""
    history = len(past)
    for h in range(history):
        one, ago = past[h], ((history - h) & (history - 1)) * dt
        for i in range(LANES):
            left, right = own[RADIUS_LEFT + i] * here[PSI_LEFT + i], own[RADIUS_RIGHT + i] * here[PSI_RIGHT + i]
            turned = ago * (right - left) / own[BASE_WIDTH + i]
            rolled, along = 0.5 * ago * (left + right), here[THETA + i] - 0.5 * turned
            one[PAST_X + i] = here[X + i] - rolled * cos(along)
            one[PAST_Y + i] = here[Y + i] - rolled * sin(along)
            one[PAST_THETA + i] = here[THETA + i] - turned
        for row in range(SPLIT_AT, PAST_ROWS):
            one[row] = 0.0


@inlined
def begin_step(own: Floats, here: Floats, lanes: int) -> None:
    """Store the wheel angles at the beginning of a step."""
    for i in range(lanes):
        own[BEFORE_LEFT + i], own[BEFORE_RIGHT + i] = here[ANGLE_LEFT + i], here[ANGLE_RIGHT + i]


@inlined
def turn_wheels(own: Floats, here: Floats, speeds: Floats, lanes: int) -> None:
    """Set the speeds of the wheels for a step to given ones of their encoders (2,) [rad/s]."""
    for i in range(lanes):
        here[PSI_LEFT + i] = speeds[0] * own[SCALE_LEFT + i]
        here[PSI_RIGHT + i] = speeds[1] * own[SCALE_RIGHT + i]


@inlined
def not_split(newest: Floats, own: Floats, lanes: int) -> None:
    """Mark a step as not split."""
    for i in range(lanes):
        newest[SPLIT_AT + i] = 0.0
        own[HALF + i] = 0.0
        own[MIDDLE_LEFT + i], own[MIDDLE_RIGHT + i] = own[BEFORE_LEFT + i], own[BEFORE_RIGHT + i]


@inlined
def end_first_part(newest: Floats, own: Floats, here: Floats, yaw_rates: Floats, lanes: int, dt: float) -> None:
    """Store the result of the first part of a split step; `yaw_rates` are those at its two Gauss points and its end."""
    for i in range(lanes):
        own[HALF + i] = own[SHARE + i]
        own[MIDDLE_LEFT + i], own[MIDDLE_RIGHT + i] = here[ANGLE_LEFT + i], here[ANGLE_RIGHT + i]
        way_left = own[MIDDLE_LEFT + i] - own[BEFORE_LEFT + i]
        way_right = own[MIDDLE_RIGHT + i] - own[BEFORE_RIGHT + i]
        own[BOW_BEFORE_LEFT + i] = own[SHARE + i] * dt * here[PSI_LEFT + i] - way_left
        own[BOW_BEFORE_RIGHT + i] = own[SHARE + i] * dt * here[PSI_RIGHT + i] - way_right
        turned = 0.5 * (yaw_rates[i] + yaw_rates[LANES + i])
        newest[SPLIT_AT + i], newest[MEAN_BEFORE + i] = own[SHARE + i], turned
        grown = STEEP * (yaw_rates[LANES + i] - yaw_rates[i])
        newest[GROWTH_BEFORE + i] = grown
        newest[CURVE_BEFORE + i] = 6.0 * (yaw_rates[2 * LANES + i] - turned) - 3.0 * grown


@inlined
def end_step(own: Floats, here: Floats, yaw_rates: Floats, lanes: int, dt: float) -> None:
    """Store the bows of both wheels over a step, or its last part, and the course of the yaw rate."""
    for i in range(lanes):
        length = (1.0 - own[HALF + i]) * dt
        way_left = here[ANGLE_LEFT + i] - own[MIDDLE_LEFT + i]
        way_right = here[ANGLE_RIGHT + i] - own[MIDDLE_RIGHT + i]
        own[BOW_LEFT + i] = length * here[PSI_LEFT + i] - way_left
        own[BOW_RIGHT + i] = length * here[PSI_RIGHT + i] - way_right
    for i in range(lanes):
        own[TURNING + i] = 0.5 * (yaw_rates[i] + yaw_rates[LANES + i])
        own[GROWING + i] = STEEP * (yaw_rates[LANES + i] - yaw_rates[i])
        own[CURVING + i] = 6.0 * (yaw_rates[2 * LANES + i] - own[TURNING + i]) - 3.0 * own[GROWING + i]


@inlined
def end_given_step(own: Floats, before: Floats, then: Floats, lanes: int) -> None:
    """Store the course of the yaw rate for given speeds (2,), means over this step and the next.

    At a border the wheels have the mean of the speeds of both steps.
    """
    for i in range(lanes):
        faster_left = own[SCALE_LEFT + i] * (then[0] - before[0])
        faster_right = own[SCALE_RIGHT + i] * (then[1] - before[1])
        faster = own[RADIUS_RIGHT + i] * faster_right - own[RADIUS_LEFT + i] * faster_left
        own[GROWING + i], own[CURVING + i] = faster / own[BASE_WIDTH + i], 0.0


@inlined
def keep_step(newest: Floats, own: Floats, here: Floats, lanes: int) -> None:
    """Add a step to the history, without corrections, so that the past is smooth."""
    for i in range(lanes):
        newest[PAST_X + i] = here[X + i] - own[OFFSET_X + i]
        newest[PAST_Y + i] = here[Y + i] - own[OFFSET_Y + i]
        newest[PAST_THETA + i] = here[THETA + i] - own[OFFSET_THETA + i]
        # Corrections decay like a wheel's speed.
        own[OFFSET_LEFT + i] *= here[KEPT_END + i]
        own[OFFSET_RIGHT + i] *= here[KEPT_END + i]
        width = own[BASE_WIDTH + i]
        radius_left, radius_right = own[RADIUS_LEFT + i], own[RADIUS_RIGHT + i]
        offset = (radius_right * own[OFFSET_RIGHT + i] - radius_left * own[OFFSET_LEFT + i]) / width
        offset *= 1.0 + own[SLIP_TIME + i] * own[K1 + i] * own[K2_OVER_K3 + i]
        own[OFFSET_YAW_RATE + i] = offset
        newest[MEAN_BEFORE + i] -= offset
        newest[MEAN + i] = own[TURNING + i] - offset
        newest[GROWTH + i], newest[CURVE + i] = own[GROWING + i], own[CURVING + i]

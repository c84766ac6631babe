"""History of steps and candidate data of the compiled observer, and their access; compiled into its loops.

The history is `past`, shape (history, KEPT_OF_STEPS, LANES): the pose at the end of each step, and the course of the
yaw rate within it. Other data of a candidate are rows of one array, `own`, of LANES each, like the model's rows in
`here`: only then does the compiler know that they do not overlap, and vectorises.
"""

import numpy as np
from numpy.typing import NDArray

from cmr.model.compiled import inlined
from cmr.model.elementary import cos, sin
from cmr.model.extended.compose import ANGLE_LEFT, ANGLE_RIGHT, KEPT_END, LANES, PSI_LEFT, PSI_RIGHT, THETA, X, Y
from cmr.model.filtering import FILTER_AGES, FILTER_WEIGHTS
from cmr.model.parameters import DEFINITIONS as PAPER

Floats = NDArray[np.float64]

EARLY = 1e-3  # of a step: smaller differences between times do not count
# Stored for each step after the pose: the share of its split, the mean yaw rate before it and its growth there, then
# the same after it, then the curvatures before and after: parabolas.
SPLIT_AT, MEAN_BEFORE, GROWTH_BEFORE, MEAN, GROWTH, CURVE_BEFORE, CURVE, KEPT_OF_STEPS = 3, 4, 5, 6, 7, 8, 9, 10
TWELFTH = 1.0 / 12.0
# Ratio of the growth of a line between the ends of a step to that between its two Gauss points.
STEEP = 1.7320508075688772

# Changing rows: the first six are the accumulated corrections of pose and wheels.
OFFSET_X, OFFSET_Y, OFFSET_THETA, OFFSET_LEFT, OFFSET_RIGHT, OFFSET_YAW_RATE = range(0, 6 * LANES, LANES)
BEFORE_LEFT, BEFORE_RIGHT, HALF, MIDDLE_LEFT, MIDDLE_RIGHT = range(6 * LANES, 11 * LANES, LANES)
ERROR_LEFT, ERROR_RIGHT = range(11 * LANES, 13 * LANES, LANES)
BOW_BEFORE_LEFT, BOW_BEFORE_RIGHT, BOW_LEFT, BOW_RIGHT = range(13 * LANES, 17 * LANES, LANES)
AT_TIME, AT_X, AT_Y, AT_THETA, ERROR_X, ERROR_Y, ERROR_THETA = range(17 * LANES, 24 * LANES, LANES)
GYRO_AT, GYRO_READING = range(24 * LANES, 26 * LANES, LANES)
# Given rows: gains, wheel radians per encoder radian, radii [m], and the time of slip [s]; then the parameters of
# sensors.
GAIN_ANGLE, GAIN_PSI, GAIN_POSITION, GAIN_THETA = range(26 * LANES, 30 * LANES, LANES)
SCALE_LEFT, SCALE_RIGHT, RADIUS_LEFT, RADIUS_RIGHT, SLIP_TIME = range(30 * LANES, 35 * LANES, LANES)
SENSORS = 35 * LANES  # the paper's parameters, and those of effects of sensors
K2_OVER_K3, K1, BASE_WIDTH = (SENSORS + LANES * [*PAPER].index(name) for name in ("k2_over_k3", "k1", "base_width"))


@inlined
def place(step: int, mask: int) -> np.uint64:
    """Return the index of a step in the history: unsigned, so that no access checks for negative values."""
    return np.uint64(step & mask)


@inlined
def beside_line(step: Floats, lane: int, share: float, dt: float) -> float:
    """Return the deviation of the heading at a share of a step from the line between its ends [rad]."""
    if not 0.0 < share < 1.0:
        return 0.0
    split = step[SPLIT_AT, lane]
    if share < split:
        along, part, growth = share / split, split, step[GROWTH_BEFORE, lane]
        beside = along
    else:
        along, part, growth = (share - split) / (1.0 - split), 1.0 - split, step[GROWTH, lane]
        beside = 1.0 - along
    beside *= split * (1.0 - split) * (step[MEAN_BEFORE, lane] - step[MEAN, lane]) if split > 0.0 else 0.0
    return float(dt * (beside - 0.5 * part * growth * along * (1.0 - along)))


@inlined
def yaw_rate_within(step: Floats, lane: int, share: float) -> float:
    """Return the yaw rate at a share of a step, without corrections [rad/s]."""
    split = step[SPLIT_AT, lane]
    if split > 0.0 and share <= split + EARLY:
        off = share / split - 0.5
        rate = step[MEAN_BEFORE, lane] + off * step[GROWTH_BEFORE, lane]
        return float(rate + (off * off - TWELFTH) * step[CURVE_BEFORE, lane])
    off = (share - split) / (1.0 - split) - 0.5
    return float(step[MEAN, lane] + off * step[GROWTH, lane] + (off * off - TWELFTH) * step[CURVE, lane])


@inlined
def angle_within(
    share: float, half: float, begin: float, middle: float, end: float, bows: tuple[float, float]
) -> float:
    """Return a wheel's angle at a share of a step split at `half` [rad]; `bows` are those of both parts.

    Within a step, or each part of it, the speed is linear and the angle a parabola.
    """
    early = share < half
    along = share / half if early else (share - half) / (1.0 - half)
    first, last = begin if early else middle, middle if early else end
    return first + along * (last - first) - (bows[0] if early else bows[1]) * along * (1.0 - along)


@inlined
def begin_past(past: Floats, own: Floats, here: Floats, dt: float) -> None:
    """Initialise the history with motion at the initial speeds: the first poses of a late sensor show it."""
    history = len(past)
    for i in range(LANES):
        left, right = own[RADIUS_LEFT + i] * here[PSI_LEFT + i], own[RADIUS_RIGHT + i] * here[PSI_RIGHT + i]
        for h in range(history):
            ago = ((history - h) & (history - 1)) * dt
            turned = ago * (right - left) / own[BASE_WIDTH + i]
            rolled, along = 0.5 * ago * (left + right), here[THETA + i] - 0.5 * turned
            past[h, 0, i], past[h, 1, i] = here[X + i] - rolled * cos(along), here[Y + i] - rolled * sin(along)
            past[h, 2, i] = here[THETA + i] - turned
            for row in range(SPLIT_AT, KEPT_OF_STEPS):
                past[h, row, i] = 0.0


@inlined
def begin_step(own: Floats, here: Floats, lanes: int) -> None:
    """Store the wheel angles at the beginning of a step."""
    for i in range(lanes):
        own[BEFORE_LEFT + i], own[BEFORE_RIGHT + i] = here[ANGLE_LEFT + i], here[ANGLE_RIGHT + i]


@inlined
def not_split(newest: Floats, own: Floats) -> None:
    """Mark a step as not split."""
    for i in range(LANES):
        newest[SPLIT_AT, i] = 0.0
        own[HALF + i] = 0.0
        own[MIDDLE_LEFT + i], own[MIDDLE_RIGHT + i] = own[BEFORE_LEFT + i], own[BEFORE_RIGHT + i]


@inlined
def end_first_part(
    newest: Floats, own: Floats, here: Floats, yaw_rates: Floats, shares: Floats, turning: Floats, dt: float
) -> None:
    """Store the result of the first part of a split step; `yaw_rates` are those at its two Gauss points and its end."""
    for i in range(LANES):
        own[HALF + i] = shares[i]
        own[MIDDLE_LEFT + i], own[MIDDLE_RIGHT + i] = here[ANGLE_LEFT + i], here[ANGLE_RIGHT + i]
        way_left = own[MIDDLE_LEFT + i] - own[BEFORE_LEFT + i]
        way_right = own[MIDDLE_RIGHT + i] - own[BEFORE_RIGHT + i]
        own[BOW_BEFORE_LEFT + i] = shares[i] * dt * here[PSI_LEFT + i] - way_left
        own[BOW_BEFORE_RIGHT + i] = shares[i] * dt * here[PSI_RIGHT + i] - way_right
        turning[i] = 0.5 * (yaw_rates[i] + yaw_rates[LANES + i])
        newest[SPLIT_AT, i], newest[MEAN_BEFORE, i] = shares[i], turning[i]
        grown = STEEP * (yaw_rates[LANES + i] - yaw_rates[i])
        newest[GROWTH_BEFORE, i] = grown
        newest[CURVE_BEFORE, i] = 6.0 * (yaw_rates[2 * LANES + i] - turning[i]) - 3.0 * grown


@inlined
def end_step(
    own: Floats, here: Floats, yaw_rates: Floats, turning: Floats, growing: Floats, curving: Floats, dt: float
) -> None:
    """Store the bows of both wheels over a step, or its last part, and the course of the yaw rate."""
    for i in range(LANES):
        length = (1.0 - own[HALF + i]) * dt
        way_left = here[ANGLE_LEFT + i] - own[MIDDLE_LEFT + i]
        way_right = here[ANGLE_RIGHT + i] - own[MIDDLE_RIGHT + i]
        own[BOW_LEFT + i] = length * here[PSI_LEFT + i] - way_left
        own[BOW_RIGHT + i] = length * here[PSI_RIGHT + i] - way_right
    for i in range(LANES):
        turning[i] = 0.5 * (yaw_rates[i] + yaw_rates[LANES + i])
        growing[i] = STEEP * (yaw_rates[LANES + i] - yaw_rates[i])
        curving[i] = 6.0 * (yaw_rates[2 * LANES + i] - turning[i]) - 3.0 * growing[i]


@inlined
def end_given_step(own: Floats, before: Floats, then: Floats, growing: Floats, curving: Floats) -> None:
    """Store the course of the yaw rate for given speeds (2,), means over this step and the next.

    At a border the wheels have the mean of the speeds of both steps.
    """
    for i in range(LANES):
        faster_left = own[SCALE_LEFT + i] * (then[0] - before[0])
        faster_right = own[SCALE_RIGHT + i] * (then[1] - before[1])
        growing[i] = own[RADIUS_RIGHT + i] * faster_right - own[RADIUS_LEFT + i] * faster_left
        growing[i] /= own[BASE_WIDTH + i]
        curving[i] = 0.0


@inlined
def keep_step(
    newest: Floats, own: Floats, here: Floats, turning: Floats, growing: Floats, curving: Floats, lanes: int
) -> None:
    """Add a step to the history, without corrections, so that the past is smooth."""
    for i in range(lanes):
        newest[0, i] = here[X + i] - own[OFFSET_X + i]
        newest[1, i] = here[Y + i] - own[OFFSET_Y + i]
        newest[2, i] = here[THETA + i] - own[OFFSET_THETA + i]
        # Corrections decay like a wheel's speed.
        own[OFFSET_LEFT + i] *= here[KEPT_END + i]
        own[OFFSET_RIGHT + i] *= here[KEPT_END + i]
        width = own[BASE_WIDTH + i]
        radius_left, radius_right = own[RADIUS_LEFT + i], own[RADIUS_RIGHT + i]
        offset = (radius_right * own[OFFSET_RIGHT + i] - radius_left * own[OFFSET_LEFT + i]) / width
        offset *= 1.0 + own[SLIP_TIME + i] * own[K1 + i] * own[K2_OVER_K3 + i]
        own[OFFSET_YAW_RATE + i] = offset
        newest[MEAN_BEFORE, i] -= offset
        newest[MEAN, i] = turning[i] - offset
        newest[GROWTH, i], newest[CURVE, i] = growing[i], curving[i]


@inlined
def read_gyro(past: Floats, own: Floats, lanes: int, earliest: float, latest: float, border: int) -> None:
    """Write the yaw rates at each lane's position, between `earliest` and `latest`, as measured by an ideal gyro.

    Nearly always all lanes use the same step, which takes a few instructions together.
    """
    mask = len(past) - 1
    step = min(max(int(np.ceil(latest - EARLY)), 1), border)
    if earliest - EARLY > step - 1.0 or step == 1:
        one = past[place(step, mask)]
        for i in range(lanes):
            reading = yaw_rate_within(one, i, own[GYRO_AT + i] - step + 1.0)
            own[GYRO_READING + i] = reading + own[OFFSET_YAW_RATE + i]
    else:
        for i in range(lanes):
            step = min(max(int(np.ceil(own[GYRO_AT + i] - EARLY)), 1), border)
            one = past[place(step, mask)]
            reading = yaw_rate_within(one, i, own[GYRO_AT + i] - step + 1.0)
            own[GYRO_READING + i] = reading + own[OFFSET_YAW_RATE + i]


@inlined
def read_pose(
    past: Floats, own: Floats, i: int, moment: float, filtered: float, border: int, began: float, dt: float
) -> None:
    """Write the pose of lane i at a sensor's time [s], or its mean over `filtered` [s] before.

    A future time is extrapolated from the last two borders.
    """
    history, now = len(past), border * dt
    mask = history - 1
    own[AT_X + i], own[AT_Y + i] = own[OFFSET_X + i], own[OFFSET_Y + i]
    own[AT_THETA + i], own[AT_TIME + i] = own[OFFSET_THETA + i], moment - filtered - began
    for number in range(len(FILTER_AGES) if filtered > 0.0 else 1):
        part = FILTER_WEIGHTS[number] if filtered > 0.0 else 1.0
        at = moment - FILTER_AGES[number] * filtered if filtered > 0.0 else moment
        position = max(border + (at - began - now) / dt, border - (history - 2.0))
        first = min(int(np.floor(position)), border - 1)
        share = position - first
        one, other = past[place(first, mask)], past[place(first + 1, mask)]
        own[AT_X + i] += part * (one[0, i] + share * (other[0, i] - one[0, i]))
        own[AT_Y + i] += part * (one[1, i] + share * (other[1, i] - one[1, i]))
        turned = one[2, i] + share * (other[2, i] - one[2, i]) + beside_line(other, i, share, dt)
        own[AT_THETA + i] += part * turned

"""Readings of ideal sensors, from the history of steps; compiled into the observer's loops."""

from math import inf

import numpy as np

from cmr.model.compiled import inlined
from cmr.model.elementary import cos, sin
from cmr.model.extended.compose import ANGLE_LEFT, ANGLE_RIGHT
from cmr.model.filtering import FILTER_AGES, FILTER_WEIGHTS
from cmr.model.observer.helpers import (
    AT_THETA,
    AT_TIME,
    AT_X,
    AT_Y,
    BEFORE_LEFT,
    BEFORE_RIGHT,
    BOW_BEFORE_LEFT,
    BOW_BEFORE_RIGHT,
    BOW_LEFT,
    BOW_RIGHT,
    CURVE,
    CURVE_BEFORE,
    EARLY,
    FILTERED,
    GROWTH,
    GROWTH_BEFORE,
    GYRO_AT,
    GYRO_READING,
    GYRO_SPEED,
    GYRO_THETA,
    GYRO_X,
    GYRO_Y,
    HALF,
    MEAN,
    MEAN_BEFORE,
    MIDDLE_LEFT,
    MIDDLE_RIGHT,
    OFFSET_THETA,
    OFFSET_X,
    OFFSET_Y,
    OFFSET_YAW_RATE,
    PAST_THETA,
    PAST_X,
    PAST_Y,
    POSE_SPEED,
    POSE_YAW_RATE,
    READING_LEFT,
    READING_RIGHT,
    SPLIT_AT,
    TWELFTH,
    Floats,
    border_of,
)


@inlined
def beside_line(step: Floats, lane: int, share: float, dt: float) -> float:
    """Return the deviation of the heading at a share of a step from the line between its ends [rad]."""
    if not 0.0 < share < 1.0:
        return 0.0
    split = step[SPLIT_AT + lane]
    if share < split:
        along, part, growth = share / split, split, step[GROWTH_BEFORE + lane]
        beside = along
    else:
        along, part, growth = (share - split) / (1.0 - split), 1.0 - split, step[GROWTH + lane]
        beside = 1.0 - along
    beside *= split * (1.0 - split) * (step[MEAN_BEFORE + lane] - step[MEAN + lane]) if split > 0.0 else 0.0
    return float(dt * (beside - 0.5 * part * growth * along * (1.0 - along)))


@inlined
def yaw_rate_within(step: Floats, lane: int, share: float) -> float:
    """Return the yaw rate at a share of a step, without corrections [rad/s]."""
    split = step[SPLIT_AT + lane]
    if split > 0.0 and share <= split + EARLY:
        off = share / split - 0.5
        rate = step[MEAN_BEFORE + lane] + off * step[GROWTH_BEFORE + lane]
        return float(rate + (off * off - TWELFTH) * step[CURVE_BEFORE + lane])
    off = (share - split) / (1.0 - split) - 0.5
    return float(step[MEAN + lane] + off * step[GROWTH + lane] + (off * off - TWELFTH) * step[CURVE + lane])


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
def read_encoders(own: Floats, here: Floats, lanes: int, share: float, start_left: float, start_right: float) -> None:
    """Write the angles of the wheels at a share of a step [rad]; readings count from the beginning of the drive."""
    for i in range(lanes):
        half, bows = own[HALF + i], (own[BOW_BEFORE_LEFT + i], own[BOW_LEFT + i])
        begin, middle, end = own[BEFORE_LEFT + i], own[MIDDLE_LEFT + i], here[ANGLE_LEFT + i]
        own[READING_LEFT + i] = angle_within(share, half, begin, middle, end, bows) - start_left
        bows = own[BOW_BEFORE_RIGHT + i], own[BOW_RIGHT + i]
        begin, middle, end = own[BEFORE_RIGHT + i], own[MIDDLE_RIGHT + i], here[ANGLE_RIGHT + i]
        own[READING_RIGHT + i] = angle_within(share, half, begin, middle, end, bows) - start_right


@inlined
def read_gyro(past: Floats, own: Floats, lanes: int, border: int, began: float, dt: float) -> None:
    """Write the yaw rates at the moments of each lane, as measured by an ideal gyro, and their positions [steps].

    Nearly always all lanes use the same step, which takes a few instructions together.
    """
    earliest, latest = inf, -inf
    for i in range(lanes):
        position = border + (own[GYRO_AT + i] - began - border * dt) / dt
        position = min(max(position, border - (len(past) - 2.0), 0.0), border + EARLY)
        own[GYRO_AT + i] = position
        earliest, latest = min(earliest, position), max(latest, position)
    step = min(max(int(np.ceil(latest - EARLY)), 1), border)
    if earliest - EARLY > step - 1.0 or step == 1:
        one = border_of(past, step)
        for i in range(lanes):
            reading = yaw_rate_within(one, i, own[GYRO_AT + i] - step + 1.0)
            own[GYRO_READING + i] = reading + own[OFFSET_YAW_RATE + i]
    else:
        for i in range(lanes):
            step = min(max(int(np.ceil(own[GYRO_AT + i] - EARLY)), 1), border)
            one = border_of(past, step)
            reading = yaw_rate_within(one, i, own[GYRO_AT + i] - step + 1.0)
            own[GYRO_READING + i] = reading + own[OFFSET_YAW_RATE + i]


@inlined
def read_pose(past: Floats, own: Floats, i: int, border: int, began: float, dt: float) -> None:
    """Write the pose of lane i at a sensor's time [s], or its mean over the time of its filter before.

    A future time is extrapolated from the last two borders.
    """
    history, now = len(past), border * dt
    moment, filtered = own[AT_TIME + i], own[FILTERED + i]
    own[AT_X + i], own[AT_Y + i] = own[OFFSET_X + i], own[OFFSET_Y + i]
    own[AT_THETA + i], own[AT_TIME + i] = own[OFFSET_THETA + i], moment - filtered - began
    for number in range(len(FILTER_AGES) if filtered > 0.0 else 1):
        part = FILTER_WEIGHTS[number] if filtered > 0.0 else 1.0
        at = moment - FILTER_AGES[number] * filtered if filtered > 0.0 else moment
        position = max(border + (at - began - now) / dt, border - (history - 2.0))
        first = min(int(np.floor(position)), border - 1)
        share = position - first
        one, other = border_of(past, first), border_of(past, first + 1)
        own[AT_X + i] += part * (one[PAST_X + i] + share * (other[PAST_X + i] - one[PAST_X + i]))
        own[AT_Y + i] += part * (one[PAST_Y + i] + share * (other[PAST_Y + i] - one[PAST_Y + i]))
        turned = (
            one[PAST_THETA + i]
            + share * (other[PAST_THETA + i] - one[PAST_THETA + i])
            + beside_line(other, i, share, dt)
        )
        own[AT_THETA + i] += part * turned


@inlined
def steps_around(past: Floats, position: float, border: int) -> tuple[Floats, Floats]:
    """Return the borders before and after a position [steps]."""
    history = len(past)
    first = min(max(int(np.floor(position)), border - (history - 2)), border - 1)
    return border_of(past, first), border_of(past, first + 1)


@inlined
def speed_between(one: Floats, other: Floats, i: int, dt: float) -> float:
    """Return the mean forward speed of lane i between two borders [m/s]."""
    theta = 0.5 * (one[PAST_THETA + i] + other[PAST_THETA + i])
    return float(
        ((other[PAST_X + i] - one[PAST_X + i]) * cos(theta) + (other[PAST_Y + i] - one[PAST_Y + i]) * sin(theta)) / dt
    )


@inlined
def move_gyro(past: Floats, own: Floats, lanes: int, border: int, dt: float) -> None:
    """Write the speed and the pose at the time of a gyro reading: means over its step."""
    for i in range(lanes):
        one, other = steps_around(past, own[GYRO_AT + i], border)
        own[GYRO_SPEED + i] = speed_between(one, other, i, dt)
        own[GYRO_X + i] = 0.5 * (one[PAST_X + i] + other[PAST_X + i]) + own[OFFSET_X + i]
        own[GYRO_Y + i] = 0.5 * (one[PAST_Y + i] + other[PAST_Y + i]) + own[OFFSET_Y + i]
        own[GYRO_THETA + i] = 0.5 * (one[PAST_THETA + i] + other[PAST_THETA + i]) + own[OFFSET_THETA + i]


@inlined
def move_pose(past: Floats, own: Floats, lanes: int, border: int, dt: float) -> None:
    """Write the speed and the yaw rate at the time of a pose: means over its step."""
    for i in range(lanes):
        one, other = steps_around(past, border + (own[AT_TIME + i] - border * dt) / dt, border)
        own[POSE_SPEED + i] = speed_between(one, other, i, dt)
        own[POSE_YAW_RATE + i] = (other[PAST_THETA + i] - one[PAST_THETA + i]) / dt

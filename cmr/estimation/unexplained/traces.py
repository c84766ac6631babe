"""Traces of small disturbances in the prediction errors.

The observer's response to a small disturbance is linear: a first-order motor, wheels that move the body, and
proportional corrections. So hundreds of disturbances are computed at once, and none of them needs to be an effect of
the model.
"""

from collections.abc import Mapping, Sequence
from copy import copy
from dataclasses import dataclass
from math import cos, exp, sin

import numpy as np

from cmr.estimation.prediction import POSE_SIGNALS, SIGNALS, Errors, Predictor
from cmr.model.catalogue import CATALOGUE
from cmr.model.compiled import compiled, inlined
from cmr.model.extended.statements import changed_with
from cmr.model.observer.observer import MOTION, Gains
from cmr.recordings.signal import Floats

# What can be disturbed: the wheels' accelerations [rad/s^2]; the yaw rate [rad/s] and the forward and sideways speed
# [m/s] of the body; the speed that an encoder reports [rad/s]; the readings of the gyro [rad/s], of the pose's heading
# [rad] and position in the world [m], and as the robot stands, ahead of it and to its left [m]; how late poses are [s].
DISTURBED = (
    "left",
    "right",
    "yaw_rate",
    "forward",
    "sideways",
    "left_encoder",
    "right_encoder",
    "gyro",
    "heading",
    "east",
    "north",
    "ahead",
    "beside",
    "lateness",
)
(
    LEFT, RIGHT, YAW_RATE, FORWARD, SIDEWAYS, LEFT_ENCODER, RIGHT_ENCODER, GYRO, HEADING, EAST, NORTH, AHEAD, BESIDE,
    LATENESS,
) = range(len(DISTURBED))  # fmt: skip
# The entries of `numbers` in `follow_traces`.
DT, SLOWING, RADIUS, WIDTH, HOLDS, ROLLING, GAIN_ANGLE, GAIN_PSI, GAIN_POSITION, GAIN_THETA = range(10)
PSI, ANGLE, ANGLE_BEFORE, ROLLED = range(4)  # a disturbance's contribution to one side's wheels, now and a step before
X, Y, TURNED, TURNING, TURNING_BEFORE = range(5)  # and to the body
ALL = SIGNALS
BODY = ("yaw_rate", *POSE_SIGNALS)
# The signals in which each leaves traces. Gyro errors also predict pose errors.
SEEN_IN: Mapping[str, tuple[str, ...]] = {
    "left": ALL,
    "right": ALL,
    "left_encoder": ALL,
    "right_encoder": ALL,
    "yaw_rate": BODY,
    "gyro": BODY,
    "heading": POSE_SIGNALS,
    "lateness": POSE_SIGNALS,
    **dict.fromkeys(("forward", "sideways", "east", "north", "ahead", "beside"), ("forward", "sideways")),
}
PSI_LEFT, PSI_RIGHT, THETA = (MOTION.index(name) for name in ("psi_left", "psi_right", "theta"))
OF_WHEELS = [LEFT, RIGHT, LEFT_ENCODER, RIGHT_ENCODER]
HOLDING = tuple(  # friction that a wheel must overcome to start
    parameter.name
    for effect in CATALOGUE.values()
    for parameter in effect.parameters
    if parameter.name in changed_with(effect, "acceleration", "break_away")
)
EARLY = 1e-3  # of a step, by which a gyro reading may appear to be early; as in the observer


@dataclass(frozen=True)
class Disturbances:
    """Disturbances: their time courses, `courses` (T, C), and their weights on DISTURBED, (14, C)."""

    courses: Floats
    shares: Floats


def only(predictor: Predictor, signals: Sequence[str]) -> Predictor:
    """Return the predictor of some of the signals."""
    part = copy(predictor)
    part.__dict__["times"] = {name: times for name, times in predictor.times.items() if name in signals}
    return part


def traces(
    predictor: Predictor, motion: Floats, values: Mapping[str, float], gains: Gains, disturbances: Disturbances
) -> Errors:
    """Return the traces of disturbances in a robot's prediction errors, (n, C) by signal.

    `predictor` may be restricted to some signals (`only`); `motion` is the robot's motion without disturbances.
    """
    observations = predictor.segment.observations
    count = disturbances.courses.shape[1]
    use = observations.wheel_use if "psi_left" in predictor.times else observations.wheel_use[:0]
    readings = len(observations.gyro_time) if "yaw_rate" in predictor.times else 0
    rows = [int(np.count_nonzero(use[:, 0])), int(np.count_nonzero(use[:, 1])), readings]
    result = [np.zeros((n, count)) for n in (*rows, *[len(observations.pose_time)] * 3)]
    follow_traces(
        np.ascontiguousarray(disturbances.courses), np.ascontiguousarray(disturbances.shares), motion,
        numbers_of(predictor, values, gains, rolling=bool(np.any(disturbances.shares[OF_WHEELS]))),
        observations.wheel_time[: len(use)], np.ascontiguousarray(use), observations.gyro_time[:readings],
        observations.pose_time, np.ascontiguousarray(observations.pose[:, 2]), observations.pose_use, *result,
    )  # fmt: skip
    of = dict(zip(SIGNALS, result, strict=True))
    return predictor.told_once(Errors({name: of[name] for name in predictor.times}, motion), gains)


def numbers_of(predictor: Predictor, values: Mapping[str, float], gains: Gains, *, rolling: bool = True) -> Floats:
    """Return the numbers for the recursion; `rolling` says whether any wheel is disturbed."""
    slowing = max(values["k1"] * values["k2_over_k3"], 1e-9)
    holds = float(any(values.get(name, 0.0) > 0.0 for name in HOLDING))
    robot = slowing, values["wheel_radius"], values["base_width"]
    return np.array([predictor.segment.observations.dt, *robot, holds, float(rolling), *gains])


@inlined
def response_of(dt: float, slowing: float) -> tuple[float, float, float]:
    """Return the decay of a wheel's speed per step, and the angles per step due to speed and to acceleration."""
    kept = exp(-slowing * dt)
    coasted = (1.0 - kept) / slowing
    return kept, coasted, (dt - coasted) / slowing


@inlined
def may_roll(psi: float, psi_at_end: float, holds: float) -> float:
    """Return 0.0 for a wheel held at rest by dry friction, otherwise 1.0."""
    return 0.0 if holds > 0.0 and psi == 0.0 and psi_at_end == 0.0 else 1.0


@inlined
def roll_on(side, course, pushed, miscounted, free, dt, response):  # type: ignore[no-untyped-def]
    """Advance one side's wheels by a step, with these weights of acceleration and encoder disturbances."""
    kept, coasted, driven = response
    for i in range(len(course)):
        push = pushed[i] * course[i] * free
        side[ANGLE_BEFORE, i] = side[ANGLE, i]
        side[ROLLED, i] = free * coasted * side[PSI, i] + driven * push
        side[PSI, i] = free * kept * side[PSI, i] + coasted * push
        # A miscount is equivalent to another wheel angle, which the body does not follow.
        side[ANGLE, i] += side[ROLLED, i] + miscounted[i] * course[i] * dt


@inlined
def follow_wheels(body, left, right, course, shares, then, at_end, numbers):  # type: ignore[no-untyped-def]
    """Advance the body by a step of its wheels; without disturbances it moves from `then` to `at_end`."""
    dt, radius, width = numbers[DT], numbers[RADIUS], numbers[WIDTH]
    theta = 0.5 * (then[THETA] + at_end[THETA])
    cosine, sine = cos(theta), sin(theta)
    ahead = 0.5 * radius * dt * (at_end[PSI_LEFT] + at_end[PSI_RIGHT])
    for i in range(len(course)):
        turn = (right[ROLLED, i] - left[ROLLED, i]) * radius / width + shares[YAW_RATE, i] * course[i] * dt
        body[TURNING_BEFORE, i] = body[TURNING, i]
        body[TURNING, i] = turn / dt
        on = 0.5 * radius * (left[ROLLED, i] + right[ROLLED, i]) + shares[FORWARD, i] * course[i] * dt
        aside = shares[SIDEWAYS, i] * course[i] * dt + ahead * (body[TURNED, i] + 0.5 * turn)
        body[X, i] += on * cosine - aside * sine
        body[Y, i] += on * sine + aside * cosine
        body[TURNED, i] += turn


@inlined
def read_gyro(gyro_error, body, course, misread, share):  # type: ignore[no-untyped-def]
    """Read the gyro at this fraction of the step."""
    for i in range(len(course)):
        error = body[TURNING, i] + (share - 0.5) * (body[TURNING, i] - body[TURNING_BEFORE, i])
        gyro_error[i] = error + misread[i] * course[i]


@inlined
def read_encoder(wheel_error, side, body, share, theta, turn_per_angle, numbers):  # type: ignore[no-untyped-def]
    """Read one side's encoder at this fraction of the step; correct the side and the body."""
    gain_angle, gain_psi, cosine, sine = numbers[GAIN_ANGLE], numbers[GAIN_PSI], cos(theta), sin(theta)
    on_per_angle = 0.5 * numbers[RADIUS]
    for i in range(len(wheel_error)):
        error = side[ANGLE_BEFORE, i] + share * (side[ANGLE, i] - side[ANGLE_BEFORE, i])
        wheel_error[i] = error
        side[ANGLE, i] -= gain_angle * error
        side[ANGLE_BEFORE, i] -= gain_angle * error
        side[PSI, i] -= gain_psi * error
        rolled = gain_angle * error
        body[X, i] -= on_per_angle * rolled * cosine
        body[Y, i] -= on_per_angle * rolled * sine
        body[TURNED, i] -= turn_per_angle * rolled


@inlined
def read_pose(  # type: ignore[no-untyped-def]
    forward_error, sideways_error, heading_error, body, course, shares, heading, now, restart, numbers
):
    """Read the pose, which has this heading, and correct the body by it; fully at a restart of the path.

    The robot moves as the row `now` of its motion says: a late pose shows an earlier place.
    """
    speed = 0.5 * numbers[RADIUS] * (now[PSI_LEFT] + now[PSI_RIGHT])
    turning = numbers[RADIUS] / numbers[WIDTH] * (now[PSI_RIGHT] - now[PSI_LEFT])
    followed = 1.0 if restart else numbers[GAIN_POSITION]
    followed_theta = 1.0 if restart else numbers[GAIN_THETA]
    cosine, sine = cos(heading), sin(heading)
    for i in range(len(course)):
        late = shares[LATENESS, i] * course[i]
        ahead, beside = shares[AHEAD, i] * course[i] - speed * late, shares[BESIDE, i] * course[i]
        error_theta = body[TURNED, i] + shares[HEADING, i] * course[i] - turning * late
        error_x = body[X, i] + shares[EAST, i] * course[i] + cosine * ahead - sine * beside
        error_y = body[Y, i] + shares[NORTH, i] * course[i] + sine * ahead + cosine * beside
        if not restart:
            forward_error[i] = cosine * error_x + sine * error_y
            sideways_error[i] = cosine * error_y - sine * error_x
            heading_error[i] = error_theta
        body[X, i] -= followed * error_x
        body[Y, i] -= followed * error_y
        body[TURNED, i] -= followed_theta * error_theta


@inlined
def roll_wheels(left, right, course, shares, then, at_end, response, numbers):  # type: ignore[no-untyped-def]
    """Advance both wheels by a step whose motion begins with the row `then` and ends with the row `at_end`."""
    free = may_roll(then[PSI_LEFT], at_end[PSI_LEFT], numbers[HOLDS])
    roll_on(left, course, shares[LEFT], shares[LEFT_ENCODER], free, numbers[DT], response)
    free = may_roll(then[PSI_RIGHT], at_end[PSI_RIGHT], numbers[HOLDS])
    roll_on(right, course, shares[RIGHT], shares[RIGHT_ENCODER], free, numbers[DT], response)


@compiled(
    "void(f8[:, ::1], f8[:, ::1], f8[:, ::1], f8[::1], f8[::1], u1[:, ::1], f8[::1], f8[::1], f8[::1], u1[::1],"
    "f8[:, ::1], f8[:, ::1], f8[:, ::1], f8[:, ::1], f8[:, ::1], f8[:, ::1])"
)
def follow_traces(  # type: ignore[no-untyped-def]
    courses, shares, motion, numbers, wheel_time, wheel_use, gyro_time, pose_time, pose_theta, pose_use,
    left_error, right_error, gyro_error, forward_error, sideways_error, heading_error,
):  # fmt: skip
    """Run the observer on disturbances, one per lane.

    `numbers` are dt [s], the deceleration rate of wheels [1/s], radius and width [m], whether friction holds a wheel
    that rests, whether any wheel is disturbed at all, and the gains.
    """
    steps, lanes = courses.shape
    dt, response = numbers[DT], response_of(numbers[DT], numbers[SLOWING])
    turning = numbers[RADIUS] / numbers[WIDTH]
    left, right, body = np.zeros((4, lanes)), np.zeros((4, lanes)), np.zeros((5, lanes))
    wheel, gyro, pose, left_reading, right_reading = 0, 0, 0, 0, 0
    for step in range(steps):
        course, then, at_end, now = courses[step], motion[step], motion[step + 1], (step + 1) * dt
        if numbers[ROLLING] > 0.0:
            roll_wheels(left, right, course, shares, then, at_end, response, numbers)
        follow_wheels(body, left, right, course, shares, then, at_end, numbers)
        # The mean over the step is known; within it the yaw rate grows as from the step before.
        while gyro < len(gyro_time) and gyro_time[gyro] <= now + EARLY * dt:
            read_gyro(gyro_error[gyro], body, course, shares[GYRO], 1.0 - (now - gyro_time[gyro]) / dt)
            gyro += 1
        while wheel < len(wheel_time) and wheel_time[wheel] <= now:
            share = min(1.0 - (now - wheel_time[wheel]) / dt, 1.0)
            if wheel_use[wheel, 0] > 0:
                read_encoder(left_error[left_reading], left, body, share, at_end[THETA], -turning, numbers)
                left_reading += 1
            if wheel_use[wheel, 1] > 0:
                read_encoder(right_error[right_reading], right, body, share, at_end[THETA], turning, numbers)
                right_reading += 1
            wheel += 1
        while pose < len(pose_time) and pose_time[pose] <= now:
            read_pose(
                forward_error[pose], sideways_error[pose], heading_error[pose],
                body, course, shares, pose_theta[pose], at_end, pose_use[pose] == 0, numbers,
            )  # fmt: skip
            pose += 1

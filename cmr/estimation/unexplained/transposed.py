"""Products of disturbance traces with given vectors, by the transpose of `traces`.

Traces are linear in the disturbance. Their products with vectors over the errors are therefore products of the time
course with the transposed recursion of these vectors, which is computed once for all courses. Each function below
transposes the function of `traces.py` that it names: statements are in reverse order, and where the original adds a
times b to c, the transpose adds a times c to b.
"""

from collections.abc import Mapping
from math import cos, sin

import numpy as np

from cmr.estimation.prediction import POSE_SIGNALS, SIGNALS, Predictor
from cmr.estimation.unexplained.traces import (
    AHEAD,
    ANGLE,
    ANGLE_BEFORE,
    BESIDE,
    DISTURBED,
    DT,
    EARLY,
    EAST,
    FORWARD,
    GAIN_ANGLE,
    GAIN_POSITION,
    GAIN_PSI,
    GAIN_THETA,
    GYRO,
    HEADING,
    HOLDS,
    LATENESS,
    LEFT,
    LEFT_ENCODER,
    NORTH,
    PSI,
    PSI_LEFT,
    PSI_RIGHT,
    RADIUS,
    RIGHT,
    RIGHT_ENCODER,
    ROLLED,
    SIDEWAYS,
    SLOWING,
    THETA,
    TURNED,
    TURNING,
    TURNING_BEFORE,
    WIDTH,
    YAW_RATE,
    may_roll,
    numbers_of,
    response_of,
)
from cmr.model.compiled import compiled, inlined
from cmr.model.observer.observer import Gains
from cmr.recordings.signal import Floats

X, Y = range(2)


def pulls(
    predictor: Predictor, motion: Floats, values: Mapping[str, float], gains: Gains, vectors: Mapping[str, Floats]
) -> Floats:
    """Return the transposed traces of each of DISTURBED for vectors over a predictor's errors, (T, 14, K).

    `vectors` (n, K) by signal weigh the errors; those of missing signals are 0. The sum over the steps of a course
    times these traces is the product of its own traces and the vectors.
    """
    observations = predictor.segment.observations
    (count,) = {one.shape[1] for one in vectors.values()}
    of = {name: vectors.get(name, np.zeros((len(times), count))).copy() for name, times in predictor.times.items()}
    for name, again in predictor.rests_on.items():
        if name in of:
            of[name][again - 1] -= (1.0 - gains.angle) * of[name][again]
    use = observations.wheel_use if "psi_left" in of else observations.wheel_use[:0]
    readings = len(observations.gyro_time) if "yaw_rate" in of else 0
    poses = len(observations.pose_time) if POSE_SIGNALS[0] in of else 0
    result = np.zeros((observations.steps, len(DISTURBED), count))
    follow_back(
        motion, numbers_of(predictor, values, gains),
        observations.wheel_time[: len(use)], np.ascontiguousarray(use), observations.gyro_time[:readings],
        observations.pose_time[:poses], np.ascontiguousarray(observations.pose[:poses, 2]),
        observations.pose_use[:poses], result,
        *(np.ascontiguousarray(of.get(name, np.zeros((0, count)))) for name in SIGNALS),
    )  # fmt: skip
    return result


@inlined
def back_through_wheels(side, pulled, motor, encoder, free, dt, response):  # type: ignore[no-untyped-def]
    """Transpose `roll_on`."""
    kept, coasted, driven = response
    for i in range(side.shape[1]):
        rolled = side[ROLLED, i] + side[ANGLE, i]
        pulled[encoder, i] += side[ANGLE, i] * dt
        pulled[motor, i] += free * (driven * rolled + coasted * side[PSI, i])
        side[PSI, i] = free * (coasted * rolled + kept * side[PSI, i])
        side[ANGLE, i] += side[ANGLE_BEFORE, i]
        side[ANGLE_BEFORE, i] = 0.0
        side[ROLLED, i] = 0.0


@inlined
def back_through_body(body, left, right, pulled, then, at_end, numbers):  # type: ignore[no-untyped-def]
    """Transpose `follow_wheels`."""
    dt, radius, width = numbers[DT], numbers[RADIUS], numbers[WIDTH]
    theta = 0.5 * (then[THETA] + at_end[THETA])
    cosine, sine = cos(theta), sin(theta)
    ahead = 0.5 * radius * dt * (at_end[PSI_LEFT] + at_end[PSI_RIGHT])
    for i in range(body.shape[1]):
        on = cosine * body[X, i] + sine * body[Y, i]
        aside = cosine * body[Y, i] - sine * body[X, i]
        turn = body[TURNED, i] + body[TURNING, i] / dt + 0.5 * ahead * aside
        body[TURNED, i] += ahead * aside
        body[TURNING, i] = body[TURNING_BEFORE, i]
        body[TURNING_BEFORE, i] = 0.0
        pulled[YAW_RATE, i] += dt * turn
        pulled[FORWARD, i] += dt * on
        pulled[SIDEWAYS, i] += dt * aside
        left[ROLLED, i] += 0.5 * radius * on - radius / width * turn
        right[ROLLED, i] += 0.5 * radius * on + radius / width * turn


@inlined
def back_from_gyro(vector, body, pulled, share):  # type: ignore[no-untyped-def]
    """Transpose `read_gyro`."""
    for i in range(len(vector)):
        body[TURNING, i] += (share + 0.5) * vector[i]
        body[TURNING_BEFORE, i] -= (share - 0.5) * vector[i]
        pulled[GYRO, i] += vector[i]


@inlined
def back_from_encoder(vector, side, body, share, theta, turn_per_angle, numbers):  # type: ignore[no-untyped-def]
    """Transpose `read_encoder`."""
    gain_angle, gain_psi, cosine, sine = numbers[GAIN_ANGLE], numbers[GAIN_PSI], cos(theta), sin(theta)
    on_per_angle = 0.5 * numbers[RADIUS]
    for i in range(len(vector)):
        carried = on_per_angle * (cosine * body[X, i] + sine * body[Y, i]) + turn_per_angle * body[TURNED, i]
        corrected = gain_angle * (side[ANGLE, i] + side[ANGLE_BEFORE, i] + carried) + gain_psi * side[PSI, i]
        error = vector[i] - corrected
        side[ANGLE, i] += share * error
        side[ANGLE_BEFORE, i] += (1.0 - share) * error


@inlined
def back_from_pose(forward, sideways, heading, body, pulled, theta, now, restart, numbers):  # type: ignore[no-untyped-def]
    """Transpose `read_pose`."""
    speed = 0.5 * numbers[RADIUS] * (now[PSI_LEFT] + now[PSI_RIGHT])
    turning = numbers[RADIUS] / numbers[WIDTH] * (now[PSI_RIGHT] - now[PSI_LEFT])
    followed = 1.0 if restart else numbers[GAIN_POSITION]
    followed_theta = 1.0 if restart else numbers[GAIN_THETA]
    told = 0.0 if restart else 1.0
    cosine, sine = cos(theta), sin(theta)
    for i in range(len(forward)):
        x = told * (cosine * forward[i] - sine * sideways[i]) - followed * body[X, i]
        y = told * (sine * forward[i] + cosine * sideways[i]) - followed * body[Y, i]
        turned = told * heading[i] - followed_theta * body[TURNED, i]
        body[X, i] += x
        body[Y, i] += y
        body[TURNED, i] += turned
        ahead = cosine * x + sine * y
        pulled[EAST, i] += x
        pulled[NORTH, i] += y
        pulled[HEADING, i] += turned
        pulled[AHEAD, i] += ahead
        pulled[BESIDE, i] += cosine * y - sine * x
        pulled[LATENESS, i] -= turning * turned + speed * ahead


@inlined
def back_through_both(left, right, pulled, then, at_end, response, numbers):  # type: ignore[no-untyped-def]
    """Transpose `roll_wheels`."""
    free = may_roll(then[PSI_RIGHT], at_end[PSI_RIGHT], numbers[HOLDS])
    back_through_wheels(right, pulled, RIGHT, RIGHT_ENCODER, free, numbers[DT], response)
    free = may_roll(then[PSI_LEFT], at_end[PSI_LEFT], numbers[HOLDS])
    back_through_wheels(left, pulled, LEFT, LEFT_ENCODER, free, numbers[DT], response)


@compiled(
    "void(f8[:, ::1], f8[::1], f8[::1], u1[:, ::1], f8[::1], f8[::1], f8[::1], u1[::1], f8[:, :, ::1],"
    "f8[:, ::1], f8[:, ::1], f8[:, ::1], f8[:, ::1], f8[:, ::1], f8[:, ::1])"
)
def follow_back(  # type: ignore[no-untyped-def]
    motion, numbers, wheel_time, wheel_use, gyro_time, pose_time, pose_theta, pose_use, result,
    of_left, of_right, of_gyro, of_forward, of_sideways, of_heading,
):  # fmt: skip
    """Transpose `follow_traces`: follow vectors over the errors from the end to the beginning."""
    steps, lanes = result.shape[0], result.shape[2]
    dt, response = numbers[DT], response_of(numbers[DT], numbers[SLOWING])
    turning = numbers[RADIUS] / numbers[WIDTH]
    left, right, body = np.zeros((4, lanes)), np.zeros((4, lanes)), np.zeros((5, lanes))
    wheel, gyro, pose = len(wheel_time), len(gyro_time), len(pose_time)
    left_reading, right_reading = len(of_left), len(of_right)
    for step in range(steps - 1, -1, -1):
        pulled, then, at_end = result[step], motion[step], motion[step + 1]
        before, now = step * dt if step else -np.inf, (step + 1) * dt
        while pose > 0 and pose_time[pose - 1] > before:
            pose -= 1
            if pose_time[pose] <= now:
                back_from_pose(
                    of_forward[pose], of_sideways[pose], of_heading[pose],
                    body, pulled, pose_theta[pose], at_end, pose_use[pose] == 0, numbers,
                )  # fmt: skip
        while wheel > 0 and wheel_time[wheel - 1] > before:
            wheel -= 1
            reached, share = wheel_time[wheel] <= now, min(1.0 - (now - wheel_time[wheel]) / dt, 1.0)
            if wheel_use[wheel, 1] > 0:
                right_reading -= 1
                if reached:
                    back_from_encoder(of_right[right_reading], right, body, share, at_end[THETA], turning, numbers)
            if wheel_use[wheel, 0] > 0:
                left_reading -= 1
                if reached:
                    back_from_encoder(of_left[left_reading], left, body, share, at_end[THETA], -turning, numbers)
        while gyro > 0 and gyro_time[gyro - 1] > before + EARLY * dt:
            gyro -= 1
            if gyro_time[gyro] <= now + EARLY * dt:
                back_from_gyro(of_gyro[gyro], body, pulled, 1.0 - (now - gyro_time[gyro]) / dt)
        back_through_body(body, left, right, pulled, then, at_end, numbers)
        back_through_both(left, right, pulled, then, at_end, response, numbers)

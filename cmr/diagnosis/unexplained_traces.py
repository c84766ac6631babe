"""What traces a small disturbance leaves in the prediction errors, of whatever it disturbs.

The observer's answer to a small disturbance is linear: a motor of first order, wheels that carry the body, and
corrections by shares of the errors. So hundreds of disturbances are observed side by side in little time, and none of
them need be an effect that the model knows.
"""

from collections.abc import Mapping, Sequence
from copy import copy
from dataclasses import dataclass
from math import cos, exp, sin

import numpy as np

from cmr.diagnosis.prediction import POSE_SIGNALS, SIGNALS, Errors, Predictor
from cmr.model.compiled import compiled
from cmr.model.observer import MOTION, Gains
from cmr.recordings.signal import Floats

# What can be disturbed: the wheels' accelerations [rad/s^2]; the yaw rate [rad/s] and the forward and sideways speed
# [m/s] of the body; the speed that an encoder tells [rad/s]; the readings of the gyro [rad/s], of the pose's heading
# [rad] and position in the world [m].
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
)
ALL = SIGNALS
BODY = ("yaw_rate", *POSE_SIGNALS)
# The signals in which each leaves traces. A gyro's errors also tell which errors of the pose are to be expected.
SEEN_IN: Mapping[str, tuple[str, ...]] = {
    "left": ALL,
    "right": ALL,
    "left_encoder": ALL,
    "right_encoder": ALL,
    "yaw_rate": BODY,
    "gyro": BODY,
    "heading": POSE_SIGNALS,
    **dict.fromkeys(("forward", "sideways", "east", "north"), ("forward", "sideways")),
}
PSI_LEFT, PSI_RIGHT, THETA = (MOTION.index(name) for name in ("psi_left", "psi_right", "theta"))
OF_WHEELS = [DISTURBED.index(name) for name in ("left", "right", "left_encoder", "right_encoder")]
HOLDING = ("coulomb_friction", "static_friction", "surface_patch_friction")


@dataclass(frozen=True)
class Disturbances:
    """Disturbances: how each goes with time, `courses` (T, C), and how far it acts on each of DISTURBED, (11, C)."""

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
    """Return what disturbances of a robot with these values add to its prediction errors, (n, C) by signal.

    `predictor` may be one of some signals `only`; `motion` is how the robot moved without them.
    """
    heard = predictor.piece.heard
    count = disturbances.courses.shape[1]
    use = heard.wheel_use if "psi_left" in predictor.times else heard.wheel_use[:0]
    readings = len(heard.gyro_time) if "yaw_rate" in predictor.times else 0
    rows = [int(np.count_nonzero(use[:, 0])), int(np.count_nonzero(use[:, 1])), readings]
    result = [np.zeros((n, count)) for n in (*rows, *[len(heard.pose_time)] * 3)]
    slowing = max(values["k1"] * values["k2_over_k3"], 1e-9)
    holds = float(any(values.get(name, 0.0) > 0.0 for name in HOLDING))
    rolling = float(np.any(disturbances.shares[OF_WHEELS]))
    follow_traces(
        np.ascontiguousarray(disturbances.courses), np.ascontiguousarray(disturbances.shares), motion,
        np.array([heard.dt, slowing, values["wheel_radius"], values["base_width"], holds, rolling, *gains]),
        heard.wheel_time[: len(use)], np.ascontiguousarray(use), heard.gyro_time[:readings],
        heard.pose_time, np.ascontiguousarray(heard.pose[:, 2]), heard.pose_use, *result,
    )  # fmt: skip
    of = dict(zip(SIGNALS, result, strict=True))
    return Errors({name: of[name] for name in predictor.times}, motion)


@compiled(
    "void(f8[:, ::1], f8[:, ::1], f8[:, ::1], f8[::1], f8[::1], u1[:, ::1], f8[::1], f8[::1], f8[::1], u1[::1],"
    "f8[:, ::1], f8[:, ::1], f8[:, ::1], f8[:, ::1], f8[:, ::1], f8[:, ::1])"
)
def follow_traces(  # type: ignore[no-untyped-def]
    courses, shares, motion, numbers, wheel_time, wheel_use, gyro_time, pose_time, pose_theta, pose_use,
    left_error, right_error, gyro_error, forward_error, sideways_error, heading_error,
):  # fmt: skip
    """Observe disturbances, one to a lane.

    `numbers` are dt, the rate at which wheels slow down, radius, width, whether friction holds a wheel that rests,
    whether any wheel is disturbed at all, and the gains.
    """
    steps, lanes = courses.shape
    dt, slowing, radius, width, holds, rolling = (
        numbers[0], numbers[1], numbers[2], numbers[3], numbers[4], numbers[5],
    )  # fmt: skip
    gain_angle, gain_psi, gain_position, gain_theta = numbers[6], numbers[7], numbers[8], numbers[9]
    kept = exp(-slowing * dt)
    coasted = (1.0 - kept) / slowing
    driven = (dt - coasted) / slowing
    state = np.zeros((13, lanes))
    psi_left, psi_right, angle_left, angle_right, before_left, before_right = (
        state[0], state[1], state[2], state[3], state[4], state[5],
    )  # fmt: skip
    x, y, theta, turning, turned_before = state[6], state[7], state[8], state[9], state[10]
    rolled_left, rolled_right = state[11], state[12]
    wheel, gyro, pose, left, right = 0, 0, 0, 0, 0
    for step in range(steps):
        course = courses[step]
        # Dry friction holds a wheel that rests.
        rests_left = motion[step, PSI_LEFT] == 0.0 and motion[step + 1, PSI_LEFT] == 0.0
        rests_right = motion[step, PSI_RIGHT] == 0.0 and motion[step + 1, PSI_RIGHT] == 0.0
        free_left = 0.0 if holds > 0.0 and rests_left else 1.0
        free_right = 0.0 if holds > 0.0 and rests_right else 1.0
        cosine, sine = cos(motion[step, THETA]), sin(motion[step, THETA])
        ahead = 0.5 * radius * dt * (motion[step + 1, PSI_LEFT] + motion[step + 1, PSI_RIGHT])
        if rolling > 0.0:
            for i in range(lanes):
                before_left[i], before_right[i] = angle_left[i], angle_right[i]
                push_left, push_right = shares[0, i] * course[i] * free_left, shares[1, i] * course[i] * free_right
                rolled_left[i] = free_left * coasted * psi_left[i] + driven * push_left
                rolled_right[i] = free_right * coasted * psi_right[i] + driven * push_right
                psi_left[i] = free_left * kept * psi_left[i] + coasted * push_left
                psi_right[i] = free_right * kept * psi_right[i] + coasted * push_right
                # What an encoder miscounts is as if the wheel were elsewhere; the body does not follow it.
                angle_left[i] += rolled_left[i] + shares[5, i] * course[i] * dt
                angle_right[i] += rolled_right[i] + shares[6, i] * course[i] * dt
        for i in range(lanes):
            turn = (rolled_right[i] - rolled_left[i]) * radius / width + shares[2, i] * course[i] * dt
            turned_before[i] = turning[i]
            turning[i] = turn / dt
            on = 0.5 * radius * (rolled_left[i] + rolled_right[i]) + shares[3, i] * course[i] * dt
            aside = shares[4, i] * course[i] * dt + ahead * (theta[i] + 0.5 * turn)
            x[i] += on * cosine - aside * sine
            y[i] += on * sine + aside * cosine
            theta[i] += turn
        now = (step + 1) * dt
        # Yaw rates are means over steps, known in their middles.
        while gyro < len(gyro_time) and gyro_time[gyro] + 0.5 * dt <= now:
            share = 1.0 - (now - gyro_time[gyro] - 0.5 * dt) / dt
            for i in range(lanes):
                error = turned_before[i] + share * (turning[i] - turned_before[i])
                gyro_error[gyro, i] = error + shares[7, i] * course[i]
            gyro += 1
        while wheel < len(wheel_time) and wheel_time[wheel] <= now:
            share = min(1.0 - (now - wheel_time[wheel]) / dt, 1.0)
            if wheel_use[wheel, 0] > 0:
                for i in range(lanes):
                    error = before_left[i] + share * (angle_left[i] - before_left[i])
                    left_error[left, i] = error
                    angle_left[i] -= gain_angle * error
                    before_left[i] -= gain_angle * error
                    psi_left[i] -= gain_psi * error
                left += 1
            if wheel_use[wheel, 1] > 0:
                for i in range(lanes):
                    error = before_right[i] + share * (angle_right[i] - before_right[i])
                    right_error[right, i] = error
                    angle_right[i] -= gain_angle * error
                    before_right[i] -= gain_angle * error
                    psi_right[i] -= gain_psi * error
                right += 1
            wheel += 1
        while pose < len(pose_time) and pose_time[pose] <= now:
            restart = pose_use[pose] == 0
            followed = 1.0 if restart else gain_position
            followed_theta = 1.0 if restart else gain_theta
            cosine, sine = cos(pose_theta[pose]), sin(pose_theta[pose])
            for i in range(lanes):
                error_theta = theta[i] + shares[8, i] * course[i]
                error_x, error_y = x[i] + shares[9, i] * course[i], y[i] + shares[10, i] * course[i]
                if not restart:
                    forward_error[pose, i] = cosine * error_x + sine * error_y
                    sideways_error[pose, i] = cosine * error_y - sine * error_x
                    heading_error[pose, i] = error_theta
                x[i] -= followed * error_x
                y[i] -= followed * error_y
                theta[i] -= followed_theta * error_theta
            pose += 1

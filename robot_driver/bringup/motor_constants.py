"""Estimate k2_over_k3 and k1 from the drive on the floor, for control until the robot is calibrated."""

import math
from collections.abc import Sequence

from cmr.msg import motor_feedback_t
from robot_driver.bringup.fitting import Undetermined, least_squares

STEP = 8  # messages between two speeds that are compared
SLOW = 0.3  # rad/s; friction may hold slower wheels
FEWEST = 30  # rows


def motor_constants(feedback: Sequence[motor_feedback_t]) -> tuple[float, float] | None:
    """Return the mean k2_over_k3 (rad/s^2) and k1 (s/rad) of the wheels; None if the drive does not determine them.

    The change of speed between two messages is the integral of k2_over_k3 (duty - friction - k1 speed).
    """
    rows: list[tuple[float, float, float]] = []
    values: list[float] = []
    for side in ("left", "right"):
        psi = [float(getattr(message, f"psi_{side}")) for message in feedback]
        duty = [float(getattr(message, f"applied_{side}")) for message in feedback]
        times = [message.utime / 1e6 for message in feedback]
        for first in range(0, len(feedback) - STEP, STEP // 2):
            span = range(first, first + STEP)
            if any(abs(psi[k]) < SLOW or psi[k] * psi[first] < 0.0 for k in span):
                continue
            steps = [times[k + 1] - times[k] for k in span]
            driven = sum(step * duty[k] for step, k in zip(steps, span, strict=True))
            turned = sum(step * 0.5 * (psi[k] + psi[k + 1]) for step, k in zip(steps, span, strict=True))
            rows.append((driven, -turned, -math.copysign(sum(steps), psi[first])))
            values.append(psi[first + STEP] - psi[first])
    if len(rows) < FEWEST:
        return None
    try:
        gain, damping, _friction = (value.real for value in least_squares(rows, values))
    except Undetermined:
        return None
    return (gain, damping / gain) if gain > 0.0 and damping > 0.0 else None

"""From a point to head for to duties of the motors.

Source of the steering law: Coulter, Implementation of the Pure Pursuit Path Tracking Algorithm, CMU 1992.
"""

import math

from cmr.model.compiled import compiled
from cmr.model.elementary import sincos
from cmr.world.behaviours.team import Duties, Floats, Indices

LARGEST_DUTY = 0.9  # leaves the motors something to turn with


@compiled(
    "void(i8[::1], f8[::1], f8[::1], f8[::1], f8[::1], f8[::1], f8[::1], f8[::1], f8[::1], f8[::1], f8[::1], f8[::1],"
    " f8[:, ::1])"
)
def steer(
    row: Indices,
    x: Floats,
    y: Floats,
    theta: Floats,
    target_x: Floats,
    target_y: Floats,
    speed: Floats,
    fastest: Floats,
    wheel_radius: Floats,
    k1: Floats,
    base_width: Floats,
    remembered: Floats,
    duties: Duties,
) -> None:
    """Write the duties (n, 2) that take robots at poses [m, m, rad] to targets [m] at these speeds [m/s].

    Each follows the arc through its target, and turns more sharply where it may go at most `fastest` [m/s] straight
    on. Where the target lies behind, it turns on the spot. One without speed stands. The speeds are `remembered` at
    `row` (n,).
    """
    for i in range(len(x)):
        remembered[row[i]] = speed[i]
        dx, dy = target_x[i] - x[i], target_y[i] - y[i]
        distance = math.sqrt(dx * dx + dy * dy)
        if not (speed[i] > 0.0 and distance > 1e-9):
            duties[i, 0] = duties[i, 1] = 0.0
            continue
        sin, cos = sincos(theta[i])
        ahead, aside = dx * cos + dy * sin, dy * cos - dx * sin
        if ahead > 0.0:
            forward = min(speed[i], fastest[i])
            sideways = speed[i] * aside / (distance * distance) * base_width[i]
        else:
            forward = 0.0
            sideways = math.copysign(speed[i], aside)
        per_speed = k1[i] / wheel_radius[i]
        left, right = (forward - sideways) * per_speed, (forward + sideways) * per_speed
        excess = max(1.0, abs(left) / LARGEST_DUTY, abs(right) / LARGEST_DUTY)
        duties[i, 0], duties[i, 1] = left / excess, right / excess


@compiled("f8(i8[::1], f8, f8, f8, f8[::1], f8[::1], f8[::1])")
def gather_speed(
    row: Indices,
    utime: float,
    longest: float,
    acceleration: float,
    decided: Floats,
    remembered: Floats,
    speed: Floats,
) -> float:
    """Lower the speeds [m/s] of n robots to what each can have gathered by now; return the highest, at least 0.

    When they decided last [us] and how fast they went then is in `decided` and `remembered` at `row` (n,); they decide
    now. Nobody gathers more than in `longest` [s].
    """
    highest = 0.0
    for k in range(len(row)):
        r = row[k]
        dt = min(max((utime - decided[r]) * 1e-6, 0.0), longest)
        speed[k] = min(speed[k], remembered[r] + acceleration * dt)
        highest = max(highest, speed[k])
        decided[r] = utime
    return highest

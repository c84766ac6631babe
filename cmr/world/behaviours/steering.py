"""Steer to a target point: motor duties by pure pursuit.

Source of the steering law: Coulter, Implementation of the Pure Pursuit Path Tracking Algorithm, CMU 1992.
"""

from cmr.model.compiled import compiled
from cmr.model.elementary import sincos
from cmr.world.behaviours.team import Floats, Indices

LARGEST_DUTY = 0.9  # leaves the motors a reserve for turning
REACHED = 1e-9  # m; a target nearer than that is reached


@compiled(
    "void(i8[::1], f8[::1], f8[::1], f8[::1], f8[::1], f8[::1], f8[::1], f8[::1], f8[::1], f8[::1], f8[::1], f8[::1],"
    " f8[::1], f8[::1])"
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
    duty_left: Floats,
    duty_right: Floats,
) -> None:
    """Write the duties that take robots at poses [m, m, rad] to targets [m] at these speeds [m/s].

    Each follows the arc through its target, and turns more sharply if its forward speed is limited to `fastest` [m/s].
    If the target is behind, it turns on the spot. With speed 0 it stops. The speeds are stored in `remembered` at `row`
    (n,).
    """
    for i in range(len(x)):
        remembered[row[i]] = speed[i]
    for i in range(len(x)):  # without branches, so that the compiler vectorises the loop
        dx, dy = target_x[i] - x[i], target_y[i] - y[i]
        squared = dx * dx + dy * dy
        sin, cos = sincos(theta[i])
        ahead, aside = dx * cos + dy * sin, dy * cos - dx * sin
        forward = min(speed[i], fastest[i]) if ahead > 0.0 else 0.0
        on_the_spot = speed[i] if aside >= 0.0 else -speed[i]
        sideways = speed[i] * aside / squared * base_width[i] if ahead > 0.0 else on_the_spot
        per_speed = k1[i] / wheel_radius[i]
        left, right = (forward - sideways) * per_speed, (forward + sideways) * per_speed
        excess = max(1.0, abs(left) / LARGEST_DUTY, abs(right) / LARGEST_DUTY)
        goes = speed[i] > 0.0 and squared > REACHED * REACHED
        duty_left[i], duty_right[i] = (left / excess if goes else 0.0), (right / excess if goes else 0.0)


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
    """Limit the speeds [m/s] of n robots by their acceleration; return the highest, at least 0.

    The time of their last decision [us] and their speed then are in `decided` and `remembered` at `row` (n,). The speed
    grows by at most the gain of `longest` [s].
    """
    highest = 0.0
    for k in range(len(row)):
        r = row[k]
        dt = min(max((utime - decided[r]) * 1e-6, 0.0), longest)
        speed[k] = min(speed[k], remembered[r] + acceleration * dt)
        highest = max(highest, speed[k])
        decided[r] = utime
    return highest

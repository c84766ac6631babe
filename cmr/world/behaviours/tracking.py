"""Track the pose that a robot would have if it had moved as its leader did.

Source of the control law: Kanayama, Kimura, Miyazaki and Noguchi, A stable tracking control method for an autonomous
mobile robot, ICRA 1990. Here the heading is corrected with a gain of its own, so that turns on the spot are tracked,
too.
"""

from cmr.model.compiled import compiled, inlined
from cmr.model.elementary import sincos
from cmr.world.behaviours.steering import LARGEST_DUTY
from cmr.world.behaviours.team import Floats, Indices

PER_DISTANCE = 2.0  # 1/s: speed per metre of longitudinal error
CATCHING_UP = 0.2  # m/s; largest difference in speed to the leader
PER_ANGLE = 2.0  # 1/s: yaw rate per radian of heading error
PER_AREA = 6.0  # 1/m^2: yaw rate per metre of lateral error, at a speed of 1 m/s
FURTHEST = 0.5  # m from the desired position; a robot further away restarts from where it is
LONGEST_PAUSE = 200_000.0  # us; after a longer pause in calls it also restarts, instead of catching up
NEAR, TURNED = 0.02, 0.03  # m, rad; a robot this near stops when its leader stands
SLOW, TURNS_SLOWLY = 0.005, 0.02  # m/s, rad/s; slower than both counts as standing


@inlined
def _wanted_from(x, y, leader_x, leader_y, turn, shift_x, shift_y):  # type: ignore[no-untyped-def]
    """Return the vector [m] from (x, y) to the desired position: the leader's, rotated and shifted."""
    sine, cosine = sincos(turn)
    return shift_x + cosine * leader_x - sine * leader_y - x, shift_y + sine * leader_x + cosine * leader_y - y


@inlined
def _begin_here(r, x, y, theta, leader_x, leader_y, leader_theta, turn, shift_x, shift_y):  # type: ignore[no-untyped-def]
    """Set rotation and shift so that they map the leader's pose to the robot's own."""
    turn[r] = theta - leader_theta
    sine, cosine = sincos(turn[r])
    shift_x[r] = x - (cosine * leader_x - sine * leader_y)
    shift_y[r] = y - (sine * leader_x + cosine * leader_y)


@inlined
def _duties(forward, half, per_speed):  # type: ignore[no-untyped-def]
    """Return the duties of both sides for a speed and half the difference between the sides [m/s], within bounds."""
    left, right = (forward - half) * per_speed, (forward + half) * per_speed
    excess = max(1.0, abs(left) / LARGEST_DUTY, abs(right) / LARGEST_DUTY)
    return left / excess, right / excess


@compiled("void(f8, " + ", ".join(["i8[::1]"] * 2 + ["f8[::1]"] * 17) + ")")
def track(
    utime: float, row: Indices, leader: Indices,
    all_x: Floats, all_y: Floats, all_theta: Floats, psi_left: Floats, psi_right: Floats,
    x: Floats, y: Floats, theta: Floats, wheel_radius: Floats, k1: Floats, base_width: Floats,
    tracked: Floats, turn: Floats, shift_x: Floats, shift_y: Floats,
    duty_left: Floats, duty_right: Floats,
) -> None:  # fmt: skip
    """Write the duties at `utime` [us] of n robots at poses [m, m, rad] that copy their leaders' motion.

    `leader[k]` is the index of robot k's leader in the arrays of all robots, poses and wheel speeds [rad/s]; -1 if it
    is missing: then robot k stops, and restarts later. The desired pose is the leader's, rotated by `turn` [rad] and
    shifted [m], both stored at `row[k]`; `tracked` is when it was last tracked [us], 0 if never.
    """
    for k in range(len(row)):
        r, j = row[k], leader[k]
        duty_left[k] = duty_right[k] = 0.0
        if j < 0:
            tracked[r] = 0.0
            continue
        dx, dy = _wanted_from(x[k], y[k], all_x[j], all_y[j], turn[r], shift_x[r], shift_y[r])
        goes_on = tracked[r] > 0.0 and abs(utime - tracked[r]) <= LONGEST_PAUSE
        tracked[r] = utime
        if not (goes_on and dx * dx + dy * dy <= FURTHEST * FURTHEST):  # also false for NaN
            _begin_here(r, x[k], y[k], theta[k], all_x[j], all_y[j], all_theta[j], turn, shift_x, shift_y)
            dx = dy = 0.0
        sine, cosine = sincos(theta[k])
        ahead, aside = cosine * dx + sine * dy, cosine * dy - sine * dx
        sine, cosine = sincos(all_theta[j] + turn[r] - theta[k])
        speed = 0.5 * wheel_radius[k] * (psi_left[j] + psi_right[j])
        yaw_rate = wheel_radius[k] * (psi_right[j] - psi_left[j]) / base_width[k]
        stands = abs(speed) < SLOW and abs(yaw_rate) < TURNS_SLOWLY
        if stands and abs(ahead) < NEAR and abs(sine) < TURNED and cosine > 0.0:
            continue
        forward = speed * cosine + min(max(PER_DISTANCE * ahead, -CATCHING_UP), CATCHING_UP)
        half = 0.5 * base_width[k] * (yaw_rate + speed * PER_AREA * aside + PER_ANGLE * sine)
        duty_left[k], duty_right[k] = _duties(forward, half, k1[k] / wheel_radius[k])

"""The robot itself: its equations, written one by one and integrated with steps of second order.

Symbols: u duty, V voltage as a share of full drive, psi wheel speed [rad/s], phi angle turned [rad], a = K2/K3,
r wheel radius, b base width, v forward speed [m/s], w yaw rate [rad/s]; s = +1 on the left and -1 on the right.

Paper: domega = a V - K1 a psi, v = (v_left + v_right) / 2, w = (v_right - v_left) / b with v_i = r psi_i.

What acts on what: a command passes turn_rate_limit, deadband, slew_limit and electrical_lag and is then u, which
battery, saturation and asymmetry, in this order, turn into V; load, energy and heat follow u. The shaft angle phi
is what encoders see; wheels follow it through the backlash, the ground follows the wheels.
"""

import math
from collections.abc import Callable
from typing import NamedTuple, ParamSpec, TypeVar

import numba
import numpy as np

from cmr.recordings.signal import Floats
from tests.reference_plant.parameters import PlantParameters

STRIBECK_SPEED = 0.5  # rad/s; where static friction has fallen to a third
HEATING_TIME = 60.0  # s
REFERENCE_ENERGY = 10.0  # s of full load current: about what a figure-eight of two minutes draws
COUPLING_SWEEPS = 12  # each brings the two accelerations nearer to their common solution by motor_coupling squared
FELT_SPEED = 0.5  # rad/s; noise of the torque is felt fully above it, and does not set off a wheel that rests

COLUMNS = ("x", "y", "theta", "psi_left", "psi_right", "domega_left", "domega_right", "phi_left", "phi_right", "w")


class Side(NamedTuple):
    """The motor and the wheels of one side."""

    ramp: float  # duty, after slew_limit
    u: float  # duty, what reaches the motor
    heat: float  # duty^2, of the motor
    psi: float  # rad/s
    domega: float  # rad/s^2, mean of the last step
    phi: float  # rad, turned by the shaft since the start
    gap: float  # rad, shaft ahead of the wheel
    torque: float  # rad/s^2, noise
    slip: float  # 1, noise


class Body(NamedTuple):
    """The rest of the robot: pose [m, m, rad], yaw rate [rad/s], energy drawn from the battery [s of full load]."""

    x: float
    y: float
    theta: float
    w: float
    energy: float


class Robot(NamedTuple):
    """All that the robot carries from one step to the next."""

    left: Side
    right: Side
    body: Body


P = ParamSpec("P")
R = TypeVar("R")


def at_rest(pose: tuple[float, float, float]) -> Robot:
    """Return the robot at rest at this pose."""
    side = Side(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    return Robot(side, side, Body(*pose, 0.0, 0.0))


def compiled(function: Callable[P, R]) -> Callable[P, R]:
    """Compile with numba; a division by zero gives infinity, as in NumPy."""
    result: Callable[P, R] = numba.njit(cache=True, error_model="numpy")(function)
    return result


@compiled
def clip(value: float, limit: float) -> float:
    """Return the value within -limit to limit."""
    return min(max(value, -limit), limit)


@compiled
def wanted_duties(p: PlantParameters, left: float, right: float) -> tuple[float, float]:
    """Return what the controller asks of the motors for the commands it has."""
    # turn_rate_limit: commanded body turn rate clipped to +-W before the wheels; a wheel told u is to turn at u / K1.
    per_duty = p.wheel_radius / (p.k1 * p.base_width)
    turn_rate = per_duty * (right - left)
    if abs(turn_rate) > p.turn_rate_limit:
        excess = (turn_rate - clip(turn_rate, p.turn_rate_limit)) / per_duty
        left, right = left + excess / 2.0, right - excess / 2.0
    # deadband: V = 0 where abs(u) < d.
    left = 0.0 if abs(left) < p.deadband else left
    right = 0.0 if abs(right) < p.deadband else right
    return left, right


@compiled
def slewed(p: PlantParameters, before: float, wanted: float, h: float) -> float:
    """Return the duty after h of slew_limit: abs(dV/dt) <= S."""
    if abs(wanted - before) <= p.slew_limit * h:
        return wanted
    return before + clip(wanted - before, p.slew_limit * h)


@compiled
def lagged(p: PlantParameters, before: float, wanted: float, h: float) -> float:
    """Return the duty after h of electrical_lag: V follows u with a first-order lag."""
    if p.electrical_lag == 0.0:
        return wanted
    return wanted + (before - wanted) * math.exp(-h / p.electrical_lag)


@compiled
def load(p: PlantParameters, u_left: float, u_right: float, psi_left: float, psi_right: float) -> float:
    """Return the load current share q = sum max(0, u (u - 0.8 K1 psi))."""
    left = max(0.0, u_left * (u_left - 0.8 * p.k1 * psi_left))
    right = max(0.0, u_right * (u_right - 0.8 * p.k1 * psi_right))
    return left + right


@compiled
def driving(p: PlantParameters, s: float, side: Side, q: float, energy: float, t: float) -> float:
    """Return the acceleration that motor and drag give one side [rad/s^2]."""
    # battery_sag: V = u (1 - R q); battery_drift: V = u (1 - k E / E_ref).
    v = side.u * (1.0 - p.battery_sag * q) * (1.0 - p.battery_drift * energy / REFERENCE_ENERGY)
    # saturation: V clipped to +-V_max; motor_gain_asymmetry: V (1 + s g).
    v = clip(v, p.saturation) * (1.0 + s * p.motor_gain_asymmetry)
    # back_emf_asymmetry: K1 (1 + s g); motor_heating: K1 (1 + h H); surface_change: K1 (1 + e) after T.
    k1 = p.k1 * (1.0 + s * p.back_emf_asymmetry) * (1.0 + p.motor_heating * side.heat)
    if t >= p.surface_change_time:
        k1 *= 1.0 + p.surface_change_k1
    # payload_change: a (1 - p) after T.
    a = p.k2_over_k3 * (1.0 - p.payload_change_share) if t >= p.payload_change_time else p.k2_over_k3
    # current_limit: abs(V - K1 psi) <= I_max.  quadratic_drag: domega -= k psi abs(psi).
    acceleration = a * clip(v - k1 * side.psi, p.current_limit) - p.quadratic_drag * side.psi * abs(side.psi)
    return acceleration + side.torque * min(1.0, abs(side.psi) / FELT_SPEED)


@compiled
def dry_friction(p: PlantParameters, psi: float, inside: bool) -> float:
    """Return the size of the friction that opposes the motion, or holds a wheel at rest [rad/s^2]."""
    # coulomb_friction: c; static_friction: extra c_s exp(-(psi / 0.5)^2); surface_patch: extra friction c inside.
    friction = p.coulomb_friction
    if p.static_friction > 0.0:
        friction += p.static_friction * math.exp(-((psi / STRIBECK_SPEED) ** 2))
    if inside:
        friction += p.surface_patch_friction
    return friction


@compiled
def rubbed(acceleration: float, direction: float, friction: float) -> float:
    """Return the acceleration with dry friction: against the motion, or holding a wheel at rest as far as it can."""
    if direction > 0.0:
        return acceleration - friction
    if direction < 0.0:
        return acceleration + friction
    return acceleration - clip(acceleration, friction)


@compiled
def accelerations(
    p: PlantParameters,
    left: Side,
    right: Side,
    directions: tuple[float, float],
    energy: float,
    theta: float,
    inside: bool,
    t: float,
) -> tuple[float, float]:
    """Return domega of both sides; their friction acts against `directions`, of which 0 is rest."""
    q = load(p, left.u, right.u, left.psi, right.psi)
    # slope: domega -= g_x cos theta + g_y sin theta.
    uphill = 0.0
    if p.slope_x != 0.0 or p.slope_y != 0.0:
        uphill = p.slope_x * math.cos(theta) + p.slope_y * math.sin(theta)
    free_left = driving(p, 1.0, left, q, energy, t) - uphill
    free_right = driving(p, -1.0, right, q, energy, t) - uphill
    friction_left, friction_right = dry_friction(p, left.psi, inside), dry_friction(p, right.psi, inside)
    domega_left = rubbed(free_left, directions[0], friction_left)
    domega_right = rubbed(free_right, directions[1], friction_right)
    # motor_coupling: domega_left -= c domega_right and the other way round, both at once.
    if p.motor_coupling != 0.0:
        for _ in range(COUPLING_SWEEPS):
            domega_left = rubbed(free_left - p.motor_coupling * domega_right, directions[0], friction_left)
            domega_right = rubbed(free_right - p.motor_coupling * domega_left, directions[1], friction_right)
    return domega_left, domega_right


@compiled
def stopped_by_friction(before: float, after: float, friction: float) -> float:
    """Return the speed after a step: a wheel that dry friction reverses has come to rest first."""
    return 0.0 if before * after < 0.0 and friction > 0.0 else after


@compiled
def taken_up(gap: float, turned: float, backlash: float) -> tuple[float, float]:
    """Return where the shaft is in the gap of the gearing and how far the wheel turned [rad].

    backlash: the wheel turns only after the gap g is taken up. `gap` is the shaft's angle ahead of the wheel, within
    +-g/2; at the start it is 0.
    """
    wanted = gap + turned
    inside = clip(wanted, backlash / 2.0)
    return inside, wanted - inside


@compiled
def yaw_rate(p: PlantParameters, v_left: float, v_right: float, inside: bool, t: float) -> float:
    """Return w for the ground speeds of both sides."""
    b = p.base_width
    # surface_change: b (1 + f) after T; surface_patch: b (1 + f) inside the disc.
    if t >= p.surface_change_time:
        b *= 1.0 + p.surface_change_base_width
    if inside:
        b *= 1.0 + p.surface_patch_base_width
    # turn_asymmetry: b (1 + k sign(w)).
    if v_right != v_left:
        b *= 1.0 + p.turn_asymmetry * math.copysign(1.0, v_right - v_left)
    w = (v_right - v_left) / b
    # turn_slip: b (1 + k abs(w)), so w (1 + k abs(w)) = (v_right - v_left) / b, solved for w.
    return 2.0 * w / (1.0 + math.sqrt(1.0 + 4.0 * p.turn_slip * abs(w)))


@compiled
def rolling_radius(p: PlantParameters, s: float, phi: float) -> float:
    """Return r of one side whose wheel has turned by phi."""
    # wheel_radius_scale: r (1 + e); wheel_radius_asymmetry: r (1 + s e); wheel_wobble: r (1 + e cos(phi + phase)).
    r = p.wheel_radius * (1.0 + p.wheel_radius_scale) * (1.0 + s * p.wheel_radius_asymmetry)
    if p.wheel_wobble_share != 0.0:
        r *= 1.0 + p.wheel_wobble_share * math.cos(phi + p.wheel_wobble_phase)
    return r


@compiled
def on_patch(p: PlantParameters, x: float, y: float) -> bool:
    """Tell whether the robot stands inside the disc of surface_patch."""
    return (x - p.surface_patch_x) ** 2 + (y - p.surface_patch_y) ** 2 < p.surface_patch_radius**2


@compiled
def wander(value: float, size: float, kept: float, random: np.random.Generator) -> float:
    """Return the next value of an Ornstein-Uhlenbeck process of this standard deviation."""
    if size == 0.0:
        return 0.0
    return kept * value + size * math.sqrt(1.0 - kept * kept) * random.standard_normal()


@compiled
def powered(p: PlantParameters, side: Side, wanted: float, h: float) -> Side:
    """Return the side with its electronics and the heat of its motor h later."""
    ramp = slewed(p, side.ramp, wanted, h)
    u = lagged(p, side.u, ramp, h)
    # motor_heating: H follows u^2 with a first-order lag of 60 s.
    heat = u * u + (side.heat - u * u) * math.exp(-h / HEATING_TIME) if p.motor_heating != 0.0 else 0.0
    return Side(ramp, u, heat, side.psi, side.domega, side.phi, side.gap, side.torque, side.slip)


@compiled
def switched(p: PlantParameters, side: Side, wanted: float) -> Side:
    """Return the side at the moment a command changes: without slew_limit and electrical_lag V jumps."""
    ramp = wanted if p.slew_limit == math.inf else side.ramp
    u = ramp if p.electrical_lag == 0.0 else side.u
    return Side(ramp, u, side.heat, side.psi, side.domega, side.phi, side.gap, side.torque, side.slip)


@compiled
def at_speed(side: Side, psi: float) -> Side:
    """Return the side as it is at another wheel speed."""
    return Side(side.ramp, side.u, side.heat, psi, side.domega, side.phi, side.gap, side.torque, side.slip)


@compiled
def turned(side: Side, first: float, second: float, holding: float, backlash: float, h: float) -> tuple[Side, float]:
    """Return the side after a step with these accelerations at its two ends, and how far its wheel turned [rad]."""
    psi = side.psi + 0.5 * h * (first + second)
    turn = 0.5 * h * (side.psi + psi)
    if side.psi * psi < 0.0 and holding > 0.0:
        # A wheel that dry friction reverses comes to rest on the way; what friction cannot hold sets off from there.
        resting = h * psi / (psi - side.psi)
        onward = rubbed(second + math.copysign(holding, side.psi), 0.0, holding)
        turn = 0.5 * side.psi * (h - resting) + 0.5 * onward * resting**2
        psi = onward * resting
    gap, rolled = taken_up(side.gap, turn, backlash)
    domega, phi = (psi - side.psi) / h, side.phi + turn
    return Side(side.ramp, side.u, side.heat, psi, domega, phi, gap, side.torque, side.slip), rolled


@compiled
def ground_speed(p: PlantParameters, s: float, side: Side, rolled: float, h: float) -> float:
    """Return the speed [m/s] with which one side moves over the ground while its wheel turns by `rolled`."""
    # longitudinal_slip: ground speed psi - k domega.
    rate = rolled / h - p.longitudinal_slip * side.domega
    return rolling_radius(p, s, side.phi - side.gap - 0.5 * rolled) * rate * (1.0 + side.slip)


@compiled
def moved(
    p: PlantParameters, body: Body, energy: float, v_left: float, v_right: float, inside: bool, t: float, h: float
) -> Body:
    """Return the body after h at these ground speeds, by the midpoint rule."""
    w = yaw_rate(p, v_left, v_right, inside, t)
    # lateral_skid: v_y = -k v w.
    v_x = 0.5 * (v_left + v_right)
    v_y = -p.lateral_skid * v_x * w
    cosine, sine = math.cos(body.theta + 0.5 * h * w), math.sin(body.theta + 0.5 * h * w)
    x, y = body.x + h * (v_x * cosine - v_y * sine), body.y + h * (v_x * sine + v_y * cosine)
    return Body(x, y, body.theta + h * w, w, energy)


@compiled
def advance(
    p: PlantParameters, left: Side, right: Side, body: Body, wanted: tuple[float, float], t: float, h: float
) -> tuple[Side, Side, Body]:
    """Return the robot at time t + h: wheel speeds by Heun's method, then the pose."""
    inside = on_patch(p, body.x, body.y)
    directions = (left.psi, right.psi)
    first = accelerations(p, left, right, directions, body.energy, body.theta, inside, t)
    powered_left, powered_right = powered(p, left, wanted[0], h), powered(p, right, wanted[1], h)
    ahead_left = at_speed(powered_left, left.psi + h * first[0])
    ahead_right = at_speed(powered_right, right.psi + h * first[1])
    # battery_drift: the energy drawn is the integral of the load q.
    energy = body.energy + h * load(p, left.u, right.u, left.psi, right.psi)
    # Within a step friction keeps its direction; a wheel at rest may set off.
    directions = (left.psi or ahead_left.psi, right.psi or ahead_right.psi)
    second = accelerations(p, ahead_left, ahead_right, directions, energy, body.theta + h * body.w, inside, t)
    holding = dry_friction(p, 0.0, inside)
    left, rolled_left = turned(powered_left, first[0], second[0], holding, p.backlash, h)
    right, rolled_right = turned(powered_right, first[1], second[1], holding, p.backlash, h)
    v_left, v_right = ground_speed(p, 1.0, left, rolled_left, h), ground_speed(p, -1.0, right, rolled_right, h)
    return left, right, moved(p, body, energy, v_left, v_right, inside, t, h)


@compiled
def disturbed(side: Side, noise: tuple[float, float, float, float], h: float, random: np.random.Generator) -> Side:
    """Return the side with the noise of its torque and slip h later."""
    torque_noise, torque_time, slip_noise, slip_time = noise
    torque = wander(side.torque, torque_noise, math.exp(-h / torque_time), random)
    slip = wander(side.slip, slip_noise, math.exp(-h / slip_time), random)
    return Side(side.ramp, side.u, side.heat, side.psi, side.domega, side.phi, side.gap, torque, slip)


@compiled
def row(left: Side, right: Side, body: Body) -> tuple[float, ...]:
    """Return the state in the order of COLUMNS."""
    pose = (body.x, body.y, body.theta)
    return (*pose, left.psi, right.psi, left.domega, right.domega, left.phi, right.phi, body.w)


@compiled
def simulate(
    p: PlantParameters,
    robot: Robot,
    borders: Floats,
    duty_left: Floats,
    duty_right: Floats,
    step: float,
    noise: tuple[float, float, float, float],
    random: np.random.Generator,
) -> tuple[Floats, Robot]:
    """Drive on from `robot` and return the state at the borders, shape (n + 1, len(COLUMNS)), and the robot then.

    `borders` [s] are n + 1 increasing times, the first that of `robot`; the duties of shape (n,) have reached the
    controller and hold between them. Steps are at most `step` [s]. `noise`: size [rad/s^2] and time [s] of the
    torque's, size [1] and time [s] of the slip's.
    """
    noisy = noise[0] > 0.0 or noise[2] > 0.0
    left, right, body = robot
    states = np.zeros((len(borders), len(COLUMNS)))
    states[0] = row(left, right, body)
    for span in range(len(duty_left)):
        duration = borders[span + 1] - borders[span]
        steps = max(1, math.ceil(duration / step - 1e-6))
        h = duration / steps
        wanted = wanted_duties(p, duty_left[span], duty_right[span])
        left, right = switched(p, left, wanted[0]), switched(p, right, wanted[1])
        before = body.w
        for number in range(steps):
            before = body.w
            left, right, body = advance(p, left, right, body, wanted, borders[span] + number * h, h)
            if noisy:
                left, right = disturbed(left, noise, h, random), disturbed(right, noise, h, random)
        states[span + 1] = row(left, right, body)
        if steps > 1:
            # A body's yaw rate is the mean of its last step; what a gyro would read is that at the step's end.
            states[span + 1, -1] += 0.5 * (body.w - before)
    return states, Robot(left, right, body)

"""From commands to the wheels' speeds: controller, battery, motors, gearing and friction.

Signal path: a command passes turn_rate_limit, deadband, slew_limit and electrical_lag and is then u, which battery,
saturation and asymmetry, in this order, turn into V; load, energy and heat follow u. The shaft angle phi is what
encoders see; wheels follow it through the backlash, the ground follows the wheels.
"""

import math

from cmr.plant.beyond_motors import (
    bridge_left,
    coupled,
    pulled,
    regeneration_limited,
    relaxed_supply,
    rubbing,
    torque_share,
    winding_warmed,
)
from cmr.plant.compiling import compiled
from cmr.plant.parameters import PlantParameters
from cmr.plant.state import Body, Side

STRIBECK_SPEED = 0.5  # rad/s; at which static friction has fallen to a third
BUMP_SPEED = 2.0  # rad/s; at which the extra friction of a motor that has just started has fallen to a third
HEATING_TIME = 60.0  # s
REFERENCE_ENERGY = 10.0  # s of full load current: about the energy of a figure-eight of two minutes
COUPLING_SWEEPS = 12  # each brings the two accelerations nearer to their common solution by motor_coupling squared
FELT_SPEED = 0.5  # rad/s; noise of the torque acts fully above it, and does not start a wheel at rest
RIPPLES = 4.0  # periods of the torque per turn of the wheel
IDLE = 0.01  # duty; below it a motor may coast


@compiled
def clip(value: float, limit: float) -> float:
    """Return the value within -limit to limit."""
    return min(max(value, -limit), limit)


@compiled
def counted_width(p: PlantParameters) -> float:
    """Return the base width used to convert commands [m]."""
    return p.controller_base_width if p.controller_base_width > 0.0 else p.base_width


@compiled
def wanted_duties(p: PlantParameters, left: float, right: float) -> tuple[float, float]:
    """Return the duties that the controller demands of the motors for its commands."""
    # turn_rate_limit: body turn rate clipped to +-W before the wheels; a wheel commanded u is to turn at u / K1.
    per_duty = p.wheel_radius / (p.k1 * counted_width(p))
    turn_rate = per_duty * (right - left)
    if abs(turn_rate) > p.turn_rate_limit:
        excess = (turn_rate - clip(turn_rate, p.turn_rate_limit)) / per_duty
        left, right = left + excess / 2.0, right - excess / 2.0
    # wheel_separation_error: half of the difference of both sides grows by e.
    if p.wheel_separation_error != 0.0:
        mean, half = 0.5 * (left + right), 0.5 * (right - left) * (1.0 + p.wheel_separation_error)
        left, right = mean - half, mean + half
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
def given(p: PlantParameters, side: Side) -> float:
    """Return the motor's voltage for its duty u, before the battery's sag."""
    # cubic_motor: u (1 - c + c u^2); weak_reverse: u (1 - g) where u < 0; torque_ripple: u (1 + A cos(4 phi)).
    v = side.u * (1.0 - p.cubic_motor + p.cubic_motor * side.u * side.u)
    if v < 0.0:
        v *= 1.0 - p.weak_reverse
    if p.torque_ripple != 0.0:
        v *= 1.0 + p.torque_ripple * math.cos(RIPPLES * side.phi)
    return v


@compiled
def supply(p: PlantParameters, q: float, body: Body) -> float:
    """Return the battery's voltage as a share of that without load, when full."""
    # battery_sag: V = u (1 - R q); battery_drift: V = u (1 - k E / E_ref).
    share = (1.0 - p.battery_sag * q) * (1.0 - p.battery_drift * body.energy / REFERENCE_ENERGY)
    return share * relaxed_supply(p, body.remembered) if p.battery_relaxation != 0.0 else share


@compiled
def current(p: PlantParameters, s: float, side: Side, q: float, body: Body, t: float) -> float:
    """Return the current of one motor as a share of its stall current at full duty."""
    v = given(p, side) * supply(p, q, body)
    # saturation: V clipped to +-V_max; motor_gain_asymmetry: V (1 + s g).
    v = clip(v, p.saturation) * (1.0 + s * p.motor_gain_asymmetry)
    # back_emf_asymmetry: K1 (1 + s g); motor_heating: K1 (1 + h H); surface_change: K1 (1 + e) after T.
    k1 = p.k1 * (1.0 + s * p.back_emf_asymmetry) * (1.0 + p.motor_heating * side.heat)
    if t >= p.surface_change_time:
        k1 *= 1.0 + p.surface_change_k1
    # coasting: K1 (1 - c) while no duty is given.
    if abs(side.u) < IDLE:
        k1 *= 1.0 - p.coasting
    # current_limit: abs(V - K1 psi) <= I_max.
    return regeneration_limited(p, bridge_left(p, clip(v - k1 * side.psi, p.current_limit)), side.psi)


@compiled
def held_to_speed(p: PlantParameters, side: Side) -> float:
    """Return the acceleration of one side under a controller of wheel speeds, whatever the motor needs [rad/s^2]."""
    asked = p.controller_scale * clip(side.u, p.saturation) / p.k1
    return clip((asked - side.psi) / p.controller_response_time, p.controller_acceleration)


@compiled
def driving(p: PlantParameters, s: float, side: Side, q: float, body: Body, t: float) -> float:
    """Return the acceleration of one side by motor and drag [rad/s^2]."""
    if p.controller_response_time > 0.0:
        return held_to_speed(p, side) + side.torque * min(1.0, abs(side.psi) / FELT_SPEED)
    # payload_change: a (1 - p) after T.
    a = p.k2_over_k3 * (1.0 - p.payload_change_share) if t >= p.payload_change_time else p.k2_over_k3
    effort = current(p, s, side, q, body, t)
    # quadratic_drag: domega -= k psi abs(psi).
    acceleration = a * effort - p.quadratic_drag * side.psi * abs(side.psi)
    if p.armature_reaction != 0.0 or p.winding_heat != 0.0 or p.gear_loss != 0.0:
        acceleration += a * effort * (torque_share(p, side, effort) - 1.0)
    acceleration -= p.viscous_friction * side.psi
    acceleration -= rubbing(p, s, side)
    return acceleration + side.torque * min(1.0, abs(side.psi) / FELT_SPEED)


@compiled
def friction_size(p: PlantParameters, psi: float, inside: bool) -> float:
    """Return the size of the friction between dry surfaces at this speed [rad/s^2]."""
    # coulomb_friction: c; static_friction: extra c_s exp(-(psi / 0.5)^2); surface_patch: extra friction c inside.
    # Other laws: friction_bump: c (1 + k exp(-abs(psi) / 2)); stribeck_shape: another exponent than 2.
    if p.controller_response_time > 0.0:  # which compensates for it
        return 0.0
    friction = p.coulomb_friction
    if p.friction_bump != 0.0:
        friction *= 1.0 + p.friction_bump * math.exp(-abs(psi) / BUMP_SPEED)
    if p.static_friction > 0.0:
        friction += p.static_friction * math.exp(-((abs(psi) / STRIBECK_SPEED) ** p.stribeck_shape))
    if inside:
        friction += p.surface_patch_friction
    return friction


@compiled
def dry_friction(p: PlantParameters, psi: float, inside: bool) -> float:
    """Return the size of the friction that opposes the motion, or holds a wheel at rest [rad/s^2]."""
    return friction_size(p, psi, inside) if p.friction_smoothing == 0.0 else 0.0


@compiled
def smooth_friction(p: PlantParameters, psi: float, inside: bool) -> float:
    """Return the deceleration by a friction that is smooth around zero speed and does not hold a wheel at rest
    [rad/s^2].
    """
    # friction_smoothing: c tanh(psi / s) in place of c sign(psi).
    if p.friction_smoothing == 0.0:
        return 0.0
    return friction_size(p, psi, inside) * math.tanh(psi / p.friction_smoothing)


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
    body: Body,
    theta: float,
    inside: bool,
    t: float,
) -> tuple[float, float]:
    """Return domega of both sides at this heading; their friction acts against `directions`, of which 0 is rest."""
    q = load(p, left.u, right.u, left.psi, right.psi)
    if p.controller_response_time > 0.0:  # which compensates for slope and coupling, too
        return driving(p, 1.0, left, q, body, t), driving(p, -1.0, right, q, body, t)
    # slope: domega -= g_x cos theta + g_y sin theta.
    uphill = 0.0
    if p.slope_x != 0.0 or p.slope_y != 0.0:
        uphill = p.slope_x * math.cos(theta) + p.slope_y * math.sin(theta)
    free_left = driving(p, 1.0, left, q, body, t) - uphill - smooth_friction(p, left.psi, inside)
    free_right = driving(p, -1.0, right, q, body, t) - uphill - smooth_friction(p, right.psi, inside)
    turning, ahead = coupled(p, left, right), pulled(p, left, right, body, theta)
    free_left, free_right = free_left + turning + ahead, free_right - turning + ahead
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
def taken_up(gap: float, turned: float, backlash: float) -> tuple[float, float]:
    """Return the position of the shaft within the backlash, and the wheel's rotation [rad].

    backlash: the wheel turns only after the gap g is taken up. `gap` is the shaft's angle ahead of the wheel, within
    +-g/2; at the start it is 0.
    """
    wanted = gap + turned
    inside = clip(wanted, backlash / 2.0)
    return inside, wanted - inside


@compiled
def powered(p: PlantParameters, side: Side, wanted: float, h: float) -> Side:
    """Return the side with its electronics and the heat of its motor h later."""
    ramp = slewed(p, side.ramp, wanted, h)
    u = lagged(p, side.u, ramp, h)
    # motor_heating: H follows u^2 with a first-order lag of 60 s.
    heat = u * u + (side.heat - u * u) * math.exp(-h / HEATING_TIME) if p.motor_heating != 0.0 else 0.0
    a, winding = side, winding_warmed(p, side, h)
    return Side(ramp, u, heat, a.psi, a.domega, a.phi, a.gap, a.torque, a.slip, a.lost, winding)


@compiled
def switched(p: PlantParameters, side: Side, wanted: float) -> Side:
    """Return the side at the time of a new command: without slew_limit and electrical_lag V jumps."""
    ramp = wanted if p.slew_limit == math.inf else side.ramp
    u = ramp if p.electrical_lag == 0.0 else side.u
    a = side
    return Side(ramp, u, a.heat, a.psi, a.domega, a.phi, a.gap, a.torque, a.slip, a.lost, a.winding)


@compiled
def turned(side: Side, first: float, second: float, holding: float, backlash: float, h: float) -> tuple[Side, float]:
    """Return the side after a step with these accelerations at its two ends, and its wheel's rotation [rad]."""
    psi = side.psi + 0.5 * h * (first + second)
    turn = 0.5 * h * (side.psi + psi)
    if side.psi * psi < 0.0 and holding > 0.0:
        # A wheel that dry friction would reverse comes to rest within the step; if friction cannot hold it, it starts
        # from there.
        resting = h * psi / (psi - side.psi)
        onward = rubbed(second + math.copysign(holding, side.psi), 0.0, holding)
        turn = 0.5 * side.psi * (h - resting) + 0.5 * onward * resting**2
        psi = onward * resting
    gap, rolled = taken_up(side.gap, turn, backlash)
    domega, phi = (psi - side.psi) / h, side.phi + turn
    a = side
    return Side(a.ramp, a.u, a.heat, psi, domega, phi, gap, a.torque, a.slip, a.lost, a.winding), rolled

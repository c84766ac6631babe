"""Motors, electronics and loads as described in the literature, but by no effect of the catalogue.

Each function is one kind of physics. Its parameter is 0 if it is absent. Symbols are those of `physics`; the effort i =
V - K1 psi is the motor's current as a share of that when it is stalled at full duty.
"""

import math

from cmr.plant.compiling import compiled
from cmr.plant.parameters import PlantParameters
from cmr.plant.state import Body, Side

SMOOTH = 0.1  # rad/s; dry friction of these kinds sets in over this speed
COGS = 6.0  # periods of the torque per turn of the wheel
REEL_SOFTNESS = 0.1  # m; nearer to its reel a tether no longer pulls along the floor


@compiled
def bridge_left(p: PlantParameters, effort: float) -> float:
    """Return the effort after a bridge's dead time: V - d sign(i), and none if no current flows then.

    Between switching one transistor off and the other on, a diode conducts, so the mean voltage errs by a constant
    against the current. S.-G. Jeong, M.-H. Park, The analysis and compensation of dead-time effects in PWM inverters,
    IEEE Transactions on Industrial Electronics 38, 1991, 108-114.
    """
    return effort - min(max(effort, -p.bridge_loss), p.bridge_loss)


@compiled
def regeneration_limited(p: PlantParameters, effort: float, psi: float) -> float:
    """Return the effort after the controller's limit of the braking current: abs(i) <= I where i psi < 0.

    VESC Tool, motor settings: "Motor current max brake" and "Battery current max regen" are limits apart from those of
    the driving current. 0: no limit.
    """
    if p.regeneration_limit == 0.0 or effort * psi >= 0.0:
        return effort
    return min(max(effort, -p.regeneration_limit), p.regeneration_limit)


@compiled
def torque_share(p: PlantParameters, side: Side, effort: float) -> float:
    """Return the torque as a share of that of the same current in a cold motor with loss-free gears.

    armature_reaction: 1 - c abs(i); the armature's field weakens that of the magnets. A. E. Fitzgerald, C. Kingsley,
    S. D. Umans, Electric Machinery, 6th edition, 2003, section 7.3.
    winding_heat: 1 - c H; the winding's resistance grows with its temperature, which follows i^2 with a first-order
    lag. maxon academy, Formulae Handbook, 2012, thermal behaviour.
    gear_loss: 1 - e sign(i psi); a gearing of efficiency eta passes eta of a driving torque, and takes as much away
    when the load drives the motor: friction in proportion to the load. A. C. Bittencourt, S. Gunnarsson, Static
    friction in a robot joint, Journal of Dynamic Systems, Measurement, and Control 134, 2012, 051013.
    """
    share = 1.0 - p.armature_reaction * abs(effort) - p.winding_heat * side.winding
    if p.gear_loss != 0.0:
        share -= p.gear_loss * math.copysign(1.0, effort) * math.tanh(side.psi / SMOOTH)
    return share


@compiled
def rubbing(p: PlantParameters, s: float, side: Side) -> float:
    """Return the deceleration of one side by friction that depends on its own speed or angle [rad/s^2].

    boundary_lubrication: c sign(psi) exp(-abs(psi) / psi_s), friction that a film of oil takes away at speed. A. Bo,
    D. Pavelescu, The friction-speed relation and its influence on the critical velocity of stick-slip motion, Wear 82,
    1982, 277-289.
    bearing_drag: c sign(psi) abs(psi)^(2/3), the load-free torque of a lubricated rolling bearing. A. Palmgren, Ball
    and Roller Bearing Engineering, 1959.
    brake_drag: c sign(psi) on the left only, a brake that does not come free. R. Limpert, Brake Design and Safety,
    3rd edition, 2011.
    cogging: c sin(6 phi + phase), the pull of magnets on teeth. J. Holtz, L. Springob, Identification and compensation
    of torque ripple in high-precision permanent magnet motor drives, IEEE Transactions on Industrial Electronics 43,
    1996, 309-320.
    """
    deceleration = 0.0
    psi = side.psi
    if p.boundary_lubrication != 0.0:
        fading = math.exp(-abs(psi) / p.boundary_lubrication_speed)
        deceleration += p.boundary_lubrication * math.tanh(psi / SMOOTH) * fading
    if p.bearing_drag != 0.0:
        deceleration += p.bearing_drag * psi * (psi * psi + SMOOTH * SMOOTH) ** (-1.0 / 6.0)
    if p.brake_drag != 0.0 and s > 0.0:
        deceleration += p.brake_drag * math.tanh(psi / SMOOTH)
    if p.cogging != 0.0:
        deceleration += p.cogging * math.sin(COGS * side.phi + p.cogging_phase)
    return deceleration


@compiled
def coupled(p: PlantParameters, left: Side, right: Side) -> float:
    """Return the acceleration of the left side and deceleration of the right one [rad/s^2] due to turning.

    cross_coupling: K2/K3 K1 k (psi_other - psi), a controller that evens out the speeds of both motors.
    J. Borenstein, Y. Koren, Motion control analysis of a mobile robot, Journal of Dynamic Systems, Measurement, and
    Control 109, 1987, 73-79.
    turning_resistance: c tanh(w / w0) against the turn, wheels or tracks that scrub sideways; w by the wheels.
    J. Y. Wong, Theory of Ground Vehicles, 4th edition, 2008, section 6.1.
    mass_ahead: 2 d v w / (r b), the centre of mass d ahead of the axle resists the turn at speed; the radius of
    gyration is taken for b/2. R. Dhaouadi, A. Abu Hatab, Dynamic modelling of differential-drive mobile robots,
    Advances in Robotics and Automation 2, 2013, 107.
    """
    acceleration = p.cross_coupling * p.k1 * p.k2_over_k3 * (right.psi - left.psi)
    w = p.wheel_radius * (right.psi - left.psi) / p.base_width
    if p.turning_resistance != 0.0:
        acceleration += p.turning_resistance * math.tanh(w / p.turning_resistance_rate)
    if p.mass_ahead != 0.0:
        v = 0.5 * p.wheel_radius * (left.psi + right.psi)
        acceleration += 2.0 * p.mass_ahead * v * w / (p.wheel_radius * p.base_width)
    return acceleration


@compiled
def pulled(p: PlantParameters, left: Side, right: Side, body: Body, theta: float) -> float:
    """Return the common acceleration of both sides [rad/s^2].

    mass_ahead: d w^2 / r, the other half of the same coupling (see `coupled`).
    floor_sag: -c (x cos theta + y sin theta), the slope of a floor that sags around the origin; DIN 18202, Tolerances
    in building construction, 2019, says by how much floors may.
    reel_pull: c towards a reel that winds up a tether with a constant force. I. A. D. Nesnas and others, Axel and
    DuAxel rovers for the sustainable exploration of extreme terrains, Journal of Field Robotics 29, 2012, 663-685.
    slosh: m (q^2 z + 2 d q dz/dt) / r of a liquid whose surface swings with q (see `sloshed`).
    """
    acceleration = 0.0
    if p.mass_ahead != 0.0:
        w = p.wheel_radius * (right.psi - left.psi) / p.base_width
        acceleration += p.mass_ahead * w * w / p.wheel_radius
    if p.floor_sag != 0.0:
        acceleration -= p.floor_sag * (body.x * math.cos(theta) + body.y * math.sin(theta))
    if p.reel_pull != 0.0:
        x, y = body.x - p.reel_x, body.y - p.reel_y
        ahead = x * math.cos(theta) + y * math.sin(theta)
        acceleration -= p.reel_pull * ahead / math.sqrt(x * x + y * y + REEL_SOFTNESS * REEL_SOFTNESS)
    if p.slosh != 0.0:
        rate = 2.0 * math.pi * p.slosh_frequency
        acceleration += p.slosh * rate * (rate * body.slosh + 2.0 * p.slosh_damping * body.slosh_rate) / p.wheel_radius
    return acceleration


@compiled
def sloshed(p: PlantParameters, body: Body, acceleration: float, h: float) -> tuple[float, float]:
    """Return the position of the sloshing liquid [m ahead of its rest] and its speed [m/s] after h at this
    acceleration.

    A mass on a spring with damping stands for the first mode: z'' = -q^2 z - 2 d q z' - dv/dt. H. N. Abramson (ed.),
    The Dynamic Behavior of Liquids in Moving Containers, NASA SP-106, 1966, chapter 6.
    """
    if p.slosh == 0.0:
        return 0.0, 0.0
    rate = 2.0 * math.pi * p.slosh_frequency
    speed = body.slosh_rate - h * (
        rate * rate * body.slosh + 2.0 * p.slosh_damping * rate * body.slosh_rate + acceleration
    )
    return body.slosh + h * speed, speed


@compiled
def winding_warmed(p: PlantParameters, side: Side, h: float) -> float:
    """Return the low-pass filtered square of the effort, for the winding's temperature, h later."""
    if p.winding_heat == 0.0:
        return 0.0
    effort = side.u - p.k1 * side.psi
    return effort * effort + (side.winding - effort * effort) * math.exp(-h / p.winding_heat_memory)


@compiled
def tired(p: PlantParameters, before: float, load: float, h: float) -> float:
    """Return the low-pass filtered load of the battery, for its second resistance, h later."""
    if p.battery_relaxation == 0.0:
        return 0.0
    return load + (before - load) * math.exp(-h / p.battery_relaxation_memory)


@compiled
def relaxed_supply(p: PlantParameters, remembered: float) -> float:
    """Return the battery's voltage as a share of that without relaxation: 1 - R q, q with a lag.

    M. Chen, G. A. Rincon-Mora, Accurate electrical battery model capable of predicting runtime and I-V performance,
    IEEE Transactions on Energy Conversion 21, 2006, 504-511.
    """
    return 1.0 - p.battery_relaxation * remembered

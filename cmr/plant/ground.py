"""From the wheels' speeds to the motion over the ground."""

import math

from cmr.plant.beyond_ground import broken_away, carpeted, punctured, scrubbing_width, spun, understeered
from cmr.plant.compiling import compiled
from cmr.plant.parameters import PlantParameters
from cmr.plant.state import Body, Side

FLIP_SPEED = 0.02  # m/s; speed at which a caster that trails the wrong way turns round
FLIP_TIME = 0.5  # s; duration of that
BLOWN_SPEED = 0.05  # m/s; the wind acts fully above it, and not at rest
CAMBER_LENGTH = 1.5  # m from one crest of the floor to the next
LOST_TRACTION = 0.15  # share of its speed over ground that a wheel loses


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
    if p.curvature_slip != 0.0:
        b *= scrubbing_width(p, v_left, v_right)
    w = (v_right - v_left) / b
    # turn_slip: b (1 + k abs(w)), so w (1 + k abs(w)) = (v_right - v_left) / b, solved for w.
    w = 2.0 * w / (1.0 + math.sqrt(1.0 + 4.0 * p.turn_slip * abs(w)))
    return understeered(p, w, 0.5 * (v_left + v_right)) if p.understeer != 0.0 else w


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
    """Return whether the robot is inside the disc of surface_patch."""
    return (x - p.surface_patch_x) ** 2 + (y - p.surface_patch_y) ** 2 < p.surface_patch_radius**2


@compiled
def ground_speed(p: PlantParameters, s: float, side: Side, rolled: float, t: float, h: float) -> float:
    """Return the speed [m/s] of one side over the ground while its wheel turns by `rolled` in h."""
    # traction_loss: for a while, a wheel turns faster than it moves over the ground.
    grip = 1.0 - LOST_TRACTION if side.lost > 0.0 else 1.0
    # longitudinal_slip: ground speed psi - k domega.
    rate = rolled / h - p.longitudinal_slip * side.domega
    speed = rolling_radius(p, s, side.phi - side.gap - 0.5 * rolled) * rate * (1.0 + side.slip) * grip
    return speed * punctured(p, s, t) if p.puncture != 0.0 else speed


@compiled
def trailing(body: Body, v: float, h: float) -> Body:
    """Return the body with its caster after h at forward speed v."""
    caster, flipped, side = body.caster, body.flipped + h, body.flip_side
    if abs(v) > FLIP_SPEED and caster * v <= 0.0:
        if caster != 0.0:
            flipped, side = 0.0, -side
        caster = math.copysign(1.0, v)
    b = body
    return Body(b.x, b.y, b.theta, b.w, b.energy, caster, flipped, side, b.remembered, b.slosh, b.slosh_rate)


@compiled
def pushed(p: PlantParameters, body: Body, v: float) -> float:
    """Return the yaw rate added by floor and caster at forward speed v [rad/s]."""
    w = 0.0
    # caster_flip: a push while the caster turns round; floor_camber: w += k v sin(2 pi y / 1.5 m).
    if body.flipped < FLIP_TIME:
        w += p.caster_flip * body.flip_side * math.sin(math.pi * body.flipped / FLIP_TIME)
    if p.floor_camber != 0.0:
        w += p.floor_camber * v * math.sin(2.0 * math.pi * body.y / CAMBER_LENGTH)
    return w


@compiled
def blown(p: PlantParameters, theta: float, v: float) -> float:
    """Return the sideways speed due to the wind [m/s]."""
    # side_wind: v_y += W sin(direction - theta) while the robot moves.
    if p.side_wind == 0.0:
        return 0.0
    return p.side_wind * math.sin(p.side_wind_direction - theta) * min(1.0, abs(v) / BLOWN_SPEED)


@compiled
def moved(p: PlantParameters, body: Body, v_left: float, v_right: float, inside: bool, t: float, h: float) -> Body:
    """Return the body after h at these ground speeds, by the midpoint rule."""
    v_x = 0.5 * (v_left + v_right)
    body = trailing(body, v_x, h)
    w = yaw_rate(p, v_left, v_right, inside, t) + pushed(p, body, v_x)
    # travel_reduction: v_x (1 - c abs(w) / (1 + s abs(w))).
    if p.travel_reduction_share != 0.0:
        v_x *= max(0.0, 1.0 - p.travel_reduction_share / (1.0 / max(abs(w), 1e-12) + p.travel_reduction_saturation))
    # lateral_skid: v_y = -k v w.
    v_y = -p.lateral_skid * v_x * w + blown(p, body.theta, v_x)
    if p.breakaway_skid != 0.0:
        v_y += broken_away(p, v_x, w)
    along, across = carpeted(p, body.theta, v_x)
    v_x, v_y = v_x * spun(p, body.x, body.y) + along, v_y + across
    cosine, sine = math.cos(body.theta + 0.5 * h * w), math.sin(body.theta + 0.5 * h * w)
    x, y = body.x + h * (v_x * cosine - v_y * sine), body.y + h * (v_x * sine + v_y * cosine)
    b = body
    return Body(
        x, y, b.theta + h * w, w, b.energy, b.caster, b.flipped, b.flip_side, b.remembered, b.slosh, b.slosh_rate
    )

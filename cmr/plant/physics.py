"""The equations of the robot, integrated with second-order steps.

Symbols: u duty, V voltage as a share of full drive, psi wheel speed [rad/s], phi angle turned [rad], a = K2/K3,
r wheel radius, b base width, v forward speed [m/s], w yaw rate [rad/s]; s = +1 on the left and -1 on the right.

Paper: domega = a V - K1 a psi, v = (v_left + v_right) / 2, w = (v_right - v_left) / b with v_i = r psi_i.
"""

import math

import numpy as np

from cmr.plant.beyond_motors import sloshed, tired
from cmr.plant.compiling import compiled, compiled_once
from cmr.plant.ground import ground_speed, moved, on_patch
from cmr.plant.motors import accelerations, dry_friction, load, powered, switched, turned, wanted_duties
from cmr.plant.parameters import Floats, PlantParameters
from cmr.plant.state import COLUMNS, Body, Robot, Side, at_speed, row

LOSS_TIME = 0.4  # s for which a wheel loses traction
LOSING_SPEED = 1.0  # rad/s; slower wheels do not lose traction


@compiled
def wander(value: float, size: float, kept: float, random: np.random.Generator) -> float:
    """Return the next value of an Ornstein-Uhlenbeck process of this standard deviation."""
    if size == 0.0:
        return 0.0
    return wandered(value, size, kept, random.standard_normal())


@compiled
def wandered(value: float, size: float, kept: float, draw: float) -> float:
    """Return the next value of such a process, given a draw from the normal distribution."""
    return kept * value + size * math.sqrt(1.0 - kept * kept) * draw


@compiled
def loaded(p: PlantParameters, body: Body, q: float, speed_up: float, h: float) -> Body:
    """Return the body with its battery after h at the load q, and its liquid after h at this acceleration [m/s^2]."""
    # battery_drift: the energy drawn is the integral of the load q.
    energy, remembered = body.energy + h * q, tired(p, body.remembered, q, h)
    slosh, rate = sloshed(p, body, speed_up, h)
    b = body
    return Body(b.x, b.y, b.theta, b.w, energy, b.caster, b.flipped, b.flip_side, remembered, slosh, rate)


@compiled
def advance(
    p: PlantParameters, left: Side, right: Side, body: Body, wanted: tuple[float, float], t: float, h: float
) -> tuple[Side, Side, Body]:
    """Return the robot at time t + h: wheel speeds by Heun's method, then the pose."""
    inside = on_patch(p, body.x, body.y)
    directions = (left.psi, right.psi)
    first = accelerations(p, left, right, directions, body, body.theta, inside, t)
    powered_left, powered_right = powered(p, left, wanted[0], h), powered(p, right, wanted[1], h)
    ahead_left = at_speed(powered_left, left.psi + h * first[0])
    ahead_right = at_speed(powered_right, right.psi + h * first[1])
    speed_up = 0.5 * p.wheel_radius * (first[0] + first[1])
    body = loaded(p, body, load(p, left.u, right.u, left.psi, right.psi), speed_up, h)
    # Within a step friction keeps its direction; a wheel at rest may start.
    directions = (left.psi or ahead_left.psi, right.psi or ahead_right.psi)
    second = accelerations(p, ahead_left, ahead_right, directions, body, body.theta + h * body.w, inside, t)
    holding = dry_friction(p, 0.0, inside)
    left, rolled_left = turned(powered_left, first[0], second[0], holding, p.backlash, h)
    right, rolled_right = turned(powered_right, first[1], second[1], holding, p.backlash, h)
    v_left, v_right = ground_speed(p, 1.0, left, rolled_left, t, h), ground_speed(p, -1.0, right, rolled_right, t, h)
    return left, right, moved(p, body, v_left, v_right, inside, t, h)


@compiled
def disturbed(
    p: PlantParameters, side: Side, noise: tuple[float, float, float, float], h: float, random: np.random.Generator
) -> Side:
    """Return the side with the noise of its torque and slip, and its traction, h later."""
    torque_noise, torque_time, slip_noise, slip_time = noise
    torque = wander(side.torque, torque_noise, math.exp(-h / torque_time), random)
    slip = wander(side.slip, slip_noise, math.exp(-h / slip_time), random)
    # traction_loss: rate at which a turning wheel begins to lose it.
    lost = max(0.0, side.lost - h)
    if p.traction_loss > 0.0 and abs(side.psi) > LOSING_SPEED and lost == 0.0 and random.random() < p.traction_loss * h:
        lost = LOSS_TIME
    a = side
    return Side(a.ramp, a.u, a.heat, a.psi, a.domega, a.phi, a.gap, torque, slip, lost, a.winding)


@compiled
def disturbed_by(
    p: PlantParameters,
    side: Side,
    noise: tuple[float, float, float, float],
    h: float,
    draws: tuple[float, float, float],
) -> Side:
    """Return the same as `disturbed`, given two draws from the normal and one from the uniform distribution."""
    torque_noise, torque_time, slip_noise, slip_time = noise
    torque = wandered(side.torque, torque_noise, math.exp(-h / torque_time), draws[0])
    slip = wandered(side.slip, slip_noise, math.exp(-h / slip_time), draws[1])
    lost = max(0.0, side.lost - h)
    if p.traction_loss > 0.0 and abs(side.psi) > LOSING_SPEED and lost == 0.0 and draws[2] < p.traction_loss * h:
        lost = LOSS_TIME
    a = side
    return Side(a.ramp, a.u, a.heat, a.psi, a.domega, a.phi, a.gap, torque, slip, lost, a.winding)


@compiled_once
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
    """Simulate from `robot` and return the state at the borders, shape (n + 1, len(COLUMNS)), and the robot then.

    `borders` [s] are n + 1 increasing times, the first that of `robot`; the duties of shape (n,) have reached the
    controller and hold between them. Steps are at most `step` [s]. `noise`: size [rad/s^2] and time [s] of the
    torque's, size [1] and time [s] of the slip's.
    """
    noisy = noise[0] > 0.0 or noise[2] > 0.0 or p.traction_loss > 0.0
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
                left = disturbed(p, left, noise, h, random)
                right = disturbed(p, right, noise, h, random)
        states[span + 1] = row(left, right, body)
        if steps > 1:
            # A body's yaw rate is the mean of its last step; a gyro reads the one at the step's end.
            states[span + 1, -1] += 0.5 * (body.w - before)
    return states, Robot(left, right, body)

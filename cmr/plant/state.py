"""State variables of the robot."""

import math
from typing import NamedTuple

from cmr.plant.compiling import compiled

COLUMNS = ("x", "y", "theta", "psi_left", "psi_right", "domega_left", "domega_right", "phi_left", "phi_right", "w")


class Side(NamedTuple):
    """The motor and the wheels of one side."""

    ramp: float  # duty, after slew_limit
    u: float  # duty, applied to the motor
    heat: float  # duty^2, of the motor
    psi: float  # rad/s
    domega: float  # rad/s^2, mean of the last step
    phi: float  # rad, turned by the shaft since the start
    gap: float  # rad, shaft ahead of the wheel
    torque: float  # rad/s^2, noise
    slip: float  # 1, noise
    lost: float  # s, remaining time with little traction
    winding: float  # duty^2, filtered by the memory of winding_heat


class Body(NamedTuple):
    """The rest of the robot: pose [m, m, rad], yaw rate [rad/s], energy drawn from the battery [s of full load].

    `caster` is its trailing direction: 1 after driving forward, -1 after driving backward, 0 before any. `flipped` [s]
    is the time since it turned round, `flip_side` is 1 or -1, the side over which it did. `remembered` is the battery's
    load with the memory of battery_relaxation. A liquid stands `slosh` [m] ahead of its rest, and moves at
    `slosh_rate`.
    """

    x: float
    y: float
    theta: float
    w: float
    energy: float
    caster: float
    flipped: float
    flip_side: float
    remembered: float
    slosh: float
    slosh_rate: float


class Robot(NamedTuple):
    """The state of the robot between two steps."""

    left: Side
    right: Side
    body: Body


def at_rest(pose: tuple[float, float, float]) -> Robot:
    """Return the robot at rest at this pose."""
    side = Side(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    return Robot(side, side, Body(*pose, 0.0, 0.0, 0.0, math.inf, 1.0, 0.0, 0.0, 0.0))


@compiled
def at_speed(side: Side, psi: float) -> Side:
    """Return the side with another wheel speed."""
    a = side
    return Side(a.ramp, a.u, a.heat, psi, a.domega, a.phi, a.gap, a.torque, a.slip, a.lost, a.winding)


@compiled
def row(left: Side, right: Side, body: Body) -> tuple[float, ...]:
    """Return the state in the order of COLUMNS."""
    pose = (body.x, body.y, body.theta)
    return (*pose, left.psi, right.psi, left.domega, right.domega, left.phi, right.phi, body.w)

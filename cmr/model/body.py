"""From the wheels to the floor: v = r (psi_L + psi_R) / 2 and dtheta/dt = r (psi_R - psi_L) / b.

Both hold for speeds [rad/s] and, over any span of time, for angles turned [rad]. Left is -y, x is forward:
a robot that turns counter-clockwise has the faster wheels on its right.
"""

import numpy as np

from cmr.model.parameters import Number, RobotParameters


def forward(left: Number, right: Number, parameters: RobotParameters) -> Number:
    """Return forward speed [m/s] for wheel speeds, or path length [m] for wheel angles."""
    ahead: Number = parameters.wheel_radius * (left + right) / 2.0
    return ahead


def turn(left: Number, right: Number, parameters: RobotParameters) -> Number:
    """Return yaw rate [rad/s] for wheel speeds, or change of heading [rad] for wheel angles."""
    turned: Number = parameters.wheel_radius * (right - left) / parameters.base_width
    return turned


def wheels(speed: Number, yaw_rate: Number, parameters: RobotParameters) -> tuple[Number, Number]:
    """Return the left and right wheel speeds [rad/s] that give this forward speed [m/s] and yaw rate [rad/s]."""
    difference = yaw_rate * parameters.base_width / 2.0
    return (speed - difference) / parameters.wheel_radius, (speed + difference) / parameters.wheel_radius


def arc(theta: Number, length: Number, angle: Number) -> tuple[Number, Number]:
    """Return the displacement (dx, dy) [m] along an arc of this length [m] that turns the heading by `angle` [rad].

    Exact where the ratio of the two wheel speeds is constant; `theta` is the heading at the start.
    """
    chord = length * np.sinc(angle / (2.0 * np.pi))
    return chord * np.cos(theta + angle / 2.0), chord * np.sin(theta + angle / 2.0)


def wrap(angle: Number) -> Number:
    """Return the angle [rad] in (-pi, pi]."""
    wrapped: Number = np.pi - np.mod(np.pi - angle, 2.0 * np.pi)
    return wrapped

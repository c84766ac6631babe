"""The motor model: domega = (K2/K3) V - K1 (K2/K3) psi, and its exact solution while the duty V stays constant.

Source: Edwards, Gaskell and Olson, AAMAS 2018, equation 1. `psi` is wheel speed [rad/s], `duty` the commanded
fraction of full drive, `time` [s] counts from the moment at which the speed was `psi`.
"""

import numpy as np

from cmr.model.parameters import Number, Numeric, Quantity, RobotParameters


def wheel_acceleration(psi: Number, duty: Number, parameters: RobotParameters) -> Number:
    """Return the wheels' angular acceleration domega [rad/s^2]."""
    acceleration: Number = parameters.k2_over_k3 * (duty - parameters.k1 * psi)
    return acceleration


def wheel_speed_after(psi: Quantity, duty: Quantity, parameters: RobotParameters, time: Quantity) -> Quantity:
    """Return the wheel speed [rad/s] after `time` at constant duty."""
    final_speed = duty / parameters.k1
    speed: Quantity = final_speed + (psi - final_speed) * np.exp(-decay_rate(parameters) * time)
    return speed


def wheel_angle_after(psi: Quantity, duty: Quantity, parameters: RobotParameters, time: Quantity) -> Quantity:
    """Return the angle [rad] through which the wheel turns during `time` at constant duty."""
    final_speed = duty / parameters.k1
    rate = decay_rate(parameters)
    angle: Quantity = final_speed * time - (psi - final_speed) * np.expm1(-rate * time) / rate
    return angle


def decay_rate(parameters: RobotParameters) -> Numeric:
    """Return one over the motor's time constant [1/s]."""
    return parameters.k1 * parameters.k2_over_k3


def duty_for_speed(psi: Number, parameters: RobotParameters) -> Number:
    """Return the duty that holds the wheel speed `psi` [rad/s]."""
    duty: Number = parameters.k1 * psi
    return duty

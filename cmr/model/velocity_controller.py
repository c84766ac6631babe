"""Robots with an internal velocity controller: commands are speeds instead of duties.

Such a robot's wheels follow the commanded speed with a first-order response,

    domega = (speed_scale * wanted - psi) / response_time.

That is the paper's law, domega = (K2/K3) (V - K1 psi), for the duty V = wanted / top_wheel_speed with

    K1 = 1 / (speed_scale * top_wheel_speed)    and    K2/K3 = speed_scale * top_wheel_speed / response_time,

so that one step serves both kinds of robot. A second pole of the response is the effect `electrical_lag`, a delay is
`command_delay`; limits of speed, turn rate and acceleration are `saturation`, `turn_rate_limit`, `slew_limit` (of the
commanded speed) and `current_limit` (of the wheel's own acceleration). What a controller compensates, such as a weak
battery or friction, is not modelled for these robots: `Effect.with_commands`.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeVar

from cmr.model.parameters import ParameterDefinition

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

Q = TypeVar("Q", float, "NDArray[np.float64]")  # a number, or an array of them
CONTROLLER_DEFINITIONS = {
    definition.name: definition
    for definition in (
        ParameterDefinition(
            "response_time", "s", "time constant with which wheels follow the commanded speed", 1e-3, 1e2
        ),
        ParameterDefinition(
            "speed_scale", "-", "wheel speed that is reached, as a share of the commanded one", 1e-2, 1e2, neutral=1.0
        ),
        ParameterDefinition(
            "top_wheel_speed",
            "rad/s",
            "wheel speed at which commands are cut off, and that duty 1 stands for",
            1e-2,
            1e4,
        ),
        ParameterDefinition(
            "command_base_width", "m", "base width by which the robot turns (v, omega) into wheel speeds", 1e-3, 1e2
        ),
    )
}
NEEDED = ("response_time", "top_wheel_speed")  # required for a simulation of the robot


@dataclass(frozen=True)
class VelocityController:
    """Converts commands into wheel speeds, and these into the duties of the model.

    `wheel_radius` and `base_width` [m] are those used by the controller; a base width of 0 means unknown, and only
    wheel speeds can be commanded. `top_wheel_speed` [rad/s] is the largest wheel speed it accepts. Arguments and
    results are numbers, or arrays of any one shape.
    """

    wheel_radius: float
    base_width: float
    top_wheel_speed: float

    def duties(self, left: Q, right: Q) -> tuple[Q, Q]:
        """Return the duties, within [-1, 1], equivalent to commanded wheel speeds [rad/s]."""
        import numpy as np  # parameter files, which name these parameters, are read without NumPy

        top = self.top_wheel_speed
        return np.clip(left / top, -1.0, 1.0), np.clip(right / top, -1.0, 1.0)

    def duties_of_body(self, v: Q, omega: Q) -> tuple[Q, Q]:
        """Return the duties, within [-1, 1], equivalent to a commanded body speed [m/s] and turn rate [rad/s]."""
        return self.duties(*self.wheels_of_body(v, omega))

    def wheels_of_body(self, v: Q, omega: Q) -> tuple[Q, Q]:
        """Return the wheel speeds [rad/s] for a body speed [m/s] and a turn rate [rad/s]."""
        difference = 0.5 * self.base_width * omega
        return (v - difference) / self.wheel_radius, (v + difference) / self.wheel_radius

    def wheel_speeds(self, left: Q, right: Q) -> tuple[Q, Q]:
        """Return the wheel speeds [rad/s] equivalent to duties."""
        return left * self.top_wheel_speed, right * self.top_wheel_speed

    def body_velocity(self, left: Q, right: Q) -> tuple[Q, Q]:
        """Return the body speed [m/s] and turn rate [rad/s] equivalent to duties."""
        rim = self.top_wheel_speed * self.wheel_radius
        return 0.5 * rim * (left + right), rim * (right - left) / self.base_width


def motor_of(values: Mapping[str, float]) -> dict[str, float]:
    """Return k2_over_k3 and k1 of a robot with a controller, from its parameters by name.

    Raises KeyError for a missing one of NEEDED.
    """
    fastest = values.get("speed_scale", 1.0) * values["top_wheel_speed"]
    return {"k2_over_k3": fastest / values["response_time"], "k1": 1.0 / fastest}


def response_of(values: Mapping[str, float], top_wheel_speed: float) -> dict[str, float]:
    """Return response_time [s] and speed_scale of a robot with a controller, from k2_over_k3 and k1 by name."""
    return {
        "response_time": 1.0 / (values["k1"] * values["k2_over_k3"]),
        "speed_scale": 1.0 / (values["k1"] * top_wheel_speed),
    }


def response_stds(
    values: Mapping[str, float], stds: Mapping[str, float], top_wheel_speed: float, correlation: float = 0.0
) -> dict[str, float]:
    """Return the standard deviations of response_time [s] and speed_scale, from values and those of the motor by name.

    `correlation` is that of k2_over_k3 and k1.
    """
    gain, k1 = (stds[name] / values[name] for name in ("k2_over_k3", "k1"))
    shares = {"response_time": math.sqrt(max(gain**2 + k1**2 + 2.0 * correlation * gain * k1, 0.0)), "speed_scale": k1}
    return {name: value * shares[name] for name, value in response_of(values, top_wheel_speed).items()}

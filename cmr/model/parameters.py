"""The numbers of the robot model: names, units, meaning and the range in which they make sense."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple


@dataclass(frozen=True)
class ParameterDefinition:
    """One number of the model. `lower` and `upper` bound what any wheeled robot can have; both are exclusive."""

    name: str
    unit: str
    meaning: str
    lower: float
    upper: float


PARAMETER_DEFINITIONS = (
    ParameterDefinition("wheel_radius", "m", "effective radius of the wheels", 1e-3, 2.0),
    ParameterDefinition("k2_over_k3", "rad/s^2", "wheel acceleration at full duty from rest", 1e-2, 1e5),
    ParameterDefinition("k1", "s/rad", "back-EMF constant: one over the wheel speed at full duty", 1e-5, 1e2),
    ParameterDefinition("base_width", "m", "distance between left and right wheels that explains the turns", 1e-3, 1e2),
)
DEFINITIONS = {definition.name: definition for definition in PARAMETER_DEFINITIONS}


class RobotParameters(NamedTuple):
    """Values of the model's parameters. Each is a number, or an array that broadcasts over robots or candidates."""

    wheel_radius: Any
    k2_over_k3: Any
    k1: Any
    base_width: Any

    @classmethod
    def of(cls, values: Mapping[str, Any]) -> "RobotParameters":
        """Return the parameters from a mapping by name.

        Raises KeyError naming the first that is missing.
        """
        return cls(**{name: values[name] for name in cls._fields})

"""The parameters of the robot model: names, units, meanings and valid ranges."""

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, ClassVar, TypeAlias, TypeVar

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

Quantity: TypeAlias = "float | NDArray[np.float64]"  # a number, or one for each robot or candidate
Numeric: TypeAlias = Any  # either of them; a union would need type checks in every caller
Number = TypeVar("Number", float, "NDArray[np.float64]")  # the same, with the result of the same kind as the argument

# The kinds of parameters of effects; they determine how the diagnosis searches for an effect.
KINDS: Mapping[str, str] = {
    "size": "the consequences of the effect are nearly proportional to it",
    "threshold": "the effect acts on one side of this value only",
    "delay": "delay [s] of commands or readings; it is hardly ever negative",
    "angle": "an angle [rad] of any value",
    "stretch": "relative stretch of positions per squared distance [1/m^2]",
    "acceleration": "a limit of the wheels' acceleration [duty/s], or of the motor current [duty]",
    "yaw_rate": "a limit of the yaw rate [rad/s], above the fastest measured turn",
    "time": "start time of the effect [s]",
    "x": "x of the centre of the disc in which the effect acts [m]",
    "y": "y of the same centre [m]",
    "radius": "radius of that disc [m]",
}


@dataclass(frozen=True)
class ParameterDefinition:
    """One parameter of the model. `lower` and `upper` are bounds for any wheeled robot.

    `neutral` is the value without the effect (None: the paper's own parameters, which must be given), `typical` the
    typical size on a robot with a wheel radius of 4 cm. Parameters that do not switch their effect on and off
    (`switches`), such as a time or a place, have no meaning while the others are neutral. `kind` is one of KINDS. A
    typical size that `grows_with_interval` is for 0.04 s between poses. `model_form_error` is the relative standard
    deviation of an estimate because the model is not exact, and `taken_for` the paper's parameter, in the same unit,
    that is as uncertain, because it explains a part of the effect.
    """

    name: str
    unit: str
    meaning: str
    lower: float
    upper: float
    neutral: float | None = None
    typical: float | None = None
    switches: bool = True
    kind: str = "size"
    grows_with_interval: bool = False
    model_form_error: float = 0.008
    taken_for: str = ""

    @property
    def is_limit(self) -> bool:
        """Whether it limits something: its effect begins below the largest value, which is neutral."""
        return self.neutral in (math.inf, self.upper)

    def is_neutral(self, value: object) -> bool:
        """Return whether the value, or each of an array of values, is the neutral one."""
        if isinstance(value, (int, float)):
            return value == self.neutral
        import numpy as np  # importing it would take half of cmr-driver's start, which needs no arrays

        return bool(np.all(np.asarray(value) == self.neutral))

    def allows(self, value: float) -> bool:
        """Return whether the value lies within the bounds, or is the neutral one."""
        return self.lower <= value <= self.upper or value == self.neutral


PARAMETER_DEFINITIONS = (
    ParameterDefinition("wheel_radius", "m", "effective radius of the wheels", 1e-3, 2.0, model_form_error=0.0),
    ParameterDefinition(
        "k2_over_k3", "rad/s^2", "wheel acceleration at full duty from rest", 1e-2, 1e5, model_form_error=0.0016
    ),
    ParameterDefinition(
        "k1", "s/rad", "back-EMF constant: one over the wheel speed at full duty", 1e-5, 1e2, model_form_error=0.0013
    ),
    ParameterDefinition(
        "base_width",
        "m",
        "distance between left and right wheels that explains the turns",
        1e-3,
        1e2,
        model_form_error=0.0005,
    ),
)
DEFINITIONS = {definition.name: definition for definition in PARAMETER_DEFINITIONS}


@dataclass(frozen=True)
class RobotParameters:
    """Values of the model's parameters. Each is a number, or an array that broadcasts over robots or candidates.

    The first four are the paper's. `effects` maps names of further parameters, as the catalogue defines them, to
    values; missing ones are neutral. Iteration yields the paper's four.
    """

    wheel_radius: Numeric
    k2_over_k3: Numeric
    k1: Numeric
    base_width: Numeric
    effects: Mapping[str, Quantity] = field(default_factory=dict)

    _fields: ClassVar[tuple[str, ...]] = tuple(DEFINITIONS)

    @classmethod
    def of(cls, values: Mapping[str, Numeric]) -> "RobotParameters":
        """Return the parameters from a mapping by name: the paper's, and any of effects.

        Raises KeyError naming the first missing one of the paper's.
        """
        paper = {name: values[name] for name in DEFINITIONS}
        return cls(**paper, effects={name: value for name, value in values.items() if name not in DEFINITIONS})

    @property
    def values(self) -> dict[str, Numeric]:
        """Return all values by name."""
        return {**dict(zip(DEFINITIONS, self, strict=True)), **self.effects}

    def __iter__(self) -> Iterator[Numeric]:
        return iter((self.wheel_radius, self.k2_over_k3, self.k1, self.base_width))

    def _replace(self, **values: Numeric) -> "RobotParameters":
        return replace(self, **values)

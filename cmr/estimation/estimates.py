"""What an estimate is: a value with its standard deviation, never 0 because the model is inexact; or why there is none.

No equation, raster or stamp is exact: by how much sizes of effects are off was measured on logs of a plant that shares
no code with the model (scripts/study_diagnosis).
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from cmr.estimation.candidates import Excitation, is_limit, size
from cmr.model.catalogue import definition
from cmr.model.parameters import DEFINITIONS as PAPER

INTERVAL = 1.96  # standard deviations to either side that hold the truth in 95 % of cases
# How inexact the model is, as a share:
OF_VALUE = 0.008
OF_TYPICAL = 0.012  # of the typical size: robots without the effect seem to have so much of some
# Of the value, instead. How dry friction depends on the speed differs from one motor to the next; what holds a wheel at
# rest fades as the wheel sets off: with one Stribeck exponent or another, it seems up to 20 % smaller. Slip at
# accelerations is found within 5 % where motors run unevenly.
OF_EFFECT = {
    "coulomb_friction": 0.07,
    "static_friction": 0.12,
    "surface_patch_friction": 0.07,
    "longitudinal_slip": 0.05,
}
# The effect in a parameter's own unit whose inexactness it takes over: what holds a wheel fades while it sets off. That
# looks like another motor: of robots held by 11 to 16 % duty, k2_over_k3 was off by 1.1 to 1.4 %.
TAKEN_OVER = {"k2_over_k3": "static_friction"}
# Of the paper's parameters: effects beside them are not exactly as the model has them.
OF_PAPER = {"k2_over_k3": 0.0016, "k1": 0.0013, "base_width": 0.0005}
# Of those that stand for a velocity controller, a second of its response time: what the load does to a wheel lasts as
# long as the controller lets it, and is then no noise that changes from reading to reading.
OF_SLOW_CONTROLLERS = {"k2_over_k3": 0.025, "k1": 0.025}


class EstimationError(Exception):
    """Nothing can be estimated from these data. The text says why and what to do."""


@dataclass(frozen=True)
class Estimate:
    """A parameter's estimated value and standard deviation, in the parameter's unit."""

    value: float
    std: float

    @property
    def interval(self) -> tuple[float, float]:
        """The 95 % interval."""
        return self.value - INTERVAL * self.std, self.value + INTERVAL * self.std


def inexactness(name: str, values: Mapping[str, float], excitation: Excitation) -> float:
    """Return the standard deviation that inexactness adds to a parameter, in its unit.

    `values` are those of the paper's parameters and of the effects that are there.
    """
    value = values[name]
    if name in PAPER:
        response_time = 1.0 / (values["k1"] * values["k2_over_k3"])
        slow = OF_SLOW_CONTROLLERS.get(name, 0.0) * response_time if excitation.controlled else 0.0
        other = TAKEN_OVER.get(name, "")
        taken_over = OF_EFFECT.get(other, 0.0) * values.get(other, 0.0)
        return float(np.hypot(max(OF_PAPER.get(name, 0.0), slow) * value, taken_over))
    parameter = definition(name)
    share = OF_EFFECT.get(name, OF_VALUE)
    grows = parameter.switches and not is_limit(parameter)
    return float(np.hypot(share * value, OF_TYPICAL * size(parameter, excitation) if grows else 0.0))

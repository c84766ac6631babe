"""Estimates: values with standard deviations, which include a term for model-form uncertainty.

Equations, time grid and stamps are not exact. The resulting errors in the sizes of effects were measured on logs of a
plant that shares no code with the model (scripts/study_diagnosis).
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from cmr.estimation.candidates import Excitation, is_limit, size
from cmr.model.catalogue import definition
from cmr.model.parameters import DEFINITIONS as PAPER

INTERVAL = 1.96  # standard deviations on either side of a 95 % interval
# Model-form uncertainty, as a share:
OF_VALUE = 0.008
OF_TYPICAL = 0.012  # of the typical size: robots without an effect appear to have this much of it
# Of the value, instead. The speed dependence of dry friction differs between motors, and static friction fades as the
# wheel starts: depending on the Stribeck exponent, it appears up to 20 % smaller. Slip under acceleration is found
# within 5 % if motors run unevenly.
OF_EFFECT = {
    "coulomb_friction": 0.07,
    "static_friction": 0.12,
    "surface_patch_friction": 0.07,
    "longitudinal_slip": 0.05,
}
# A parameter that inherits the uncertainty of an effect in the same unit: static friction fades while a wheel starts,
# which looks like a different motor. For robots with static friction of 11 to 16 % duty, k2_over_k3 was off by 1.1 to
# 1.4 %.
TAKEN_OVER = {"k2_over_k3": "static_friction"}
# Of the paper's parameters, because effects are not exactly as modelled.
OF_PAPER = {"k2_over_k3": 0.0016, "k1": 0.0013, "base_width": 0.0005}
# For those that represent a velocity controller, per second of its response time: load disturbances last as long as the
# controller needs to correct them, so they are correlated between readings.
OF_SLOW_CONTROLLERS = {"k2_over_k3": 0.025, "k1": 0.025}


class EstimationError(Exception):
    """Nothing can be estimated from these data; the text gives the reason and the remedy."""


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
    """Return the standard deviation that model-form uncertainty adds to a parameter, in its unit.

    `values` are those of the paper's parameters and of the effects present.
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

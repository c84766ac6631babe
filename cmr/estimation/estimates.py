"""Estimates: values with standard deviations, which include a term for model-form uncertainty.

Equations, time grid and stamps are not exact. The resulting errors in the sizes of effects were measured on logs of a
plant that shares no code with the model (scripts/study_diagnosis).
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from cmr.estimation.candidates import Excitation, size
from cmr.model.catalogue import DEFINITIONS, definition
from cmr.model.parameters import DEFINITIONS as PAPER

INTERVAL = 1.96  # standard deviations on either side of a 95 % interval
OF_TYPICAL = 0.012  # model-form uncertainty, of the typical size: robots without an effect seem to have as much
# Of the paper's parameters, if they represent a velocity controller, per second of its response time: load
# disturbances last as long as the controller needs to correct them, so they are correlated between readings.
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


def model_form_std(name: str, values: Mapping[str, float], excitation: Excitation) -> float:
    """Return the standard deviation that model-form uncertainty adds to a parameter, in its unit.

    `values` are those of the paper's parameters and of the effects present.
    """
    value, parameter = values[name], definition(name)
    if name in PAPER:
        response_time = 1.0 / (values["k1"] * values["k2_over_k3"])
        slow = OF_SLOW_CONTROLLERS.get(name, 0.0) * response_time if excitation.controlled else 0.0
        others = [one for one in DEFINITIONS.values() if one.taken_for == name]
        taken_over = sum(one.model_form_error * values.get(one.name, 0.0) for one in others)
        return float(np.hypot(max(parameter.model_form_error, slow) * value, taken_over))
    grows = parameter.switches and not parameter.is_limit
    return float(
        np.hypot(parameter.model_form_error * value, OF_TYPICAL * size(parameter, excitation) if grows else 0.0)
    )

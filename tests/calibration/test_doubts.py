"""A drive at one speed hides what a second one would show: it is said which, also where no parameter is in doubt."""

from collections.abc import Mapping
from types import SimpleNamespace
from typing import Any, cast

import numpy as np

from cmr.calibration.doubts import WIDE, in_doubt
from cmr.estimation.estimates import Estimate

RADIUS = 0.04  # m
TRUE = {"k2_over_k3": 118.0, "k1": 0.054, "base_width": 0.16}
AT_ONE_SPEED = {"k2_over_k3": 0.0144, "k1": 0.0055, "base_width": 0.0022}  # of a messy robot after 60 s at 0.3 m/s
AT_TWO = {"k2_over_k3": 0.0037, "k1": 0.0023, "base_width": 0.0031}  # docs/measurements/calibration.md


def notes(known_to: Mapping[str, float], *speeds: float) -> str:
    """Return the message about a robot whose parameters are known to these shares, as long at each speed [m/s]."""
    way = np.cumsum(np.repeat(speeds, 500) / RADIUS) * 0.02
    observations = SimpleNamespace(wheel=np.column_stack([way, way]), wheel_time=0.02 * np.arange(len(way)))
    predictor = SimpleNamespace(segment=SimpleNamespace(observations=observations))
    found = SimpleNamespace(
        problem=SimpleNamespace(predictors=[predictor]), base=SimpleNamespace(values={"wheel_radius": RADIUS})
    )
    estimation = SimpleNamespace(
        whole=SimpleNamespace(average=None),
        estimates={name: Estimate(TRUE[name], share * TRUE[name]) for name, share in known_to.items()},
        controller=None,
        found=found,
    )
    return " ".join(in_doubt(cast(Any, estimation)))


def test_after_one_speed_it_is_said_which_second_one_would_narrow_what() -> None:
    assert all(AT_ONE_SPEED[name] < WIDE[name] for name in TRUE)
    said = notes(AT_ONE_SPEED, 0.3)
    assert said == (
        "The whole drive is near 0.3 m/s. Half a minute more at 0.8 m/s, in the same drive or in another log, would "
        "narrow k2_over_k3 and k1."
    )


def test_what_a_second_speed_would_not_narrow_is_passed_over() -> None:
    assert notes(AT_TWO, 0.3) == ""
    assert notes(AT_ONE_SPEED, 0.2, 0.5) == ""

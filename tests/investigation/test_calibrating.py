"""Calibration by investigation: averages over explanations have the closed forms of the module."""

from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from cmr.investigation.calibrating import accountable, averaged, is_calibrated
from cmr.investigation.choosing import Evidence, only
from cmr.investigation.separation import BELIEF, Columns

SETS = (
    {"k2_over_k3": 100.0, "k1": 0.05, "base_width": 0.16},
    {"k2_over_k3": 101.0, "k1": 0.05, "base_width": 0.16},
    {"k2_over_k3": 100.0, "k1": 0.0501, "base_width": 0.16},
    {"k2_over_k3": 100.0, "k1": 0.05, "base_width": 0.161},
)


def evidence_with(information: np.ndarray[Any, np.dtype[np.float64]]) -> Evidence:
    """Return what is known with this information of three parameters and one effect."""
    return Evidence(information, Columns(3, {"gyro_scale": (3,)}), SETS)


def judgement_of(values: dict[str, float], share: float) -> Any:
    """Return a judgement in which one effect, with these values, has this probability."""
    names = [SimpleNamespace(name="", values=SETS[0]), SimpleNamespace(name="gyro_scale", values=values)]
    return cast(Any, SimpleNamespace(probabilities={"": 1.0 - share, "gyro_scale": share}, explanations=names))


def test_without_doubt_deviations_are_those_of_the_information() -> None:
    """One over the root of the information, in steps, is the deviation."""
    found = averaged(judgement_of(dict(SETS[0]), 0.0), evidence_with(np.diag([400.0, 100.0, 25.0, 1.0])))
    assert found["k2_over_k3"].std == pytest.approx(1.0 / np.sqrt(BELIEF * 400.0))
    assert found["k1"].std == pytest.approx(1e-4 / np.sqrt(BELIEF * 100.0))
    assert found["base_width"].std == pytest.approx(1e-3 / np.sqrt(BELIEF * 25.0))


def test_explanations_that_differ_widen_the_estimate() -> None:
    """Two explanations of the same probability, 2 apart: the mean lies between, and 1 comes on top of the deviation."""
    apart = {**SETS[0], "k2_over_k3": 102.0}
    found = averaged(judgement_of(apart, 0.5), evidence_with(np.diag([1e8, 1e8, 1e8, 1.0])))
    assert found["k2_over_k3"].value == pytest.approx(101.0)
    assert found["k2_over_k3"].std == pytest.approx(1.0, rel=1e-3)
    assert not is_calibrated({**found, "k2_over_k3": found["k2_over_k3"].__class__(101.0, 2.0)})


def test_well_known_parameters_are_calibrated() -> None:
    """Goals are two deviations of 1 %, 1 % and 3 %."""
    assert is_calibrated(averaged(judgement_of(dict(SETS[0]), 0.0), evidence_with(np.diag([1e6, 1e6, 1e6, 1.0]))))


def test_of_some_effects_alone_is_known_what_is_known_of_them_beside_others() -> None:
    """Their columns, and the values that these stand for, in the order of the names asked for."""
    white = np.random.default_rng(0).standard_normal((30, 6))
    sets = tuple({**SETS[0], "column": float(number)} for number in range(7))
    every = Evidence(white.T @ white, Columns(3, {"slope": (3, 4), "gyro_scale": (5,)}), sets)
    some = only(every, ["gyro_scale"])
    assert some.columns.of == {"gyro_scale": (3,)}
    assert some.seen["gyro_scale"] == pytest.approx(every.seen["gyro_scale"])
    assert [one.get("column") for one in some.sets] == [0.0, 1.0, 2.0, 3.0, 6.0]


def test_an_effect_is_accountable_for_a_parameter_that_varies_with_its_size() -> None:
    """Of the variance of the base width, 0.81 is that of the wheels' size; nothing is due to a size that is certain."""
    names = ("k1", "base_width", "wheel_radius_scale", "gyro_scale", "coulomb_friction")
    covariance = np.diag([1.0, 4.0, 9.0, 1.0, 0.0])
    covariance[1, 2] = covariance[2, 1] = 0.9 * 2.0 * 3.0
    covariance[1, 3] = covariance[3, 1] = 0.5 * 2.0
    average = cast(Any, SimpleNamespace(names=names, covariance=covariance, presence=dict.fromkeys(names[2:], 0.2)))
    assert list(accountable(average, "base_width")) == ["wheel_radius_scale"]
    assert list(accountable(average, "k1")) == []

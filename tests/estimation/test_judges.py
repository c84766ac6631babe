"""What is unlikely must explain more, what a single large error says counts for less, held-out data have a veto."""

from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from cmr.diagnosis.diagnose import diagnose
from cmr.diagnosis.result import NO_EFFECT
from cmr.estimation.candidates import SPREAD, Excitation, size, unlikelihood
from cmr.estimation.noise import Noise, SignalNoise
from cmr.estimation.search.trace import INDISTINCT
from cmr.model.catalogue import definition
from tests.hidden_effects import hidden_recording

USUAL = Excitation({"wheel_radius": 0.04, "k2_over_k3": 118.0, "k1": 0.054, "base_width": 0.16}, turning=1.0)
SCALES = ("wheel_radius_scale", "encoder_scale")


def typical(name: str) -> float:
    return size(definition(name), USUAL)


def test_no_effect_is_not_unlikely_and_a_limit_never_is() -> None:
    assert unlikelihood({}, USUAL) == 0.0
    assert unlikelihood({"motor_gain_asymmetry": 0.0, "saturation": 0.1}, USUAL) == 0.0


@pytest.mark.parametrize("name", ["motor_gain_asymmetry", "coulomb_friction", "gyro_bias"])
def test_an_unusual_size_is_as_unlikely_as_a_normal_error_and_a_rare_effect_more(name: str) -> None:
    for share in (1.0, SPREAD, 2.0 * SPREAD):
        assert unlikelihood({name: share * typical(name)}, USUAL) == pytest.approx((share / SPREAD) ** 2)
    assert unlikelihood({"encoder_asymmetry": typical("encoder_asymmetry")}, USUAL) == pytest.approx(1.0)


def test_sizes_that_make_up_for_each_other_are_both_unlikely() -> None:
    values = {name: 10.0 * typical(name) for name in ("motor_gain_asymmetry", "wheel_radius_asymmetry")}
    assert unlikelihood(values, USUAL) == pytest.approx(2.0 * (10.0 / SPREAD) ** 2)


def test_a_large_error_counts_less_and_all_others_as_before() -> None:
    white = np.random.default_rng(3).standard_normal(2000)
    white[700] = 30.0
    size_before = 0.02
    predictor = cast(Any, SimpleNamespace(times={"psi_left": np.arange(len(white))}))
    errors = cast(Any, SimpleNamespace(of={"psi_left": size_before * white[:, None]}, motion=np.empty((1, 1))))
    noise = Noise({"psi_left": SignalNoise(np.zeros(1), np.zeros(3), (np.full(len(white), size_before),))})
    (sizes,) = noise.with_outliers([predictor], [errors]).of["psi_left"].sizes
    # What is not large has the size of most errors; the square of the large one is cut to 2.5 times it: 30 times 2.5.
    most = np.median(sizes)
    assert most == pytest.approx(size_before, rel=0.05)
    assert (size_before * 30.0 / sizes[700]) ** 2 == pytest.approx(30.0 * 2.5, rel=0.1)
    assert np.mean(sizes > most) == pytest.approx(0.0124, abs=0.01)


@pytest.mark.slow
@pytest.mark.further  # test_awkward_data.py holds recordings out, too
def test_a_recording_held_out_speaks_against_a_name_that_does_not_hold_in_it() -> None:
    """Motors that were unequal in the fitted drive and were mended before the one held out."""
    unequal = hidden_recording("motor_gain_asymmetry", seed=4)
    alike = hidden_recording(seed=4)
    found = diagnose(unequal.recording, held_out=[alike.recording])
    assert found.verdict == NO_EFFECT
    first, *_, last = [one for one in found.decisions if one.effects == ("motor_gain_asymmetry",)]
    assert first.action == "added"
    assert last.reason.startswith("With the named effects, free runs in the held-out recordings are less accurate ")
    assert [one.quantity for one in last.measures] == ["error_ratio"]


@pytest.mark.further  # tests/hidden_effects hides such a clock
@pytest.mark.slow
def test_a_pose_clock_that_runs_fast_is_named_and_no_latency_beside_it() -> None:
    """Its poses are ahead of the wheels, more and more: to shift all of them by the mean makes the first ones late."""
    hidden = hidden_recording("clock_skew", seed=0)
    assert hidden.truth.parameters["clock_skew"] < 0.0
    assert [one.name for one in diagnose(hidden.recording).effects] == ["clock_skew"]


@pytest.mark.further  # exchanges: test_search.py
@pytest.mark.slow
def test_an_effect_that_came_in_an_exchange_has_its_rivals() -> None:
    """An encoder's scale beside unequal wheels: nothing tells it from the radius of both wheels."""
    found, alike = diagnose(hidden_recording("wheel_radius_asymmetry", "encoder_scale", seed=1).recording), set(SCALES)
    (scale,) = [one for one in found.effects if one.name in alike]
    assert {scale.name, *scale.indistinguishable_from} == alike
    (row,) = [one for one in found.decisions if one.action == INDISTINCT and {*one.effects} == alike]
    assert row.statistic < row.threshold

"""A name must improve something on data left out of the fit, and the number that decides is reported."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from cmr.estimation.estimation import estimate, nominal_of
from cmr.estimation.gauss_newton import Fit
from cmr.estimation.usefulness import OF_USE, _largest, _of_readings
from cmr.model.catalogue import CATALOGUE
from cmr.recordings.recording import Recording
from cmr.recordings.signal import Floats
from tests.hidden_effects import hidden_recording
from tests.reference_plant import REALISTIC, Commands, drive

pytestmark = pytest.mark.slow

READINGS, FOLDS = 40, 5
TRUTH = {"k1": 0.054, "base_width": 0.161}  # of the plant, where nothing else is said


def whole_with(outlier: float, other: float) -> tuple[Any, Any, Fit]:
    """Return a fit in which a gyro's bias acts on two readings of different folds only, and the fit without it.

    Without the bias these readings err by `outlier` and `other`, all others by 0.1 or -0.1.
    """
    errors: Floats = 0.1 * (-1.0) ** np.arange(READINGS, dtype=np.float64)
    errors[[0, 1]] = outlier, other
    slopes = np.zeros((READINGS, 1))
    slopes[[0, 1], 0] = -1.0
    bias = 0.5 * (outlier + other)
    noise = cast(Any, None)
    final = Fit({"gyro_bias": bias}, ("gyro_bias",), errors + slopes[:, 0] * bias, slopes, noise)
    predictor = SimpleNamespace(times={"yaw_rate": np.arange(float(READINGS))})
    problem = SimpleNamespace(predictors=(predictor,), folds=np.arange(READINGS) % FOLDS)
    whole = SimpleNamespace(found=SimpleNamespace(problem=problem), final=final)
    effect = SimpleNamespace(candidate=SimpleNamespace(effect=CATALOGUE["gyro_bias"]))
    return whole, effect, Fit({}, (), errors, np.zeros((READINGS, 0)), noise)


def in_one_turn() -> Recording:
    """Return a drive to one side without poses, as a piece that begins and ends in motion."""
    time = np.arange(0.0, 16.0, 0.05)
    commands = Commands(time, np.full(len(time), 0.2), np.full(len(time), 0.4))
    recording = drive(commands, {"gyro_bias": 0.005}, 16.0, REALISTIC, 3).recording
    begin = int(recording.wheels.utime[0])
    piece = recording.between(begin + 3_000_000, begin + 15_000_000)
    return replace(piece, poses=piece.poses.between(0, 0))


def test_what_a_sensor_does_is_judged_on_readings_that_were_left_out_of_the_fit() -> None:
    whole, effect, without_it = whole_with(3.0, 0.0)
    # On the fitted readings the bias reduces the errors, but neither of the two readings predicts the other.
    assert np.linalg.norm(without_it.rest) > OF_USE * np.linalg.norm(whole.final.rest)
    (ratio,) = _of_readings(whole, effect, without_it, whole.final).values()
    assert ratio < 1.0


def test_what_a_sensor_does_in_all_folds_is_of_use() -> None:
    whole, effect, without_it = whole_with(3.0, 2.9)
    ((words, ratio),) = _of_readings(whole, effect, without_it, whole.final).items()
    assert ratio > 5.0
    assert words == "the one-step prediction of the yaw rate"


def test_the_error_that_grows_most_without_an_effect_is_reported_with_the_limit() -> None:
    use = _largest({"the path of free runs": 1.0031, "the yaw rate of free runs": 0.98})
    assert use.measure.value == pytest.approx(1.0031)
    assert use.measure.limit == OF_USE
    assert use.measure.sentence == (
        "Without it no error on left-out data grows by 1 % or more: the largest change is +0.31 %, in the path of free "
        "runs."
    )


def test_where_no_average_is_delivered_what_may_be_hidden_counts_all_the_same() -> None:
    """A steady turn to one side: it shows neither a bias of the gyro, nor unequal wheels, nor what the motors do."""
    recording = in_one_turn()
    estimation = estimate([recording], nominal_of([recording], None), against_nominal=False)
    assert estimation.whole is not None
    assert estimation.whole.average is None, "it predicts worse than the three parameters alone"
    for name in ("k1", "base_width"):
        found = estimation.estimate(name)
        assert abs(found.value - TRUTH[name]) < 2.0 * found.std
        assert found.std > 5.0 * estimation.whole.model.std(name)


@pytest.mark.further  # one more robot, with an effect that two others imitate
def test_a_name_and_its_size_agree_though_two_common_effects_do_the_same() -> None:
    """Encoders that count differently look like unequal motors on unequal wheels, which are likelier beforehand."""
    hidden = hidden_recording("encoder_asymmetry", seed=0)
    estimation = estimate([hidden.recording], nominal_of([hidden.recording], None), against_nominal=False)
    assert [one.candidate.effect.name for one in estimation.found.named] == ["encoder_asymmetry"]
    size = estimation.estimate("encoder_asymmetry")
    assert abs(size.value - hidden.truth.parameters["encoder_asymmetry"]) < 3.0 * size.std < 0.005

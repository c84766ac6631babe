"""A fit asks for errors, and comes to the least sum of squares, alone or with others beside it."""

from collections.abc import Callable, Mapping

import numpy as np
import pytest

from cmr.estimation.candidates import Excitation
from cmr.estimation.checks import looked_at
from cmr.estimation.gauss_newton import Asking, Fit, fitted
from cmr.estimation.noise import Noise
from cmr.estimation.preparation import prepare
from cmr.recordings.signal import Floats
from tests.hidden_effects import hidden_recording

COUNT = 500
NAMES = ("gyro_bias", "gyro_scale")
SCENE = Excitation({"k2_over_k3": 50.0, "k1": 0.05, "wheel_radius": 0.05, "base_width": 0.2}, turning=1.0)
START = {"gyro_bias": 0.02, "gyro_scale": 0.1}
Errors = Callable[[Mapping[str, float]], Floats]


def answered(asking: Asking[Fit], errors: Errors) -> Fit:
    """Answer a fit by a function of the values until it is done."""
    asked = next(asking)
    while True:
        try:
            asked = asking.send(np.stack([errors(values) for values in asked], axis=1))
        except StopIteration as stop:
            result: Fit = stop.value
            return result


def test_a_linear_model_is_fitted_as_by_least_squares() -> None:
    random = np.random.default_rng(1)
    slopes, data = random.standard_normal((COUNT, 2)), 0.03 * random.standard_normal(COUNT)
    fit = answered(
        fitted(START, NAMES, Noise({}), SCENE), lambda values: data - slopes @ [values[name] for name in NAMES]
    )
    exact, *_ = np.linalg.lstsq(slopes, data, rcond=None)
    # The least damping leaves 1e-9 of the way, some 0.1 long.
    assert [fit.values[name] for name in NAMES] == pytest.approx(list(exact), abs=1e-9)
    assert fit.slopes == pytest.approx(-slopes, abs=1e-9)


def test_a_parameter_that_stops_at_its_bound_leaves_the_others_their_best() -> None:
    """No command acts before it is sent: with the delay at 0, the bias is that of least squares without it."""
    random = np.random.default_rng(6)
    bias = random.standard_normal(COUNT)
    slopes = np.stack([bias, bias + 0.5 * random.standard_normal(COUNT)], axis=1)
    data = slopes @ [0.3, -0.2]
    names = ("gyro_bias", "command_delay")
    start = {"gyro_bias": 0.02, "command_delay": 0.05}
    fit = answered(
        fitted(start, names, Noise({}), SCENE), lambda values: data - slopes @ [values[name] for name in names]
    )
    assert fit.values["command_delay"] == 0.0
    # The least damping leaves 1e-9 of the way, some 0.3 long.
    assert fit.values["gyro_bias"] == pytest.approx(float(bias @ data) / float(bias @ bias), abs=1e-9)


def test_a_step_that_goes_too_far_is_shortened() -> None:
    """Where the errors bend, a whole step from the start overshoots; the fit still comes to the lowest point."""
    fit = answered(
        fitted({"gyro_bias": 0.9}, ("gyro_bias",), Noise({}), SCENE),
        lambda values: np.full(COUNT, 10.0 * np.arctan(4.0 * (values["gyro_bias"] - 0.1))),
    )
    assert fit.values["gyro_bias"] == pytest.approx(0.1, abs=1e-3)


def test_a_model_that_holds_on_one_side_only_is_fitted_from_there() -> None:
    """Slopes are taken on the other side where the model makes no sense on the usual one."""

    def errors(values: Mapping[str, float]) -> Floats:
        held = values["gyro_bias"] <= START["gyro_bias"]
        return np.linspace(-1.0, 1.0, COUNT) + (30.0 * (values["gyro_bias"] - 0.01) if held else np.nan)

    fit = answered(fitted(START, ("gyro_bias",), Noise({}), SCENE), errors)
    assert fit.values["gyro_bias"] == pytest.approx(0.01, abs=1e-9)


def test_at_a_kink_the_slope_by_a_latency_is_that_of_both_sides() -> None:
    """Kinks of one sign: their sum of squares is least there, where the slope to either side is not 0."""
    true = 0.0071
    kinks = np.linspace(1.0, 3.0, COUNT)

    def errors(values: Mapping[str, float]) -> Floats:
        return np.asarray(1.0 + kinks * abs(values["gyro_latency"] - true))

    fit = answered(fitted({"gyro_latency": true}, ("gyro_latency",), Noise({}), SCENE), errors)
    assert fit.values["gyro_latency"] == true
    assert fit.slopes == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize(("name", "above"), [("gyro_bias", True), ("gyro_latency", True), ("pose_latency", False)])
def test_beside_latencies_a_model_that_holds_on_one_side_only_is_fitted_from_there(name: str, above: bool) -> None:
    """It holds on one side of where the fit begins: below it, where the least squares are, or above it."""
    random = np.random.default_rng(8)
    names = ("gyro_bias", "gyro_latency", "pose_latency")
    start = {"gyro_bias": 0.02, "gyro_latency": 0.01, "pose_latency": 0.01}
    slopes, data = 1e3 * random.standard_normal((COUNT, 3)), 0.1 * random.standard_normal(COUNT)
    target = {key: value * (0.8 if above else 1.2) for key, value in start.items()}

    def errors(values: Mapping[str, float]) -> Floats:
        holds = values[name] <= start[name] if above else values[name] >= start[name]
        linear = slopes @ [values[key] - target[key] for key in names]
        return data + linear if holds else np.full(COUNT, np.nan)

    fit = answered(fitted(start, names, Noise({}), SCENE), errors)
    exact, *_ = np.linalg.lstsq(slopes, -data, rcond=None)
    found = [fit.values[key] - target[key] for key in names]
    assert found == pytest.approx(list(exact), abs=1e-9)
    assert np.isfinite(fit.slopes).all()


def test_a_time_at_its_bound_is_moved_to_the_one_side_that_there_is() -> None:
    asked: list[float] = []

    def errors(values: Mapping[str, float]) -> Floats:
        asked.append(values["command_delay"])
        return np.full(COUNT, 1.0 + values["command_delay"])

    fit = answered(fitted({"command_delay": 0.0}, ("command_delay",), Noise({}), SCENE), errors)
    assert min(asked) == 0.0 < max(asked)
    assert fit.slopes == pytest.approx(1.0)


@pytest.mark.slow
def test_fits_side_by_side_are_those_in_turn() -> None:
    """What others ask for beside it changes nothing of a fit, if it changes no time grid: these commands are on it."""
    hidden = hidden_recording("gyro_bias", manoeuvre="figure_eight", seed=5)
    assert hidden.recording.parameters is not None
    ready = prepare(looked_at([hidden.recording], []), hidden.recording.parameters)
    assert ready.problem is not None
    assert ready.base is not None
    models = [
        ({**ready.base.values, name: start}, (*ready.base.names, name))
        for name, start in (("gyro_bias", 0.0), ("coulomb_friction", 0.5), ("command_delay", 0.01))
    ]
    together = ready.problem.fits(models, ready.base.noise)
    alone = [ready.problem.fits([model], ready.base.noise)[0] for model in models]
    for one, other in zip(together, alone, strict=True):
        assert one.names == other.names
        assert one.values == pytest.approx(other.values, rel=1e-9)
        assert one.squares == pytest.approx(other.squares, rel=1e-9)

"""Free runs see what they would see of each candidate alone, and say where a search by one-step errors is of no use."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from cmr.estimation import criterion
from cmr.estimation.candidates import lanes_of
from cmr.estimation.checks import looked_at
from cmr.estimation.commanded_speeds import as_duties, as_motor, controller_of
from cmr.estimation.criterion import FURTHER, STRAYING, trusted
from cmr.estimation.estimation import nominal_of
from cmr.estimation.gauss_newton import Fit
from cmr.estimation.preparation import Ready, prepare
from cmr.estimation.problem import Problem
from cmr.estimation.simulation_error import SimulationErrorProblem
from tests.support.speed_commanded import SpeedRobot, driven

SECONDS = 60.0


@pytest.fixture(scope="module")
def ready() -> Ready:
    """Return the drive of a robot with a velocity controller of its own."""
    recording = driven(SpeedRobot(), SECONDS, seed=3)
    nominal = nominal_of([recording], None)
    controller = controller_of([recording], nominal)
    assert controller is not None
    looked = looked_at([as_duties(recording, controller)], ["drive"])
    return prepare(looked, as_motor(nominal, controller))


def problem_of(ready: Ready) -> tuple[Problem, Fit]:
    assert ready.problem is not None
    assert ready.base is not None
    return ready.problem, ready.base


def test_candidates_observed_together_err_as_each_alone(ready: Ready) -> None:
    problem, base = problem_of(ready)
    courses = SimulationErrorProblem(problem.predictors, problem.gains, problem.excitation)
    effects: list[dict[str, float]] = [
        {},
        {"pose_offset": 0.1},
        {"base_width": 1.1 * base.values["base_width"]},
        {"gyro_bias": 0.02, "wheel_radius_asymmetry": 0.01},
        {"command_delay": 0.1, "pose_offset": 0.1},
        {"wheel_speed_latency": 0.02},
        {"slope_x": 3.0},  # how far it drives depends on the heading,
        {"slope_x": 3.0, "base_width": 1.2 * base.values["base_width"]},  # which depends on the base width
    ]
    sets = [{**base.values, **effect} for effect in effects]
    together = courses.joint_errors(lanes_of(sets))
    for number, values in enumerate(sets):
        alone = courses.joint_errors(values)
        for name, of in alone.of.items():
            np.testing.assert_allclose(together.of[name][:, [number]], of, rtol=0.0, atol=1e-9, err_msg=name)


def test_a_step_after_which_the_wheels_stray_ends_a_search(ready: Ready) -> None:
    problem, base = problem_of(ready)
    watch = criterion._Watch(problem, base)
    watch(base)
    twice = replace(base, values={**base.values, "k1": 2.0 * base.values["k1"]})  # wheels half as fast
    with pytest.raises(criterion._AstrayError):
        watch(twice)


@pytest.mark.parametrize("of_use", [False, True])
def test_of_a_long_recording_a_part_is_searched_first(
    ready: Ready, monkeypatch: pytest.MonkeyPatch, of_use: bool
) -> None:
    searched: list[tuple[bool, float]] = []

    def search(problem: Problem, base: Fit, *_others: object) -> object:
        seconds = sum(predictor.segment.observations.seconds for predictor in problem.predictors)
        searched.append((problem.one_step, round(seconds)))
        return SimpleNamespace(problem=problem, final=base)

    monkeypatch.setattr(criterion, "LONG", SECONDS / 2)
    monkeypatch.setattr(criterion, "TRIAL", SECONDS / 4)
    monkeypatch.setattr(criterion, "search", search)
    assert ready.problem is not None
    gains = ready.problem.gains
    monkeypatch.setattr(criterion, "choose_gains", lambda _predictors, _values: gains)
    monkeypatch.setattr(criterion, "trusted", lambda _found, _ready: of_use)
    criterion.search_effects(ready, lambda _sentence: None)
    part, one_step, free_runs = (True, SECONDS / 4), (True, SECONDS), (False, SECONDS)
    assert searched == [part, one_step if of_use else free_runs]


def errors(deviation: float) -> Any:
    """Return errors of free runs in which the body deviates by this much."""
    return SimpleNamespace(median=lambda _name: deviation)


@pytest.mark.parametrize("controlled", [False, True])
@pytest.mark.parametrize(("growth", "straying"), [(0.9 * FURTHER, 0.5), (1.1 * FURTHER, 0.5), (1.0, 1.1)])
def test_a_body_that_deviates_further_speaks_against_velocity_controllers_alone(
    controlled: bool, growth: float, straying: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Wheels that stray do so against any robot; with duties, what turns the body may still be found as a law."""
    monkeypatch.setattr(criterion, "errors_of", lambda *_runs: (errors(1.0), errors(growth)))
    monkeypatch.setattr(criterion, "_straying", lambda *_runs: straying * STRAYING)
    segment = SimpleNamespace(segment=SimpleNamespace(tick=0.0))
    problem = SimpleNamespace(predictors=[segment], excitation=SimpleNamespace(controlled=controlled))
    fit = SimpleNamespace(values={}, names=())
    found = cast(Any, SimpleNamespace(problem=problem, base=fit, final=fit))
    expected = straying < 1.0 and not (controlled and growth > FURTHER)
    assert trusted(found, cast(Any, SimpleNamespace(start={}))) == expected

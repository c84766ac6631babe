"""Where nothing explains what remains, a law extends the model, or a generic term: only if it helps."""

from functools import cache

import pytest

from cmr.diagnosis.diagnose import diagnose
from cmr.diagnosis.result import LAW_FOUND, Diagnosis
from cmr.estimation.checks import looked_at
from cmr.estimation.gain import Gain
from cmr.estimation.gauss_newton import Fit
from cmr.estimation.laws.offers import LEFT
from cmr.estimation.laws.result import LAW
from cmr.estimation.preparation import prepare
from cmr.estimation.problem import Problem
from cmr.estimation.search.criteria import CandidateEffect, SelectedEffect
from cmr.estimation.search.selection import Search
from cmr.estimation.unexplained.extending import BY_A_LAW, extended
from cmr.estimation.unexplained.generic import extension, formula, improves
from cmr.model.catalogue import CATALOGUE
from tests.hidden_effects import HiddenRecording, hidden_recording

pytestmark = pytest.mark.slow

SEED = 3


@cache
def hidden(effect: str) -> HiddenRecording:
    return hidden_recording(*([effect] if effect else []), seed=SEED)


@cache
def prepared(effect: str) -> tuple[Problem, Fit]:
    """A rich drive of a robot with this effect, and the paper's model fitted to it."""
    recording = hidden(effect).recording
    assert recording.parameters is not None
    ready = prepare(looked_at([recording]), recording.parameters)
    assert ready.problem is not None
    assert ready.base is not None
    return ready.problem, ready.base


@cache
def weak_in_reverse() -> Diagnosis:
    """What is found of motors that pull less backward; the gain is measured on another log of the same robot."""
    other = hidden_recording("weak_reverse", seed=SEED, run=1).recording
    return diagnose(hidden("weak_reverse").recording, held_out=[other])


@pytest.mark.further  # test_finds_hidden_laws.py finds others
def test_a_law_extends_the_model_and_another_drive_is_predicted_better() -> None:
    found = weak_in_reverse()
    assert (found.verdict, found.effects, found.laws.answer) == (LAW_FOUND, (), LAW)
    (law,) = found.laws.found
    assert (law.law.place, law.law.side, law.law.formulas) == ("wheel_voltage", "both", ("abs(u)",))
    # u (1 - g) where u < 0 is u (1 - g / 2) + |u| g / 2, and the first of these is a motor as any other.
    half = 0.5 * hidden("weak_reverse").truth.parameters["weak_reverse"]
    (estimate,) = law.estimates.values()
    assert abs(estimate.value - half / (1.0 - half)) < 3.0 * estimate.std
    assert law.held_out > 100.0
    assert law.left < LEFT
    assert found.unexplained.generic is None
    assert found.baseline is not None
    assert found.extended is not None
    assert found.extended.held_out_path_rmse < 0.7 * found.baseline.held_out_path_rmse


@pytest.mark.further  # test_finds_hidden_effects.py has robots without any
def test_a_robot_without_effects_gets_no_term_even_where_one_is_looked_for() -> None:
    assert extension(*prepared("")) is None


@pytest.mark.further  # test_finds_hidden_laws.py weighs names and laws, too
def test_what_only_imitates_is_withdrawn_where_a_law_alone_does_far_better() -> None:
    problem, base = prepared("cubic_motor")
    found = search_that_named("coulomb_friction", problem, base)
    whole = extended(problem, found)
    assert whole.found.named == []
    assert [(tested.effect.name, why) for tested, why in whole.found.others] == [("coulomb_friction", BY_A_LAW)]
    assert whole.laws.names_withdrawn == ("coulomb_friction",)
    (law,) = whole.laws.found
    assert (law.law.place, law.law.formulas) == ("wheel_voltage", ("u ** 3",))
    cubic = hidden("cubic_motor").truth.parameters["cubic_motor"]
    (estimate,) = law.estimates.values()
    assert estimate.value == pytest.approx(cubic / (1.0 - cubic), rel=0.03)


def test_what_is_there_is_not_withdrawn() -> None:
    problem, base = prepared("quadratic_drag")
    found = search_that_named("quadratic_drag", problem, base)
    assert extended(problem, found).found is found


def search_that_named(effect: str, problem: Problem, base: Fit) -> Search:
    """A search of a problem that has named one effect."""
    names = [parameter.name for parameter in CATALOGUE[effect].parameters]
    fit = problem.fit({**base.values, **dict.fromkeys(names, 0.01)}, (*base.names, *names), base.noise)
    tested = CandidateEffect(CATALOGUE[effect], base.squares - fit.squares, fit.values, fit)
    return Search(problem, base, fit, [SelectedEffect(tested, (), base)], [], 1.0, {}, ())


@pytest.mark.parametrize(
    ("psi", "pose", "least", "better"),
    [
        (1.5, 1.2, 1.1, True),
        (1.0, 1.2, 1.1, True),
        (1.0, 1.2, 0.8, False),  # of which nobody can be sure
        (1.5, 0.9, 0.8, False),
        (1.0, 1.0, 0.9, False),
    ],
)
def test_a_term_must_improve_free_runs_and_spoil_none(psi: float, pose: float, least: float, better: bool) -> None:
    assert improves(Gain(ratio=pose, interval=(least, 2.0), signals={"psi": psi, "pose": pose})) is better


def test_a_term_is_told_with_units() -> None:
    values = {"generic_drive_u_cubed": 0.4812, "generic_motion_turn_abs_v": -0.02}
    assert formula(values) == "0.481 times duty^3 in the motor's duty and -0.02 rad/m times abs(v) in the turn rate"

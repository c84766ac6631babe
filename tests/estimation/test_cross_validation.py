"""What an effect explains must hold elsewhere; a drive in which it does not show says nothing against it."""

from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from cmr.estimation import criterion
from cmr.estimation.checks import looked_at
from cmr.estimation.estimation import nominal_of
from cmr.estimation.gauss_newton import Fit
from cmr.estimation.noise import Noise
from cmr.estimation.preparation import prepare
from cmr.estimation.problem import Problem
from cmr.estimation.search import cross_validation
from cmr.estimation.search.criteria import left_out
from cmr.estimation.search.cross_validation import Elsewhere, why_not_elsewhere
from tests.hidden_effects import hidden_recording

SIGNIFICANT = 45.0
FREE_RUNS = cast("Problem", SimpleNamespace(one_step=False, several=True))
FIT = Fit({"base_width": 0.16}, ("base_width",), np.ones(4), np.ones((4, 1)), Noise({}))


def judged(monkeypatch: pytest.MonkeyPatch, by_kind: Elsewhere, in_turn: Elsewhere) -> str:
    """Why an effect is refused that does this where recordings are parted by kind, and dealt out in turn."""
    found = {True: by_kind, False: in_turn}
    monkeypatch.setattr(cross_validation, "elsewhere", lambda *_fits, by_kind=True: found[by_kind])
    return why_not_elsewhere(FREE_RUNS, FIT, FIT, SIGNIFICANT)


HOLDS = Elsewhere((100.0, 100.0), (40.0, 40.0), 0.5, 0.0)
NOT_SHOWN = Elsewhere((200.0, 1.0), (-2.0, -300.0), 0.5, 0.0)  # the other part does not tell its size
HARMFUL = Elsewhere((200.0, 150.0), (87.0, -70.0), 0.5, 0.0)


def test_a_manoeuvre_that_does_not_show_an_effect_is_no_objection(monkeypatch: pytest.MonkeyPatch) -> None:
    assert judged(monkeypatch, NOT_SHOWN, HOLDS) == ""
    assert judged(monkeypatch, NOT_SHOWN, NOT_SHOWN) == "Only a part of the data shows it."


def test_what_one_part_finds_must_not_harm_the_other(monkeypatch: pytest.MonkeyPatch) -> None:
    assert judged(monkeypatch, HARMFUL, HOLDS) == cross_validation.DOES_NOT_HOLD
    spoiling = Elsewhere((200.0, 1.0), (-50.0, 0.0), 0.5, 0.0)
    assert judged(monkeypatch, spoiling, HOLDS) == "Only a part of the data shows it."


def test_a_fit_that_loses_its_way_is_infinitely_bad() -> None:
    lost = Fit(FIT.values, FIT.names, np.array([1.0, np.nan, 1.0, 1.0]), np.full((4, 1), np.nan), FIT.noise)
    assert lost.squares == np.inf
    assert left_out(lost, np.array([0, 0, 1, 1])) == np.inf


def test_sizes_in_free_runs_are_scaled_to_the_robot_found_there(monkeypatch: pytest.MonkeyPatch) -> None:
    recording = hidden_recording("coulomb_friction", seed=4).recording
    ready = prepare(looked_at([recording], ["drive"]), nominal_of([recording], None))
    searched: list[tuple[Problem, Fit]] = []
    monkeypatch.setattr(criterion, "search", lambda problem, base, *_: searched.append((problem, base)))
    monkeypatch.setattr(criterion, "trusted", lambda _found, _ready: False)
    criterion.search_effects(ready, lambda _sentence: None)
    problem, base = searched[-1]
    assert not problem.one_step
    assert problem.excitation.parameters == base.values

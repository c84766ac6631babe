"""The shifts of the effects named add up to what lies between the paper's model and the one fitted with them."""

from typing import Any

import numpy as np
import pytest

from cmr.diagnosis.diagnose import diagnose
from cmr.estimation.estimates import Estimate
from cmr.estimation.gauss_newton import Fit
from cmr.estimation.noise import Noise
from cmr.estimation.problem import Problem
from cmr.estimation.search.criteria import CandidateEffect, SelectedEffect
from cmr.estimation.search.selection import Search
from cmr.estimation.search.shifts import shifts
from cmr.model.catalogue import CATALOGUE
from tests.hidden_effects import hidden_recording
from tests.hidden_effects.cases import BEGINNING

pytestmark = pytest.mark.slow


@pytest.mark.parametrize(
    "hidden",
    [pytest.param(("coulomb_friction", "gyro_bias"), marks=pytest.mark.further), ("coulomb_friction",)],
    ids=lambda hidden: "-".join(hidden),
)
def test_shifts_add_up_to_what_lies_between_baseline_and_extended_model_but_for_what_may_be_hidden(
    hidden: tuple[str, ...],
) -> None:
    found = diagnose(hidden_recording(*hidden, manoeuvre=BEGINNING, seed=1002).recording)
    assert {effect.name for effect in found.effects} == set(hidden)
    assert found.baseline is not None
    assert found.extended is not None
    for name, before in found.baseline.estimates.items():
        together = sum(effect.shift[name] for effect in found.effects)
        after = found.extended.estimates[name]
        assert together == pytest.approx(after.value - before.value, abs=after.std), name
    # Friction slows a robot down as a larger k1 would.
    friction = next(effect for effect in found.effects if effect.name == "coulomb_friction")
    assert friction.shift["k1"] < -0.02 * found.baseline.estimates["k1"].value


class NestedFits(Problem):
    """A problem whose fits tell what they were asked for: `k1` is larger by one with each further parameter."""

    def __init__(self) -> None:
        self.asked: list[tuple[str, ...]] = []

    def fit(self, *asked: Any, **_options: Any) -> Fit:
        self.asked.append(tuple(asked[1]))
        return fit(self.asked[-1])


def fit(names: tuple[str, ...]) -> Fit:
    values = dict.fromkeys(names, 0.0)
    return Fit({**values, "k1": float(len(names))}, names, np.empty(0), np.empty((0, len(names))), Noise({}))


def named(name: str, chance: bool = False) -> SelectedEffect:
    estimates = {name: Estimate(0.1, 0.01)} if chance else {}
    return SelectedEffect(CandidateEffect(CATALOGUE[name], 100.0, {}), (), fit(("k1",)), estimates)


@pytest.mark.parametrize(
    ("order", "expected", "fits"),
    [
        (["gyro_bias"], [1.0], 0),
        (["gyro_bias", "turn_slip", "deadband"], [1.0, 1.0, 1.0], 2),
        (["command_loss", "gyro_bias", "turn_slip"], [0.0, 1.0, 1.0], 1),
        (["gyro_bias", "turn_slip", "command_loss"], [1.0, 1.0, 0.0], 1),
        (["command_loss"], [0.0], 0),
    ],
    ids=lambda value: "-".join(value) if isinstance(value, list) and isinstance(value[0], str) else None,
)
def test_one_fit_for_each_further_effect_and_none_for_effects_of_chance(
    order: list[str], expected: list[float], fits: int
) -> None:
    problem = NestedFits()
    fitted = [name for name in order if name != "command_loss"]
    found = Search(
        problem=problem,
        base=fit(("k1",)),
        final=fit(("k1", *(p.name for name in fitted for p in CATALOGUE[name].parameters))),
        named=[named(name, chance=name == "command_loss") for name in order],
        others=[],
        inflation=1.0,
        extra_stds={},
        unseen=(),
    )
    assert [moved["k1"] for moved in shifts(found)] == expected
    assert len(problem.asked) == fits

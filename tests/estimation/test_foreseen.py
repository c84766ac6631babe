"""What laws explain is foreseen by the transposed recursion: the same products as those of observed traces."""

from collections.abc import Sequence
from functools import cache

import numpy as np
import pytest

from cmr.estimation.checks import looked_at
from cmr.estimation.laws.candidates import Candidate, candidates
from cmr.estimation.laws.foreseen import MOST, VECTORS, Foreseen
from cmr.estimation.laws.linearised import SIDES, Linearised, is_of_wheels, seen_in, shares_of
from cmr.estimation.laws.rest import Rest, rest_of
from cmr.estimation.laws.scan import scan
from cmr.estimation.laws.searching import SHOWN
from cmr.estimation.preparation import prepare
from cmr.estimation.unexplained.traces import DISTURBED
from cmr.parameters.file import ParameterFile, Value
from cmr.recordings.signal import Floats
from tests.hidden_effects.hiding import hidden_recording
from tests.hidden_effects.pieces import in_pieces
from tests.support.lanes import further

pytestmark = pytest.mark.slow

NOMINAL = ParameterFile(0, {"wheel_radius": Value(0.04)})
ROUNDING = 1e-10  # of the largest product: some ten thousand terms of either sign are added up


@cache
def left(kind: str, seconds: float | None) -> tuple[Linearised, Rest]:
    """The paper's model of a robot that hides something, and what it leaves; a drive may be cut into pieces."""
    recording = hidden_recording(kind, seed=1).recording
    recording = recording if seconds is None else in_pieces(recording, seconds)
    ready = prepare(looked_at([recording]), NOMINAL)
    assert ready.problem is not None
    assert ready.base is not None
    model = Linearised.about(ready.problem, ready.base.values, ready.base.names)
    noise = ready.problem.found(ready.problem.errors(ready.base.values))
    return model, rest_of(model, noise)


def written(law: Candidate) -> tuple[object, ...]:
    return law.key, tuple(law.constants.items())


def product(model: Linearised, pulled: Sequence[Floats], law: Candidate, side: int) -> float:
    """Return the product of a law's traces and the first vector, on one side of what has two, else -1."""
    act = shares_of(law.place, model.values)[max(side, 0)]
    of = {name: [one[:, DISTURBED.index(name), 0] for one in pulled] for name in act}
    courses = [model.course(k, side, law.factors, law.constants) for k in range(len(pulled))]
    return sum(share * float(courses[k] @ of[name][k]) for name, share in act.items() for k in range(len(pulled)))


@pytest.mark.parametrize("seconds", [None, 6.0])
def test_products_are_those_of_the_traces_that_are_observed(seconds: float | None) -> None:
    model, rest = left("weak_reverse", seconds)
    pulled = Foreseen(model, rest).pulled
    for place in dict.fromkeys(law.place for law in candidates()):
        laws = [model.sized(law) for law in candidates() if law.place == place and len(law.formulas) == 1][::40]
        signals, sides = seen_in(place), (0, 1) if is_of_wheels(place) else (-1,)
        observed = rest.white[rest.rows(signals)] @ model.white_traces(laws, rest.noise, signals)
        foreseen = [product(model, pulled, law, side) for law in laws for side in sides]
        assert foreseen == pytest.approx(observed, abs=ROUNDING * np.abs(observed).max()), place


@pytest.mark.parametrize("kind", [*further("weak_reverse"), "torque_ripple"])
def test_laws_that_are_observed_are_the_best(kind: str) -> None:
    model, rest = left(kind, None)
    chosen = Foreseen(model, rest).promising(candidates())
    assert len(chosen) == MOST
    some = {(law.key, tuple(law.constants.items())) for law in chosen}
    for one in scan(model, rest)[:SHOWN]:
        law = one.candidate.on("") if one.candidate.side else one.candidate
        assert (law.key, tuple(law.constants.items())) in some


def test_what_is_expected_of_the_best_laws_is_what_they_explain() -> None:
    """With V vectors of signs, the square of what a law does is known to a share of sqrt(2 / V)."""
    model, rest = left("weak_reverse", None)
    observed = {written(one.candidate): one.gain for one in scan(model, rest)[:SHOWN]}
    expected = Foreseen(model, rest).expected(candidates())
    ratios = []
    for law, gains in zip(expected.laws, expected.gains, strict=True):
        for side, gain in zip(SIDES if is_of_wheels(law.place) else ("",), gains, strict=False):
            real = observed.get(written(law.on(side)))
            ratios += [gain / real] if real else []
    assert len(ratios) == SHOWN
    deviation = np.sqrt(2.0 / VECTORS)
    assert np.all(np.abs(np.log(ratios)) < 4.0 * deviation)
    assert abs(np.median(np.log(ratios))) < 2.0 * deviation


def test_few_laws_are_all_observed() -> None:
    model, rest = left("torque_ripple", None)
    few: list[Candidate] = list(candidates()[:MOST])
    assert Foreseen(model, rest).promising(few) == few

"""What counts as unexplained: only what remains with and without the effects that are too small to be named."""

from types import SimpleNamespace
from typing import Any

import pytest

from cmr.estimation.laws.proposing import Proposal
from cmr.estimation.laws.result import Laws
from cmr.estimation.search.selection import Search
from cmr.estimation.search.trace import ADDED, REMOVED, Decision
from cmr.estimation.unexplained import extending
from cmr.estimation.unexplained.result import Unexplained

ONE_STEP: Any = SimpleNamespace(one_step=True)
PRESENT = Unexplained(present=True, signal="heading", regressors=("acceleration",), share=0.4)


@pytest.mark.parametrize(
    ("with_small", "without", "expected"),
    [(PRESENT, Unexplained(), False), (Unexplained(), PRESENT, False), (PRESENT, PRESENT, True)],
    ids=["left by small effects that balance each other", "explained by small effects", "left by both"],
)
def test_what_is_unexplained_remains_with_and_without_small_effects(
    monkeypatch: pytest.MonkeyPatch, with_small: Unexplained, without: Unexplained, expected: bool
) -> None:
    fit, final = object(), object()
    found: Any = SimpleNamespace(problem=ONE_STEP, base=None, final=final, named=[])
    left = {id(fit): with_small, id(final): without}
    monkeypatch.setattr(extending, "with_small_effects", lambda _found: fit)
    monkeypatch.setattr(extending, "remaining", lambda _study, of, _base: SimpleNamespace(unexplained=left[id(of)]))
    monkeypatch.setattr(extending, "extension", lambda _study, _fit: None)
    monkeypatch.setattr(extending, "proposed", lambda *_all: Proposal(Laws()))
    assert extending.extended(found.problem, found).unexplained.present == expected


def test_names_withdrawn_for_a_generic_term_stand_in_the_decisions_of_the_search(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    candidate = SimpleNamespace(effect=SimpleNamespace(name="slope"), drop=71.0)
    named: Any = [SimpleNamespace(candidate=candidate)]
    added = Decision(0, ADDED, ("slope",), 71.0, 30.0, "It explains most.")
    nothing: Any = None
    found = Search(nothing, nothing, nothing, named, [], 1.0, {}, (), (added,))
    term: Any = SimpleNamespace(names=("generic",))
    monkeypatch.setattr(extending, "_unexplained", lambda _found: PRESENT)
    monkeypatch.setattr(extending, "extension", lambda _problem, _fit: term)
    monkeypatch.setattr(extending, "proposed", lambda *_all: Proposal(Laws()))
    monkeypatch.setattr(extending, "_makes_up_for", lambda *_all: True)
    monkeypatch.setattr(extending, "remaining", lambda *_all: SimpleNamespace(unexplained=PRESENT))
    first, last = extending.extended(ONE_STEP, found).found.decisions
    assert first == added
    assert (last.action, last.effects, last.statistic, last.reason) == (REMOVED, ("slope",), 71.0, extending.WITHDRAWN)

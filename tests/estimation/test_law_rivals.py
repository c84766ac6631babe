"""Names, names and a law, and a law alone are rivals: which of them is believed, and which names stay."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from cmr.estimation.gain import Gain
from cmr.estimation.laws import proposing, rivals
from cmr.estimation.laws.candidates import Candidate
from cmr.estimation.laws.offers import Refused
from cmr.estimation.laws.result import NO_LAW, TIE, Laws
from cmr.estimation.laws.rivals import Rivalry, against_both, against_names, still_needed
from cmr.estimation.laws.standing import forget
from cmr.estimation.search.criteria import THRESHOLD
from cmr.estimation.search.selection import Search
from cmr.estimation.unexplained import extending
from cmr.model.catalogue import CATALOGUE, LAWS, learn, unlearn
from cmr.model.laws.law import Law

LAW = Candidate("yaw_rate", ("abs(v)", "w"), 2)
GAIN = 1000.0


def fit(names: int, quality: float) -> Any:
    """A model with so many parameters that leaves so much of -2 log likelihood."""
    return SimpleNamespace(model=SimpleNamespace(names=("",) * names), quality=lambda: quality)


def alone(quality: float, *, approximate: bool = False) -> Any:
    """A law beside the three parameters of the paper, which without it leaves GAIN more."""
    after, before = fit(3, quality), fit(3, quality + GAIN)
    return SimpleNamespace(
        before=before, after=after, laws=(LAW,), gain=GAIN, held_out=0.5 * GAIN, approximate=approximate
    )


def data(held_out: float) -> Any:
    """Data on which nothing was fitted, where -2 log likelihood drops by so much."""
    return SimpleNamespace(
        fitted=np.ones(20_000, np.bool_),
        problem=SimpleNamespace(effects=range(45)),
        held_out=lambda _before, _after: held_out,
    )


@pytest.mark.parametrize(
    ("effects", "better_by", "held_out", "expected"),
    [
        (2, 100.0, 50.0, Rivalry.BETTER),
        (2, 100.0, 5.0, Rivalry.TIED),  # not better where nothing was fitted
        (3, 100.0, 5.0, Rivalry.BETTER),  # many effects are no simpler answer,
        (3, 100.0, -5.0, Rivalry.TIED),  # but no worse one where they explain more
        (2, -20.0, -10.0, Rivalry.TIED),
        (2, 100.0, -60.0, Rivalry.TIED),  # better on one part by more than it is worse on the other
        (2, -200.0, -10.0, Rivalry.WORSE),
        (2, -20.0, -100.0, Rivalry.WORSE),
        (1, 100.0, 50.0, Rivalry.BETTER),
        (1, -20.0, -10.0, Rivalry.WORSE),  # one name is the simpler answer
    ],
)
def test_a_law_alone_is_weighed_against_names(
    effects: int, better_by: float, held_out: float, expected: Rivalry
) -> None:
    names = fit(3 + effects, better_by)
    assert against_names(data(held_out), alone(0.0), names, effects) is expected


@pytest.mark.parametrize(
    ("both_explain", "approximate", "expected"),
    [
        (1.05 * GAIN, False, Rivalry.BETTER),  # names and a law are hardly better
        (1.2 * GAIN, False, Rivalry.WORSE),
        (1.05 * GAIN, True, Rivalry.WORSE),  # and beside the names the law is the right one
    ],
)
def test_names_and_a_law_must_be_clearly_better_than_a_law(
    both_explain: float, approximate: bool, expected: Rivalry
) -> None:
    law = alone(0.0, approximate=approximate)
    both: Any = SimpleNamespace(after=fit(4, GAIN - both_explain), approximate=False)
    assert against_both(data(0.0), law, both) is expected


@pytest.mark.parametrize(
    ("gain", "beside", "without", "needed"),
    [
        (100.0, 2.0 * THRESHOLD, 100.0 * THRESHOLD, True),
        (100.0, 0.1 * THRESHOLD, 0.1 * THRESHOLD, False),
        # Little beside what a strong law explains:
        (1e4, 2.0 * THRESHOLD, 2.0 * THRESHOLD, True),  # it never had to do with the law,
        (1e4, 2.0 * THRESHOLD, 40.0 * THRESHOLD, False),  # or it stood for the law, and is its remains.
    ],
)
def test_names_that_explain_something_beside_the_law_are_needed(
    gain: float, beside: float, without: float, needed: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    law: Any = SimpleNamespace(
        after=SimpleNamespace(model="with it", rest=None, noise=None, mask=None),
        before=SimpleNamespace(model="without it"),
        gain=gain,
    )
    gains = {"with it": beside, "without it": without}
    monkeypatch.setattr(rivals, "rest_of", lambda *_all: None)
    monkeypatch.setattr(
        rivals,
        "known_beside",
        lambda model, *_all, among: SimpleNamespace(gains=dict.fromkeys(among, gains[model])),
    )
    found: Any = SimpleNamespace(named=[named("gyro_bias")])
    assert still_needed(law, found) == (["gyro_bias"] if needed else [])


def test_only_the_names_that_are_not_needed_are_withdrawn() -> None:
    nothing: Any = None
    both: Any = [named("gyro_bias"), named("slope")]
    found = Search(nothing, nothing, nothing, both, [], 1.0, {"k1": 0.1}, (), ())
    final: Any = object()
    left = extending._without_names(nothing, found, extending.BY_A_LAW, ["slope"], final)
    assert [one.candidate.effect.name for one in left.named] == ["gyro_bias"]
    assert [(one.effect.name, why) for one, why in left.others] == [("slope", extending.BY_A_LAW)]
    assert left.final is final
    assert left.extra_stds == {"k1": 0.1}


def test_a_law_of_what_was_recorded_stands_if_no_commands_seem_lost_beside_it(monkeypatch: pytest.MonkeyPatch) -> None:
    recorded: Any = SimpleNamespace(one_step=True)
    cleaned: Any = SimpleNamespace(one_step=True)
    times = SimpleNamespace(times={"yaw_rate": np.empty(0)})
    cleaned.predictors = [times]
    tried: list[Any] = []
    extension: Any = SimpleNamespace(fit=None)

    def instead(alone: Any, *_all: Any) -> Any:
        tried.append(alone)
        return proposing.Proposal(Laws(), extension, problem=alone)

    beside = SimpleNamespace(best=1000.0, offer=lambda *_all: None)
    monkeypatch.setattr(proposing, "beside_names", lambda *_all: beside)
    monkeypatch.setattr(proposing, "effects_of", lambda _found: ["one", "another"])
    monkeypatch.setattr(proposing, "without_names", lambda given, *_all: given)
    monkeypatch.setattr(proposing, "_instead_of_names", instead)
    by_chance = SimpleNamespace(estimates={"command_loss": 0.1})
    found: Any = SimpleNamespace(problem=cleaned, named=[by_chance])
    for lost, expected in ((None, recorded), (object(), cleaned)):
        tried.clear()
        monkeypatch.setattr(proposing, "chance_on_commands", lambda *_all, lost=lost: lost)
        assert proposing.proposed(recorded, found, (), True).problem is expected
        assert tried == ([recorded] if lost is None else [recorded, cleaned])


def test_where_no_formula_holds_what_was_seen_is_handed_on() -> None:
    seen: Any = object()
    nothing: Any = None
    proposal = proposing._answered(nothing, Refused("It does not hold.", seen=seen), nothing, ())
    assert proposal.laws.answer == NO_LAW
    assert proposal.laws.reasons == ("It does not hold.",)
    assert proposal.seen is seen


@pytest.mark.parametrize(
    ("names", "held_out", "largest_ratio", "answer"),
    [
        ([], 500.0, 1.02, TIE),
        (["backlash"], 500.0, 1.02, NO_LAW),  # the effect's own shape may be what is not quite right
        ([], 50.0, 1.02, NO_LAW),  # nor is it sure from moment to moment
        ([], 500.0, 0.95, NO_LAW),  # paths are surely worse
    ],
)
def test_a_formula_that_holds_from_moment_to_moment_alone_is_a_tie(
    monkeypatch: pytest.MonkeyPatch, names: list[str], held_out: float, largest_ratio: float, answer: str
) -> None:
    gain = Gain(ratio=0.7, interval=(0.5, largest_ratio), signals={"pose": 0.7})
    standing = SimpleNamespace(laws=(), fit=None, forget=lambda: None)
    monkeypatch.setattr(proposing, "stood", lambda *_all: standing)
    monkeypatch.setattr(proposing, "measure", lambda *_all: SimpleNamespace(gain=gain))
    monkeypatch.setattr(proposing, "is_seen", lambda *_all: True)
    monkeypatch.setattr(proposing, "_rival", lambda one: one)
    beside: Any = SimpleNamespace(data=None, fit=None, problem=SimpleNamespace(predictors=(), one_step=True))
    offer: Any = SimpleNamespace(laws=(LAW,), held_out=held_out, before=None, after="fit", settled="fit", alike=())
    found: Any = SimpleNamespace(named=names, inflation=1.0)
    proposal = proposing._in_the_model(beside, offer, found, (), ())
    assert proposal.laws.answer == answer
    assert proposal.laws.rivals == (("fit",) if answer == TIE else ())
    assert proposal.extension is None


def test_formulas_that_cannot_be_told_apart_are_a_tie_of_all_of_them(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(proposing, "_rival", lambda one: one)
    several: Any = ("v", "w", "v * w")
    nothing: Any = None
    refused = Refused("It does not distinguish them.", several=True, rivals=several)
    proposal = proposing._answered(nothing, refused, nothing, ())
    assert proposal.laws.answer == TIE
    assert proposal.laws.rivals == several
    assert proposal.laws.found == ()
    assert proposal.laws.manoeuvre == proposing.MANOEUVRE


def named(effect: str) -> Any:
    """An effect that a search named."""
    return SimpleNamespace(candidate=SimpleNamespace(effect=SimpleNamespace(name=effect), drop=70.0), estimates={})


def test_a_law_that_was_only_tried_leaves_the_catalogue_and_one_known_before_stays() -> None:
    tried, kept = (Law(f"law_{name}", "forward_speed", (formula,)) for name, formula in (("a", "v"), ("b", "abs(w)")))
    try:
        learn(kept)
        known = set(LAWS)
        learn(tried)
        forget((tried, kept), known)
        assert set(LAWS) == known
        assert kept.name in CATALOGUE
    finally:
        unlearn(kept.name)

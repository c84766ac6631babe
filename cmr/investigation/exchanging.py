"""Withdraw names: effects found one by one stay only while no other set explains the data better.

Greedy naming mistakes unequal gain and unequal back-EMF for one asymmetry of torque, and slip for two latencies. So
each effect found is tested again at every decision: against the model without it, and against exchanges of up to two
effects for up to two others (`cmr.estimation.search.exchange`).
"""

from collections.abc import Mapping
from dataclasses import dataclass

from cmr.estimation.search.criteria import CandidateEffect, SelectedEffect
from cmr.estimation.search.exchange import best_exchange, penalty_of
from cmr.investigation.judging import Judgement, penalty
from cmr.model.catalogue import CATALOGUE

SURELY = 60.0  # evidence, to first order, from which an effect needs no fit without it


@dataclass(frozen=True)
class Revision:
    """Another set of effects `names` that explains the data better by the evidence `lead`, and the start of its fit."""

    names: tuple[str, ...]
    lead: float
    values: Mapping[str, float]


def evidence_beside(judgement: Judgement) -> dict[str, float]:
    """Return the evidence of each effect found, beside all others found, by name: the loss of the model without it.

    The others are fitted again to first order; if that is not decisive, in full.
    """
    problem, base = judgement.problem, judgement.base
    others = problem.without(base, [[CATALOGUE[name]] for name in judgement.named])
    squares = {name: one.squares for name, one in zip(judgement.named, others, strict=True)}
    unsure = [
        (name, one)
        for name, one in zip(judgement.named, others, strict=True)
        if squares[name] - base.squares < SURELY + penalty(name, problem)
    ]
    fits = problem.fits([(one.values, one.names) for _, one in unsure], base.noise)
    squares |= {name: fit.squares for (name, _), fit in zip(unsure, fits, strict=True)}
    return {name: one - base.squares - penalty(name, problem) for name, one in squares.items()}


def revision(judgement: Judgement, beside: Mapping[str, float]) -> Revision | None:
    """Return the set of effects that explains the data better than those found; None if none does.

    `beside` is the evidence of each effect beside the others: the one with the least leaves if it is not needed.
    """
    least = min(beside, key=lambda name: beside[name])
    if beside[least] < 0.0:
        kept = tuple(name for name in judgement.named if name != least)
        own = {parameter.name for parameter in CATALOGUE[least].parameters}
        values = {name: value for name, value in judgement.base.values.items() if name not in own}
        return Revision(kept, -beside[least], values)
    base, inflation = judgement.base, judgement.screening.inflation
    named = [SelectedEffect(CandidateEffect(CATALOGUE[name], 0.0, base.values), (), base) for name in judgement.named]
    found = best_exchange(judgement.problem, base, judgement.screening, named, inflation)
    if found is None:
        return None
    kept = tuple(name for name in judgement.named if name not in found.leaving)
    lead = base.squares - found.fit.squares - penalty_of(found.leaving, found.coming, inflation)
    return Revision((*kept, *found.coming), lead, found.fit.values)

"""Of several effects that explain the data equally well, choose the one to name."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from cmr.estimation.candidates import rarity, unlikelihood
from cmr.estimation.gauss_newton import Fit
from cmr.estimation.problem import Problem
from cmr.estimation.search.criteria import CandidateEffect, needed, why_not
from cmr.estimation.search.cross_validation import alternatives, elsewhere
from cmr.estimation.search.inflation import Inflation
from cmr.estimation.search.ranking import judged
from cmr.model.catalogue import CATALOGUE

EQUAL = 3.0  # log-likelihood by which effects must differ to be distinguished,
CONVERGED = 1e-4  # and this share of what they explain: fits stop slightly before the optimum


@dataclass(frozen=True)
class Tie:
    """The effect to be named, and all that explain the same, itself included."""

    named: CandidateEffect
    alike: tuple[CandidateEffect, ...]


def decided(
    problem: Problem,
    current: Fit,
    chosen: CandidateEffect,
    close: Sequence[CandidateEffect],
    inflation: Inflation,
) -> Tie:
    """Choose between the effect that explains most and valid ones `close` to it that explain the same.

    If the data do not distinguish them, the simplest is named: one that neither chooses a place nor is rare. Among
    several it is the one with the least unusual size, then the first in the catalogue. A rare effect must explain more,
    in proportion to its rarity. In free runs, left-out errors count as well as fitted ones.
    """
    if problem.one_step:
        holding = [one for one in close if one.fit and not why_not(problem, current, one, inflation)]
    else:
        holding = [one for one, why in (judged(problem, current, one, inflation) for one in close) if not why]
    alike = [chosen, *(one for one in holding if alternatives(current, chosen.fit, one.fit))]
    if len(alike) == 1:
        return Tie(chosen, (chosen,))
    gains = [_gain(problem, current, one) - 0.5 * rarity(one.effect.name) for one in alike]
    order = list(CATALOGUE)
    margin = EQUAL + CONVERGED * chosen.drop
    equals = [one for one, gain in zip(alike, gains, strict=True) if gain > max(gains) - margin]

    def unusual(one: CandidateEffect) -> tuple[float, float, int]:
        name = one.effect.name
        return needed(one.effect), unlikelihood(one.values, problem.excitation), order.index(name)

    return Tie(min(equals, key=unusual), tuple(alike))


def _gain(problem: Problem, current: Fit, one: CandidateEffect) -> float:
    """Return the log-likelihood gained by an effect; in free runs, including left-out parts."""
    if problem.one_step:
        return 0.5 * one.drop
    return 0.5 * one.drop + elsewhere(problem, current, one.fit).gain if one.fit else -np.inf

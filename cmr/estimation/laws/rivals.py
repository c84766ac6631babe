"""Compare rival hypotheses: effects, effects and a law, or a law alone.

A law alone is preferred to effects unless effects with a law explain clearly more, because one formula replaces several
effects that only imitate it together. Effects that still explain something beside it stay.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum

import numpy as np

from cmr.estimation.gauss_newton import Fit
from cmr.estimation.laws.known import known_beside
from cmr.estimation.laws.linearised import Linearised
from cmr.estimation.laws.offers import Data, Offer, Refused
from cmr.estimation.laws.refining import Refined
from cmr.estimation.laws.rest import rest_of
from cmr.estimation.laws.scan import penalty
from cmr.estimation.laws.searching import (
    ALONE,
    ANOTHER,
    LEAST,
    OF_NAMES,
    PROMISING,
    SET,
    SHARE_OF_SET,
    Scanned,
    offered_of,
    scanned,
)
from cmr.estimation.noise import Noise
from cmr.estimation.problem import Problem
from cmr.estimation.search.criteria import THRESHOLD, CandidateEffect, SelectedEffect
from cmr.estimation.search.selection import Search, small_effects, with_small_effects

# Shares of the effects' gain that a law alone must reach in their place: to first order to be fitted at all, and after
# its first fit, for further fits to be tried.
WORTH, WORTH_FITTED = 0.3, 0.5
APART = 0.5  # share of an effect's gain without a law that it keeps beside a law with which it is not confused
BY_CHANCE = 3.0  # times the margin of a tie: a tied law may be worse by as much on held-out data
MANY = 3  # effects replaced by a law: if one formula does it, their higher total likelihood is no surprise


class Rivalry(Enum):
    """The result of comparing a law alone with effects."""

    BETTER = "better"
    TIED = "as good"
    WORSE = "worse"


@dataclass(frozen=True)
class Hypothesis:
    """A model that laws may extend: its data, the scores of laws beside it, and the fit to extend.

    `explained` is the gain of its effects. `problem` is the one of `fit`.
    """

    data: Data
    first: Scanned | Refused
    problem: Problem
    fit: Fit
    explained: float

    @property
    def best(self) -> float:
        """The best score of a law to first order."""
        return self.first.best if isinstance(self.first, Scanned) else -math.inf

    def is_worth_it(self, effects: Sequence[CandidateEffect]) -> bool:
        """Return whether the best law may replace effects: it explains a sufficient share of their gain.

        Both to first order, because noise estimated without them hides part of either.
        """
        if not isinstance(self.first, Scanned) or not self.first.scores:
            return False
        gains = self.first.catalogue.effects.gains
        return self.first.scores[0].gain >= WORTH * sum(gains.get(one.effect.name, 0.0) for one in effects)

    @property
    def selected(self) -> tuple[str, ...]:
        """The effects in the model."""
        return self.first.selected if isinstance(self.first, Scanned) else ()

    @property
    def before(self) -> Refined | None:
        """The model without a law; None if no law is identifiable."""
        return self.first.before

    def offer(self, promising: float = PROMISING) -> Offer | Refused:
        """Return the accepted law beside the model, or why there is none; it must be `promising` to first order."""
        if isinstance(self.first, Refused):
            return self.first
        return offered_of(self.first, self.explained, promising)

    def offer_instead(self, names: Refined) -> Offer | Refused:
        """Return the best law that may replace effects, of which `names` is the fit, or why there is none.

        Its score may be anything: the effects show that structure exists, and the law must be better than they are.
        """
        if isinstance(self.first, Refused):
            return self.first
        worth = WORTH_FITTED * (self.first.before.quality() - names.quality())
        return offered_of(self.first, self.explained, least=-math.inf, worth=worth)


def fitted_of(found: Search) -> list[CandidateEffect]:
    """Return the effects that a search named and fitted."""
    return [one.candidate for one in found.named if not one.estimates]


def effects_of(found: Search) -> list[CandidateEffect]:
    """Return the effects that a search fitted: those named, and those too small to be named."""
    return [*fitted_of(found), *small_effects(found)]


def by_chance(found: Search) -> list[SelectedEffect]:
    """Return the named effects without a fitted parameter: random ones, and those read off the data."""
    return [one for one in found.named if one.estimates]


def beside_names(found: Search, other: Problem | None) -> Hypothesis:
    """Return the model with all effects found, including those too small to be named."""
    fit = with_small_effects(found)
    names = [one.candidate.effect.name for one in found.named] + [one.effect.name for one in small_effects(found)]
    of_chance = sum(max(one.candidate.drop, 0.0) for one in by_chance(found))
    explained = max(0.0, found.base.squares - found.final.squares) + of_chance
    return _hypothesis(found.problem, fit, found.final, names, explained, other)


def without_names(problem: Problem, found: Search, beside: Hypothesis) -> Hypothesis:
    """Return the paper's model, of the recordings or, if random effects were removed from the data, of the rest.

    Laws are scored with the noise beside all names, as in `beside`. With neither law nor names in the model, the noise
    would absorb the structure that a law is to explain.
    """
    base = found.base
    if by_chance(found) and problem is found.problem:
        base = problem.fit(base.values, base.names, found.final.noise, renew=1)
    noise = beside.before.noise if beside.before else None
    return _hypothesis(problem, base, base, (), 0.0, beside.data.other, noise)


def with_needed_names(problem: Problem, found: Search, needed: Sequence[str], other: Problem | None) -> Hypothesis:
    """Return the model of a problem with some of the named effects."""
    leaving = [one.effect for one in fitted_of(found) if one.effect.name not in needed]
    (fit,) = found.problem.without(found.final, [leaving])
    if problem is not found.problem:
        fit = problem.fit(fit.values, fit.names, fit.noise, renew=1)
    explained = max(0.0, found.base.squares - fit.squares)
    return _hypothesis(problem, fit, fit, needed, explained, other)


def _hypothesis(
    problem: Problem,
    about: Fit,
    fit: Fit,
    names: Sequence[str],
    explained: float,
    other: Problem | None,
    noise: Noise | None = None,
) -> Hypothesis:
    """Return the model of a fit, linearised about the fit `about`.

    Laws are judged by one-step errors: for a model fitted by free runs, those of the body given the measured wheels.
    """
    judging, about = problem.one_step_of(about)
    model = Linearised.about(judging, about.values, about.names)
    data = Data.of(judging, model, other)
    return Hypothesis(data, scanned(data, model, names, noise), problem, fit, explained)


def against_names(data: Data, alone: Offer, names: Refined, effects: int) -> Rivalry:
    """Compare a law alone with `effects` effects, on the fitted data and on held-out data.

    Both are penalised for their parameters and for selection among many. They are tied if all data together leave them
    close, as one part of the data may prefer either by chance. A single effect is never tied: it describes the same as
    the law and is the simpler answer.
    """
    samples = int(np.count_nonzero(data.fitted))
    spared = (len(names.model.names) - len(alone.after.model.names)) * math.log(samples)
    spared += 2.0 * effects * math.log(len(data.problem.effects))
    more = names.quality() - alone.after.quality() + spared - sum(penalty(law, samples) for law in alone.laws)
    held_out = data.held_out(names, alone.after)
    if more > LEAST and held_out > (LEAST if effects < MANY else 0.0):
        return Rivalry.BETTER
    near = max(SET, SHARE_OF_SET * (alone.gain + alone.held_out))
    bearable = BY_CHANCE * max(SET, SHARE_OF_SET * alone.held_out)
    return Rivalry.TIED if effects > 1 and more + held_out > -near and held_out > -bearable else Rivalry.WORSE


def against_both(data: Data, alone: Offer, both: Offer) -> Rivalry:
    """Compare a law alone with effects and a law."""
    explained = alone.before.quality() - both.after.quality()
    as_well = data.held_out(both.after, alone.after) > -ALONE * alone.held_out
    margin = 0.0 if alone.approximate and not both.approximate else ALONE
    return Rivalry.BETTER if explained < (1.0 + margin) * alone.gain and as_well else Rivalry.WORSE


def leaves_nothing(alone: Offer) -> bool:
    """Return whether no effect can improve a law alone."""
    return alone.left < ANOTHER and not alone.approximate


def still_needed(alone: Offer, found: Search) -> list[str]:
    """Return the named effects that explain something beside laws fitted without them.

    That is a share of the laws' gain, or most of their own gain without the laws: then they are unrelated to the laws,
    as a gyro's bias is unrelated to a gear.
    """
    names = [one.effect.name for one in fitted_of(found)]
    if not names:
        return []
    after, bare = alone.after, alone.before.model
    gains = known_beside(after.model, after.rest, (), among=names).gains
    without = known_beside(bare, rest_of(bare, after.noise, after.mask), (), among=names).gains
    least = {name: max(THRESHOLD, min(OF_NAMES * alone.gain, APART * without.get(name, math.inf))) for name in names}
    return [name for name in names if gains.get(name, 0.0) > least[name]]

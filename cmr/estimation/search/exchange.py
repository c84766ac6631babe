"""Exchange effects: remove up to two selected effects and add up to two others, if that explains the data better.

Adding one effect at a time fails if effects imitate each other: unequal gain and unequal back-EMF are first taken for
one asymmetry, two asymmetries may each need the other, and slip may be taken for two latencies. The screening provides
the products of the traces of all effects (linear.py). They give the sum of squares after any exchange, to first order,
without another run of the model: for added trials A,

    S_A = S_left - pull_A' N_A^-1 pull_A

with S_left that of the model without the removed effects, pull_A and N_A the trials' products with the residuals and
with each other, beside the remaining parameters. The best exchanges are then fitted; one is made if

    S(exchange) + penalty < S - BETTER inflation.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import SupportsIndex

import numpy as np

from cmr.estimation.candidates import Trial, rarity
from cmr.estimation.gauss_newton import Fit, moved
from cmr.estimation.problem import Problem
from cmr.estimation.search.criteria import (
    CLEARLY,
    PER_FURTHER,
    TOO_SMALL,
    CandidateEffect,
    SelectedEffect,
    held_out_gain,
    needed,
    why_not,
)
from cmr.estimation.search.inflation import Inflation
from cmr.estimation.search.linear import Left
from cmr.estimation.search.placement import placed
from cmr.estimation.search.screening import MOST_OF_A_LIMIT, Score, Screening, one_sided, start_of
from cmr.model.catalogue import CATALOGUE, definition

OWN = 1e-4  # of a trace's square that must be orthogonal to the traces it is combined with
BEST_PAIRS = 60  # per set of removed effects
LARGEST_SHARE = 5.0  # of the typical size: beyond it first order is invalid
# By how much the predicted score may be worse than the current one, as first order is inexact; number of fits.
WORSE_BY_ONE, FITTED_BY_ONE = 60.0, 6  # of exchanges that add one effect
WORSE_BY_TWO, FITTED_BY_TWO = 10.0, 3  # that add two
FITTED_INSTEAD = 2  # of exchanges that replace an effect known from data sheets
WORSE_QUICKLY = 15.0  # by how much a quick fit may be worse
SURELY_MORE = 0.02  # of the drop of an effect in data sheets that the exchange that adds it must explain
BETTER = 2.0  # by which the score must fall; less is a tie


@dataclass(frozen=True)
class _Proposal:
    """An exchange to first order: effects removed; trials added, by number, with shares of their sizes.

    `score` is the sum of squares, with a penalty for the effects.
    """

    leaving: tuple[str, ...]
    trials: tuple[int, ...]
    shares: tuple[float, ...]
    score: float


@dataclass(frozen=True)
class Exchange:
    """An exchange that explains the data better: effects removed, effects added, and the fit."""

    leaving: tuple[str, ...]
    selected: tuple[SelectedEffect, ...]
    fit: Fit

    @property
    def coming(self) -> list[str]:
        """The names of the added effects."""
        return [one.candidate.effect.name for one in self.selected]


def best_exchange(
    problem: Problem, current: Fit, screening: Screening, named: Sequence[SelectedEffect], inflation: Inflation
) -> Exchange | None:
    """Return the best exchange with possible effects, None if none explains the data better."""
    selected = [one.candidate.effect.name for one in named]
    proposals = _proposals(screening, current, selected, inflation)
    starts = _quickly_fitted(problem, current, screening, proposals)
    penalties = [penalty_of(one.leaving, _coming(screening, one), inflation) for one in proposals]
    promising = [
        number
        for number, (_, squares) in enumerate(starts)
        if squares + penalties[number] < current.squares + WORSE_QUICKLY
    ]
    fits = problem.fits([(starts[n][0], _names(current, screening, proposals[n])) for n in promising], current.noise)
    found = sorted(zip(fits, promising, strict=True), key=lambda one: one[0].squares + penalties[one[1]])
    for fit, number in found:
        if fit.squares + penalties[number] > current.squares - BETTER * inflation.all:
            return None
        leaving, coming = proposals[number].leaving, _coming(screening, proposals[number])
        candidates = candidates_of(problem, fit, coming, inflation)
        if possible_together(problem, current, candidates, inflation) and not too_rare(
            current, fit, leaving, candidates
        ):
            exchange = Exchange(leaving, tuple(SelectedEffect(one, (), current) for one in candidates), fit)
            return without_idle_swaps(problem, current, exchange, inflation)
    return None


def possible_together(
    problem: Problem, current: Fit, candidates: Sequence[CandidateEffect], inflation: Inflation
) -> bool:
    """Return whether there is no objection to the effects except that they may be too small to be named."""
    return all(why_not(problem, current, one, inflation) in ("", TOO_SMALL) for one in candidates)


def too_rare(current: Fit, fit: Fit, leaving: Sequence[str], candidates: Sequence[CandidateEffect]) -> bool:
    """Return whether a rare effect would replace another for too little gain: with friction, fits differ by chance.

    It may replace several effects that it makes redundant.
    """
    gained = current.squares - fit.squares
    rare = [one for one in candidates if one.effect.in_data_sheets]
    return bool(leaving) and len(candidates) >= len(leaving) and any(gained < SURELY_MORE * one.drop for one in rare)


def without_idle_swaps(problem: Problem, current: Fit, exchange: Exchange, inflation: Inflation) -> Exchange:
    """Return the exchange, or a smaller one without one of its swaps, if that is as good.

    Otherwise that swap would also get credit for the gain of the other added effects.
    """
    if len(exchange.coming) < 2:
        return exchange
    swaps = [
        (tuple(name for name in exchange.leaving if name != stays), [name for name in exchange.coming if name != goes])
        for stays in exchange.leaving
        for goes in exchange.coming
    ]
    fits = problem.fits([_swapped(problem, current, exchange, *swap) for swap in swaps], current.noise)
    scores = [fit.squares + penalty_of(*swap, inflation) for fit, swap in zip(fits, swaps, strict=True)]
    for number in np.argsort(scores):
        leaving, coming = swaps[number]
        if scores[number] > exchange.fit.squares + penalty_of(exchange.leaving, exchange.coming, inflation):
            break
        candidates = candidates_of(problem, fits[number], coming, inflation)
        if possible_together(problem, current, candidates, inflation):
            selected = tuple(SelectedEffect(one, (), current) for one in candidates)
            return without_idle_swaps(problem, current, Exchange(leaving, selected, fits[number]), inflation)
    return exchange


def _swapped(
    problem: Problem, current: Fit, exchange: Exchange, leaving: Sequence[str], coming: Sequence[str]
) -> tuple[dict[str, float], tuple[str, ...]]:
    """Return the start of an exchange's fit, from two known fits, and its free parameters."""
    gone = {parameter.name for name in leaving for parameter in CATALOGUE[name].parameters}
    own = [parameter.name for name in coming for parameter in CATALOGUE[name].parameters]
    values = problem.excitation.without(current.values, gone)
    names = tuple(name for name in current.names if name not in gone)
    return {**values, **{name: exchange.fit.values[name] for name in own}}, (*names, *own)


def _quickly_fitted(
    problem: Problem, current: Fit, screening: Screening, proposals: Sequence[_Proposal]
) -> list[tuple[dict[str, float], float]]:
    """Return values and sum of squares of each exchange, with the slopes of the remaining parameters taken from the
    current fit.
    """
    result: list[tuple[dict[str, float], float]] = [({}, np.inf)] * len(proposals)
    for leaving in dict.fromkeys(one.leaving for one in proposals):
        base = problem.without(current, [[CATALOGUE[name] for name in leaving]])[0] if leaving else current
        numbers = [number for number, one in enumerate(proposals) if one.leaving == leaving]
        starts = [_start(problem, current, base.names, screening, proposals[number]) for number in numbers]
        own = [
            [p.name for name in _coming(screening, proposals[n]) for p in CATALOGUE[name].parameters] for n in numbers
        ]
        for number, found in zip(numbers, problem.fit_beside(base, starts, own), strict=True):
            result[number] = found
    return result


def penalty_of(leaving: Sequence[str], coming: Sequence[str], inflation: Inflation) -> float:
    """Return the required additional drop of the effects added over those removed.

    Each further effect must explain as much as one that is added by itself: thousands of exchanges are compared. A
    simpler model may explain a little less (Schwarz, Annals of Statistics 6, 1978).
    """
    parameters = sum(len(CATALOGUE[name].parameters) for name in coming)
    parameters -= sum(len(CATALOGUE[name].parameters) for name in leaving)
    further = len(coming) - len(leaving)
    rare = inflation.all * (sum(map(rarity, coming)) - sum(map(rarity, leaving)))
    if further <= 0:
        return PER_FURTHER * parameters + rare
    enough = sorted((needed(CATALOGUE[name]) - rarity(name)) * inflation.of(name) for name in coming)
    return float(sum(enough[-further:])) + rare


def _coming(screening: Screening, one: _Proposal) -> list[str]:
    return list(dict.fromkeys(screening.trials[number].effect for number in one.trials))


def candidates_of(problem: Problem, fit: Fit, names: Sequence[str], inflation: Inflation) -> list[CandidateEffect]:
    """Return effects of a fit, by name, as candidates, each beside all others of the fit.

    If an effect is clearly needed, first order is sufficient for the fit without it.
    """
    effects = [CATALOGUE[name] for name in names]
    without = problem.without(fit, [[effect] for effect in effects]) if effects else []
    unsure = [
        number
        for number, (effect, other) in enumerate(zip(effects, without, strict=True))
        if not np.isfinite(other.squares)
        or other.squares - fit.squares < CLEARLY * needed(effect) * inflation.of(effect.name)
    ]
    refits = problem.fits([(without[number].values, without[number].names) for number in unsure], fit.noise)
    for number, refit in zip(unsure, refits, strict=True):
        without[number] = refit
    return [
        CandidateEffect(effect, other.squares - fit.squares, fit.values, fit, held_out_gain(problem, other, fit))
        for effect, other in zip(effects, without, strict=True)
    ]


def _start(
    problem: Problem, current: Fit, stay: Sequence[str], screening: Screening, one: _Proposal
) -> dict[str, float]:
    """Return the start values of an exchange's fit; parameters that `stay` are moved to first order."""
    own = {parameter.name for name in one.leaving for parameter in CATALOGUE[name].parameters}
    result = problem.excitation.without(current.values, own)
    result = moved(result, stay, screening.linear.step(stay, one.leaving, one.trials, one.shares))
    for number, share in zip(one.trials, one.shares, strict=True):
        trial = screening.trials[number]
        start = start_of(Score(trial, 0.0, share))
        start = dict(placed(problem, CATALOGUE[trial.effect], {**result, **start}, current.noise))
        for parameter in CATALOGUE[trial.effect].parameters:
            # Two trials of one effect change different parameters.
            neutral = trial.origin.get(parameter.name, parameter.neutral)
            if start[parameter.name] != neutral or parameter.name not in result:
                result[parameter.name] = start[parameter.name]
    return result


def _names(current: Fit, screening: Screening, one: _Proposal) -> tuple[str, ...]:
    """Return the free parameters in the fit of an exchange."""
    own = {parameter.name for name in one.leaving for parameter in CATALOGUE[name].parameters}
    coming = [parameter.name for name in _coming(screening, one) for parameter in CATALOGUE[name].parameters]
    return (*(name for name in current.names if name not in own), *coming)


def _proposals(screening: Screening, current: Fit, selected: Sequence[str], inflation: Inflation) -> list[_Proposal]:
    """Return the most promising exchanges, the best first: one for each set of effects."""
    found: dict[tuple[frozenset[str], frozenset[str]], _Proposal] = {}
    for leaving in _subsets(selected):
        own = {parameter.name for name in leaving for parameter in CATALOGUE[name].parameters}
        left = screening.linear.beside([name for name in current.names if name not in own], leaving)
        for one in (*_singles(screening, left, leaving, inflation), *_pairs(screening, left, leaving, inflation)):
            key = frozenset(leaving), frozenset(_coming(screening, one))
            if key not in found or one.score < found[key].score:
                found[key] = one
    ranked = sorted(found.values(), key=lambda one: one.score)
    by_one = [one for one in ranked if len(one.trials) == 1 and one.score < current.squares + WORSE_BY_ONE]
    by_two = [one for one in ranked if len(one.trials) == 2 and one.score < current.squares + WORSE_BY_TWO]
    # An encoder scale error is exactly equivalent to a different wheel size, which is more likely. But if it explains
    # much, first order is wrong by thousands.
    instead = [one for one in ranked if len(one.trials) == 1 and len(one.leaving) == 1 and one not in by_one]
    rare = [one for one in instead if CATALOGUE[one.leaving[0]].in_data_sheets]
    return [*by_one[:FITTED_BY_ONE], *rare[:FITTED_INSTEAD], *by_two[:FITTED_BY_TWO]]


def _subsets(selected: Sequence[str]) -> Iterator[tuple[str, ...]]:
    yield ()
    yield from ((name,) for name in selected)
    yield from combinations(selected, 2)


def _singles(screening: Screening, left: Left, leaving: tuple[str, ...], inflation: Inflation) -> Iterator[_Proposal]:
    """Yield exchanges in which one trial replaces some effects."""
    sizes = np.diag(left.normal)
    for number in np.flatnonzero(sizes > OWN * screening.linear.sizes) if leaving else ():
        share = float(-left.pulls[number] / sizes[number])
        if possible(screening, number, share):
            squares = left.squares + share * float(left.pulls[number])
            score = squares + penalty_of(leaving, [screening.trials[number].effect], inflation)
            yield _Proposal(leaving, (int(number),), (share,), score)


def _pairs(screening: Screening, left: Left, leaving: tuple[str, ...], inflation: Inflation) -> Iterator[_Proposal]:
    """Yield exchanges that add two trials."""
    normal, pulls, sizes = left.normal, left.pulls, np.diag(left.normal)
    own = np.flatnonzero(sizes > OWN * screening.linear.sizes)
    first, second = (own[index] for index in np.triu_indices(len(own), 1))
    determinant = sizes[first] * sizes[second] - normal[first, second] ** 2
    independent = determinant > OWN * sizes[first] * sizes[second]
    first, second, determinant = first[independent], second[independent], determinant[independent]
    share = -(sizes[second] * pulls[first] - normal[first, second] * pulls[second]) / determinant
    other = -(sizes[first] * pulls[second] - normal[first, second] * pulls[first]) / determinant
    squares = left.squares + share * pulls[first] + other * pulls[second]
    # Most pairs explain too little whatever their penalty, and are skipped as a whole.
    for index in np.argsort(squares)[:BEST_PAIRS]:
        numbers, shares = (int(first[index]), int(second[index])), (float(share[index]), float(other[index]))
        parts = zip(numbers, shares, strict=True)
        effects = sorted({screening.trials[number].effect for number in numbers})
        if _compatible(screening, numbers) and all(possible(screening, *part) for part in parts):
            yield _Proposal(leaving, numbers, shares, float(squares[index]) + penalty_of(leaving, effects, inflation))


def possible(screening: Screening, number: SupportsIndex, share: float) -> bool:
    """Return whether a trial may be added with this share of its size."""
    trial = screening.trials[number]
    if trial.threshold:
        return 0.0 < share < MOST_OF_A_LIMIT
    return abs(share) < LARGEST_SHARE / trial.portion and (share > 0.0 or not one_sided(trial))


def _compatible(screening: Screening, numbers: tuple[int, ...]) -> bool:
    """Return whether two trials are of different effects, or of different parameters of one."""
    switched = [_switched(screening.trials[number]) for number in numbers]
    return not switched[0] & switched[1]


def _switched(trial: Trial) -> set[str]:
    """Return the parameters by which a trial switches its effect on, or changes it."""
    known = [definition(name) for name in trial.values]
    changed = [one for one in known if trial.values[one.name] != trial.origin.get(one.name, one.neutral)]
    return {one.name for one in changed if one.switches}

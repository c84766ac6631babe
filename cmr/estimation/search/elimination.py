"""Backward elimination: remove effects that are redundant or too small, refine the values, and order the effects.

First, effects that are too small to be named are removed together, except those that matter in free runs on left-out
data (`_matters`). For each remaining effect k, with S the sum of squares of the model and S_k that without k,

    D_k = S_k - S

must pass criteria.py again beside all others. Of those that fail, the one with the least D_k relative to its required
drop is removed, and the rest is judged again. S_k is taken to first order if it exceeds CLEARLY times the required
drop, else fitted.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from cmr.estimation.candidates import rarity, seen_later
from cmr.estimation.gauss_newton import Fit
from cmr.estimation.problem import Problem
from cmr.estimation.search.criteria import (
    CLEARLY,
    MUCH_BETTER,
    TOO_SMALL,
    CandidateEffect,
    SelectedEffect,
    held_out_gain,
    measured,
    nearly_large,
    needed,
    too_small,
    why_not,
)
from cmr.estimation.search.cross_validation import elsewhere
from cmr.estimation.search.inflation import Inflation
from cmr.estimation.search.profile import made_sure
from cmr.estimation.search.trace import Measure
from cmr.model.parameters import DEFINITIONS as PAPER


@dataclass(frozen=True)
class Finished:
    """The selected effects, each judged beside all others, and the final fit with additional standard deviations.

    `dropped` are the removed effects, with reasons.
    """

    named: list[SelectedEffect]
    dropped: list[tuple[CandidateEffect, str]]
    final: Fit
    extra_stds: Mapping[str, float]


def finished(problem: Problem, named: Sequence[SelectedEffect], current: Fit, inflation: Inflation) -> Finished:
    """Finish a search with the selected effects `named` and `current` as its last fit.

    If effects too small to be named are omitted, others compensate for them and may appear insignificant. An effect
    that is significant beside the small ones is kept.
    """
    standing, small, final = _without_small(problem, named, current)
    dropped = [(tested, TOO_SMALL) for tested in small]
    beside_small = current if small and problem.one_step else None
    extra_stds: dict[str, float] = {}
    for one in standing:
        final, doubt = made_sure(problem, final, one.candidate.effect)
        extra_stds.update(doubt)
    while standing:
        alone = len(standing) == 1 and not dropped
        standing = [_at(final, standing[0])] if alone else _beside_the_others(problem, standing, final, inflation)
        failing = _failing(problem, standing, inflation)
        if beside_small and failing:
            for number in _standing_again(problem, standing, list(failing), beside_small, inflation):
                del failing[number]
        if not failing:
            break
        number = min(failing, key=lambda n: standing[n].candidate.drop - _least(standing[n], inflation))
        worst, why = standing[number], failing[number]
        dropped.append((measured(problem, worst.before, worst.candidate, inflation, why), why))
        standing = [one for one in standing if one is not worst]
        final = worst.before
        if beside_small:
            beside_small = problem.fit(*without(problem, beside_small, [worst]), beside_small.noise, renew=0)
    of_fit = problem.extra_stds(final).items()
    both = {name: float(np.hypot(std, extra_stds.get(name, 0.0))) for name, std in of_fit}
    return Finished(standing, dropped, final, {**extra_stds, **both})


def _failing(problem: Problem, standing: Sequence[SelectedEffect], inflation: Inflation) -> dict[int, str]:
    """Return why effects fail, by number, except those that are only too small."""
    reasons = [why_not(problem, one.before, one.candidate, inflation) for one in standing]
    return {number: why for number, why in enumerate(reasons) if why not in ("", TOO_SMALL)}


def _standing_again(
    problem: Problem, standing: list[SelectedEffect], failing: Sequence[int], fit: Fit, inflation: Inflation
) -> list[int]:
    """Return which of the `failing` effects, by number, pass in another fit, with their drops there."""
    again = _beside_the_others(problem, [standing[number] for number in failing], fit, inflation)
    still = _failing(problem, again, inflation)
    found = [index for index in range(len(failing)) if index not in still]
    for index in found:
        there, one = again[index].candidate, standing[failing[index]]
        candidate = replace(one.candidate, drop=there.drop, held_out=there.held_out)
        standing[failing[index]] = replace(one, candidate=candidate)
    return [failing[index] for index in found]


def _at(final: Fit, one: SelectedEffect) -> SelectedEffect:
    """Return a single effect with its final values; its drop is already known."""
    return replace(one, candidate=replace(one.candidate, values=final.values, fit=final))


def _beside_the_others(
    problem: Problem, standing: Sequence[SelectedEffect], final: Fit, inflation: Inflation
) -> list[SelectedEffect]:
    """Return each effect with its drop beside all others, and the fit without it.

    If an effect is clearly needed, first order is sufficient, except for free runs and for effects that others can
    imitate, which are not linear enough. A fit without an effect starts both from the first-order solution and from the
    paper's parameters before the effect was added, because some fits get stuck from one of them.
    """
    fits = problem.without(final, [[one.candidate.effect] for one in standing])
    drops = [fit.squares - final.squares for fit in fits]
    clear = [_is_clear(problem, one, final, drop, inflation) for one, drop in zip(standing, drops, strict=True)]
    unsure = [number for number in range(len(standing)) if not clear[number]]
    starts = [
        start
        for n in unsure
        for start in (_left_out(problem, standing[n], final), (dict(fits[n].values), fits[n].names))
    ]
    refits = problem.fits(starts, final.noise)
    for number, pair in zip(unsure, zip(refits[::2], refits[1::2], strict=True), strict=True):
        fits[number] = min(pair, key=lambda fit: fit.squares)
    return [_beside(problem, one, before, final) for one, before in zip(standing, fits, strict=True)]


def _beside(problem: Problem, one: SelectedEffect, before: Fit, final: Fit) -> SelectedEffect:
    drop, held_out = before.squares - final.squares, held_out_gain(problem, before, final)
    candidate = CandidateEffect(one.candidate.effect, drop, final.values, final, held_out)
    return replace(one, before=before, candidate=candidate)


def _is_clear(problem: Problem, one: SelectedEffect, fit: Fit, drop: float, inflation: Inflation) -> bool:
    """Return whether the first-order `drop` alone shows that an effect is needed, without a fit."""
    seems_like = one.candidate.effect.seems_like
    others_do = seems_like and {*fit.names} >= {*seems_like}
    return problem.one_step and not others_do and drop > CLEARLY * _least(one, inflation)


def _least(one: SelectedEffect, inflation: Inflation) -> float:
    """Return the drop of the sum of squares below which an effect is redundant."""
    effect = one.candidate.effect
    return (needed(effect) + rarity(effect.name)) * inflation.of(effect.name)


def _left_out(problem: Problem, one: SelectedEffect, final: Fit) -> tuple[dict[str, float], tuple[str, ...]]:
    """Return the values of a fit with the paper's parameters from before an effect was added, and its free
    parameters.
    """
    values, names = without(problem, final, [one])
    return {**values, **{name: value for name, value in one.before.values.items() if name in PAPER}}, names


def _without_small(
    problem: Problem, named: Sequence[SelectedEffect], current: Fit
) -> tuple[list[SelectedEffect], list[CandidateEffect], Fit]:
    """Return the effects that are large enough, the small ones with their values, and the fit without the small
    ones.
    """
    measures = [_too_small(problem, one, current) for one in named]
    small = {
        number: measure
        for number, measure in enumerate(measures)
        if measure is not None and not _matters(problem, named[number], current)
    }
    if not small:
        return list(named), [], current
    leaving = [named[number] for number in small]
    fit = problem.fit(*without(problem, current, leaving), current.noise, renew=0)
    tested = [replace(named[number].candidate, values=current.values, measure=small[number]) for number in small]
    return [one for number, one in enumerate(named) if number not in small], tested, fit


def _matters(problem: Problem, one: SelectedEffect, fit: Fit) -> bool:
    """Return whether an effect is nearly large enough, and free runs on left-out data are much better with it."""
    if not nearly_large(replace(one.candidate, values=fit.values, fit=fit), problem.excitation):
        return False
    before = problem.fit(*without(problem, fit, [one]), fit.noise, renew=0)
    found = elsewhere(problem, before, fit)
    return found.seen and found.of_runs > MUCH_BETTER


def _too_small(problem: Problem, one: SelectedEffect, fit: Fit) -> Measure | None:
    """Return by how much an effect with its values in a fit is too small to be named; None if it is large enough."""
    return too_small(replace(one.candidate, values=fit.values, fit=fit), problem.excitation)


def pruned(
    problem: Problem, named: list[SelectedEffect], current: Fit, inflation: Inflation
) -> tuple[list[SelectedEffect], Fit, list[tuple[str, float, float]]]:
    """Drop effects that the others have made redundant; return these with their drops and the required drops."""
    removed: list[tuple[str, float, float]] = []
    drops = [
        fit.squares - current.squares for fit in problem.without(current, [[one.candidate.effect] for one in named])
    ]
    clear = [_is_clear(problem, one, current, drop, inflation) for one, drop in zip(named, drops, strict=True)]
    unsure = [one for one, sure in zip(named, clear, strict=True) if not sure]
    while unsure:
        fits = problem.fits([without(problem, current, [one]) for one in unsure], current.noise)
        redundant = [f.squares - current.squares < _least(o, inflation) for f, o in zip(fits, unsure, strict=True)]
        if not any(redundant):
            break
        first = redundant.index(True)
        drop, least = fits[first].squares - current.squares, _least(unsure[first], inflation)
        removed.append((unsure[first].candidate.effect.name, drop, least))
        named = [one for one in named if one is not unsure[first]]
        current, unsure = fits[first], unsure[first + 1 :]
    return named, current, removed


def without(problem: Problem, fit: Fit, effects: Sequence[SelectedEffect]) -> tuple[dict[str, float], tuple[str, ...]]:
    """Return the values and free parameters of a fit without some effects.

    The delay caused by one that seems like latencies is moved to these if all are free.
    """
    own = {parameter.name for one in effects for parameter in one.candidate.effect.parameters}
    values = problem.excitation.without(fit.values, own)
    for effect in (one.candidate.effect for one in effects):
        if effect.seems_like and {*fit.names} - own >= {*effect.seems_like}:
            values = seen_later(values, effect, fit.values[effect.name] - values.get(effect.name, 0.0))
    return values, tuple(name for name in fit.names if name not in own)

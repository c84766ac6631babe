"""Find the rivals of an effect: others that explain the data as well in its place, or better."""

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from cmr.estimation.candidates import AS_THE_RADIUS
from cmr.estimation.gauss_newton import Fit
from cmr.estimation.problem import Problem
from cmr.estimation.search.criteria import TOO_SMALL, CandidateEffect, SelectedEffect, held_out_gain, why_not
from cmr.estimation.search.exchange import (
    BETTER,
    Exchange,
    candidates_of,
    penalty_of,
    possible,
    too_rare,
)
from cmr.estimation.search.inflation import Inflation
from cmr.estimation.search.screening import Score, Screening, start_of
from cmr.model.catalogue import CATALOGUE
from cmr.model.effect import Effect

ALIKE = 12.0  # drops that differ by less cannot be distinguished,
ALIKE_SHARE = 0.02  # nor those that differ by less than this share, as long as other effects may be missing,
# And by less than this share when all are present: fits stop slightly before the optimum, and the observer's motion
# between steps is approximate (a late gyro at 20 Hz: 0.15 %).
ALIKE_AT_THE_END = 0.002
# Share of the loss without an effect that a candidate must compensate to first order to be fitted; and the same for
# encoders, and for earlier rivals.
NEARLY_ALL, FIRST_ORDER = 0.95, 0.5
MOST = 4  # rivals that are searched
AS_WELL = "It explains the data as well as {}: the difference is below the threshold."


class Rival(NamedTuple):
    """A rival: its name, the deficit of its drop relative to the named effect, the limit for that, and its own fit."""

    name: str
    less: float
    limit: float
    fit: Fit


def margin_of(candidate: CandidateEffect, inflation: Inflation, share: float = ALIKE_SHARE) -> float:
    """Return the difference in drop that distinguishes other effects from this one."""
    return max(ALIKE * inflation.of(candidate.effect.name), share * candidate.drop)


def rivals_of(
    problem: Problem, current: Fit, screening: Screening, one: SelectedEffect, inflation: Inflation
) -> tuple[Rival, ...]:
    """Return the effects that explain the data as well as one of the model's, beside all others in it.

    The screening beside the model proposes them to first order; these are then fitted. A data-sheet effect is a rival
    only if it explains as much, or is mathematically equivalent.
    """
    name = one.candidate.effect.name
    margin = margin_of(one.candidate, inflation, ALIKE_AT_THE_END)
    starts = _proposed(current, screening, one, margin)
    if not starts:
        return ()
    (without,) = problem.without(current, [[one.candidate.effect]])
    models = [
        ({**without.values, **start}, (*without.names, *(p.name for p in CATALOGUE[effect].parameters)))
        for effect, start in starts.items()
    ]
    before, *fits = problem.fits([(without.values, without.names), *models], current.noise)
    equivalent = name in AS_THE_RADIUS
    limits = [BETTER if CATALOGUE[effect].in_data_sheets and not equivalent else margin for effect in starts]
    rivals = [
        Rival(effect, fit.squares - current.squares, limit, fit)
        for effect, fit, limit in zip(starts, fits, limits, strict=True)
    ]
    return tuple(
        rival
        for rival in rivals
        if rival.less < rival.limit and _holds(problem, before, CATALOGUE[rival.name], rival.fit, inflation)
    )


def _proposed(current: Fit, screening: Screening, one: SelectedEffect, margin: float) -> dict[str, dict[str, float]]:
    """Return the start values of effects that explain, to first order, as much as an effect in the model."""
    own = {parameter.name for parameter in one.candidate.effect.parameters}
    left = screening.linear.beside([free for free in current.names if free not in own], [one.candidate.effect.name])
    sizes = np.maximum(np.diag(left.normal), np.finfo(np.float64).tiny)
    shares, drops = -left.pulls / sizes, left.pulls**2 / sizes
    # Far from neutral, slopes overestimate the loss.
    lost = min(left.squares - current.squares, one.candidate.drop)
    starts: dict[str, dict[str, float]] = {}
    for number in np.argsort(-drops):
        trial, share = screening.trials[number], float(shares[number])
        near = CATALOGUE[trial.effect].in_data_sheets or trial.effect in one.rivals
        least = min((FIRST_ORDER if near else NEARLY_ALL) * lost, lost - margin)
        if drops[number] > least and possible(screening, number, share) and len(starts) < MOST:
            starts.setdefault(trial.effect, start_of(Score(trial, 0.0, share)))
    return starts


def better_than(
    problem: Problem, current: Fit, name: str, rivals: Sequence[Rival], inflation: Inflation
) -> Exchange | None:
    """Return the exchange of an effect for the best of its rivals that is better, None without one."""
    costs = {rival.name: rival.less + penalty_of([name], [rival.name], inflation) for rival in rivals}
    for rival in sorted(rivals, key=lambda rival: costs[rival.name]):
        if costs[rival.name] > -BETTER * inflation.all:
            break
        candidates = candidates_of(problem, rival.fit, [rival.name], inflation)
        if not too_rare(current, rival.fit, [name], candidates):
            return Exchange((name,), tuple(SelectedEffect(one, (), current) for one in candidates), rival.fit)
    return None


def _holds(problem: Problem, before: Fit, effect: Effect, fit: Fit, inflation: Inflation) -> bool:
    """Return whether a fitted effect could be named in another's place."""
    tested = CandidateEffect(effect, before.squares - fit.squares, fit.values, fit)
    tested = replace(tested, held_out=held_out_gain(problem, before, fit))
    return is_possible_instead(problem, before, tested, inflation)


def is_possible_instead(problem: Problem, before: Fit, candidate: CandidateEffect, inflation: Inflation) -> bool:
    """Return whether an effect that explains as much as another may be the true one.

    This includes one that is too small to be named: it explains as much without relevant consequences. Encoder errors
    are excluded: data sheets rule small ones out, and they imitate most other effects.
    """
    why = why_not(problem, before, candidate, inflation)
    return not why or (why == TOO_SMALL and not candidate.effect.in_data_sheets)

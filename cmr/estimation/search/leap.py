"""Leap to another set of effects: the likeliest one found by a random walk over all sets.

Exchanges of two effects at a time fail if three or four imitate each other. The random walk of the averaging explores
all sets; its likeliest set is fitted and accepted if it explains the data better. The walk starts from the current
model, and from one that is independent of the search so far.
"""

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from itertools import chain

import numpy as np

from cmr.estimation.averaging import Averaging
from cmr.estimation.candidates import DELAYS, can_be_small, seen_later
from cmr.estimation.gauss_newton import Fit
from cmr.estimation.problem import Problem
from cmr.estimation.search.command_timing import DELAY
from cmr.estimation.search.criteria import SelectedEffect, needed
from cmr.estimation.search.exchange import (
    BETTER,
    Exchange,
    candidates_of,
    penalty_of,
    possible_together,
    too_rare,
    without_idle_swaps,
)
from cmr.estimation.search.inflation import Inflation
from cmr.estimation.search.profile import along
from cmr.model.catalogue import CATALOGUE

ASIDE = (-8e-3, -4e-3, 4e-3, 8e-3)  # s; less than a step
SOMEWHAT = 0.03  # s; least command delay when a slew limit is replaced by a current limit
BY_ITS_SIZE = 8.0  # part of the required drop that the walk's prior on sizes already contains (Occam factor)


def best_leap(
    problem: Problem,
    current: Fit,
    named: Sequence[SelectedEffect],
    inflation: Inflation,
    about: Iterable[Averaging],
) -> Exchange | None:
    """Return the exchange that leads to the likeliest set of effects, None if it does not explain the data better.

    The set is the likeliest of the first linear problem of `about` that leads to a better model.
    """
    penalties = {effect.name: needed(effect) * inflation.of(effect.name) - BY_ITS_SIZE for effect in problem.effects}
    # Parameters missing from a linear problem around another point, such as limits and places, keep their values.
    linear = frozenset(name for name, effect in CATALOGUE.items() if can_be_small(effect))
    likeliest = ((averaging.likeliest(penalties), linear) for averaging in about)
    for values, concerned in chain(likeliest, ((values, frozenset(CATALOGUE)) for values in _alike(current.values))):
        exchange = _exchange(problem, current, named, inflation, values, concerned)
        if exchange is not None:
            return exchange
    return None


def _alike(values: Mapping[str, float]) -> Iterator[dict[str, float]]:
    """Yield values with nearly the same motion that are too far away for the linearisation.

    An effect and the latencies that it seems like are such a pair, and so are an acceleration limit and a slew limit
    with some delay.
    """
    for effect in (one for one in CATALOGUE.values() if one.seems_like):
        seconds, late = values.get(effect.name, 0.0), min(values.get(name, 0.0) for name in effect.seems_like)
        if late > 0.0 and seconds == 0.0:
            yield {**seen_later(values, effect, -late), effect.name: late}
        if seconds > 0.0:
            yield {**seen_later(values, effect, seconds), effect.name: 0.0}
    slew, current = (values.get(name, np.inf) for name in ("slew_limit", "current_limit"))
    motor, late = values["k1"] * values["k2_over_k3"], max(values.get(DELAY, 0.0), SOMEWHAT)
    if slew < np.inf and current == np.inf:
        yield {**values, "slew_limit": np.inf, "current_limit": slew / motor, DELAY: late}
    if current < np.inf and slew == np.inf:
        yield {**values, "current_limit": np.inf, "slew_limit": current * motor}


def _exchange(
    problem: Problem,
    current: Fit,
    named: Sequence[SelectedEffect],
    inflation: Inflation,
    values: Mapping[str, float],
    concerned: Collection[str],
) -> Exchange | None:
    """Return the exchange that leads to the effects switched on by some values, if it explains the data better.

    Only the effects in `concerned`, by name, may be added or removed.
    """
    here = {one.candidate.effect.name for one in named} & {*concerned}
    departs = problem.excitation.departs
    there = {effect.name for effect in problem.effects if effect.name in concerned and departs(effect, values)}
    start = {**current.values, **values}
    while there != here:
        leaving, coming = sorted(here - there), sorted(there - here)
        values, names = _model(problem, current, start, leaving, coming)
        fit = _over_edges(problem, problem.fits([(values, names)], current.noise)[0])
        if fit.squares + penalty_of(leaving, coming, inflation) > current.squares - BETTER * inflation.all:
            return None
        candidates = candidates_of(problem, fit, coming, inflation)
        impossible = [one for one in candidates if not possible_together(problem, current, [one], inflation)]
        if not impossible:
            break
        # Remove the effect that explains least; the rest may still be better than the current model.
        there.discard(min(impossible, key=lambda one: one.drop).effect.name)
        start = {**start, **fit.values}
    else:
        return None
    if too_rare(current, fit, leaving, candidates):
        return None
    exchange = Exchange(tuple(leaving), tuple(SelectedEffect(one, (), current) for one in candidates), fit)
    return without_idle_swaps(problem, current, exchange, inflation)


def _model(
    problem: Problem, current: Fit, start: Mapping[str, float], leaving: Sequence[str], coming: Sequence[str]
) -> tuple[dict[str, float], tuple[str, ...]]:
    """Return the start values of an exchange's fit, and its free parameters."""
    gone = {parameter.name for name in leaving for parameter in CATALOGUE[name].parameters}
    own = [parameter.name for name in coming for parameter in CATALOGUE[name].parameters]
    names = (*(name for name in current.names if name not in gone), *own)
    given = problem.excitation.without(current.values, gone)
    return {**given, **{name: start[name] for name in names if name in start}}, names


def _over_edges(problem: Problem, fit: Fit) -> Fit:
    """Return the fit, or a better one with other delays.

    If all clocks are synchronous, the sum of squares is discontinuous where delays align readings and commands; a fit
    cannot cross that.
    """
    tested = [along(fit, name, aside) for name in fit.names if name in DELAYS for aside in ASIDE]
    squares = problem.squares(tested, fit.noise) if tested else np.empty(0)
    better = [tested[index] for index in np.flatnonzero(squares < fit.squares - BETTER)]
    return min([fit, *problem.refitted(fit, better)], key=lambda one: one.squares)

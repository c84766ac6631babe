"""Leap to another set of effects: the likeliest that a random walk over all sets finds.

Exchanges of two effects at a time end where three or four explain each other's traces. The walk of the averages goes
through all sets; what it finds likeliest is fitted, and taken if it explains the data better. It is asked about the
model as it stands, and about one that knows nothing of the way that led there.
"""

from collections.abc import Callable, Mapping, Sequence

from cmr.estimation.averaging import Averaging
from cmr.estimation.candidates import can_be_small, rarity
from cmr.estimation.gauss_newton import Fit
from cmr.estimation.problem import Problem
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
from cmr.model.catalogue import CATALOGUE

BY_ITS_SIZE = 8.0  # of what an effect must explain, the walk asks so much already: sizes are spread (Occam's factor)


def best_leap(
    problem: Problem,
    current: Fit,
    named: Sequence[SelectedEffect],
    inflation: Inflation,
    about: Sequence[Callable[[], Averaging]],
) -> Exchange | None:
    """Return the exchange that leads to the likeliest set of effects, None where it explains the data no better.

    The set is the likeliest of the first linear problem of those `about` which one leads to a better model.
    """
    penalties = {
        effect.name: needed(effect) * inflation.of(effect.name) + inflation.all * rarity(effect.name) - BY_ITS_SIZE
        for effect in problem.effects
    }
    for averaging in about:
        exchange = _exchange(problem, current, named, inflation, averaging().likeliest(penalties))
        if exchange is not None:
            return exchange
    return None


def _exchange(
    problem: Problem,
    current: Fit,
    named: Sequence[SelectedEffect],
    inflation: Inflation,
    values: Mapping[str, float],
) -> Exchange | None:
    """Return the exchange that leads to the effects that some values switch on, if it explains the data better."""
    here = {_name(one) for one in named if can_be_small(one.candidate.effect)}
    there = {effect.name for effect in problem.effects if can_be_small(effect) and effect.is_on(values)}
    # What a linear problem from afar does not have, as limits and places, is as it stands.
    start = {**current.values, **values}
    while there != here:
        leaving, coming = sorted(here - there), sorted(there - here)
        fit = problem.fits([_model(current, start, leaving, coming)], current.noise)[0]
        if fit.squares + penalty_of(leaving, coming, inflation) > current.squares - BETTER * inflation.all:
            return None
        candidates = candidates_of(problem, fit, coming, inflation)
        impossible = [one for one in candidates if not possible_together(problem, current, [one], inflation)]
        if not impossible:
            break
        # What explains least beside the others goes; the rest may still be better than what stands.
        there.discard(min(impossible, key=lambda one: one.drop).effect.name)
        start = {**start, **fit.values}
    else:
        return None
    if too_rare(current, fit, leaving, candidates):
        return None
    exchange = Exchange(tuple(leaving), tuple(SelectedEffect(one, (), current) for one in candidates), fit)
    return without_idle_swaps(problem, current, exchange, inflation)


def _model(
    current: Fit, start: Mapping[str, float], leaving: Sequence[str], coming: Sequence[str]
) -> tuple[dict[str, float], tuple[str, ...]]:
    """Return the values from which the fit of an exchange begins, and what is free in it."""
    gone = {parameter.name for name in leaving for parameter in CATALOGUE[name].parameters}
    own = [parameter.name for name in coming for parameter in CATALOGUE[name].parameters]
    names = (*(name for name in current.names if name not in gone), *own)
    given = {name: value for name, value in current.values.items() if name not in gone}
    return {**given, **{name: start[name] for name in names if name in start}}, names


def _name(one: SelectedEffect) -> str:
    return one.candidate.effect.name

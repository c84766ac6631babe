"""Leap to another set of effects: the likeliest that a random walk over all sets finds.

Exchanges of two effects at a time end where three or four explain each other's traces. The walk of the averages goes
through all sets; what it finds likeliest is fitted, and taken if it explains the data better.
"""

from collections.abc import Sequence

from cmr.estimation.averaging import Averaging
from cmr.estimation.candidates import rarity
from cmr.estimation.gauss_newton import Fit
from cmr.estimation.problem import Problem
from cmr.estimation.search.criteria import TOO_SMALL, SelectedEffect, needed, why_not
from cmr.estimation.search.exchange import BETTER, Exchange, candidate_of, penalty_of
from cmr.estimation.search.inflation import Inflation

BY_ITS_SIZE = 8.0  # of what an effect must explain, the walk asks so much already: sizes are spread (Occam's factor)


def best_leap(problem: Problem, current: Fit, named: Sequence[SelectedEffect], inflation: Inflation) -> Exchange | None:
    """Return the exchange that leads to the likeliest set of effects, None where it explains the data no better."""
    here = {one.candidate.effect.name for one in named}
    penalties = {
        effect.name: needed(effect) * inflation.of(effect.name) + rarity(effect.name) - BY_ITS_SIZE
        for effect in problem.effects
    }
    values = Averaging(problem, current, inflation.all, here).likeliest(penalties)
    there = {effect.name: effect for effect in problem.effects if effect.is_on(values)}
    leaving, coming = sorted(here - set(there)), sorted(set(there) - here)
    if not leaving and not coming:
        return None
    kept = [name for name in current.names if not any(_is_of(name, one) for one in named if _name(one) in leaving)]
    own = [parameter.name for name in coming for parameter in there[name].parameters]
    start = {name: value for name, value in values.items() if name in current.values or name in own}
    for one in named:
        if _name(one) in leaving:
            start = {name: value for name, value in start.items() if not _is_of(name, one)}
    fit = problem.fits([(start, (*kept, *own))], current.noise)[0]
    if fit.squares + penalty_of(leaving, coming, inflation) > current.squares - BETTER * inflation.all:
        return None
    candidates = [candidate_of(problem, fit, name) for name in coming]
    if any(why_not(problem, current, one, inflation) not in ("", TOO_SMALL) for one in candidates):
        return None
    return Exchange(tuple(leaving), tuple(SelectedEffect(one, (), current) for one in candidates), fit)


def _name(one: SelectedEffect) -> str:
    return one.candidate.effect.name


def _is_of(name: str, one: SelectedEffect) -> bool:
    return any(parameter.name == name for parameter in one.candidate.effect.parameters)

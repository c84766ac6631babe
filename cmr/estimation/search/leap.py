"""Leap to another set of effects: the likeliest that a random walk over all sets finds.

Exchanges of two effects at a time end where three or four explain each other's traces. The walk of the averages goes
through all sets; what it finds likeliest is fitted, and taken if it explains the data better. It is asked about the
model as it stands, and about one that knows nothing of the way that led there.
"""

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from itertools import chain

import numpy as np

from cmr.estimation.averaging import Averaging
from cmr.estimation.candidates import SLIP, can_be_small, rarity, seen_later
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
from cmr.estimation.search.profile import along
from cmr.model.catalogue import CATALOGUE

DELAYS = ("command_delay", "gyro_latency", "pose_latency")
ASIDE = (-8e-3, -4e-3, 4e-3, 8e-3)  # s; less than a step
SOMEWHAT = 0.03  # s; commands are at least as late where a current limit is tested for a slew limit
BY_ITS_SIZE = 8.0  # of what an effect must explain, the walk asks so much already: sizes are spread (Occam's factor)


def best_leap(
    problem: Problem,
    current: Fit,
    named: Sequence[SelectedEffect],
    inflation: Inflation,
    about: Iterable[Averaging],
) -> Exchange | None:
    """Return the exchange that leads to the likeliest set of effects, None where it explains the data no better.

    The set is the likeliest of the first linear problem of `about` that leads to a better model.
    """
    penalties = {
        effect.name: needed(effect) * inflation.of(effect.name) + inflation.all * rarity(effect.name) - BY_ITS_SIZE
        for effect in problem.effects
    }
    # What a linear problem from afar does not have, as limits and places, is as it stands.
    linear = frozenset(name for name, effect in CATALOGUE.items() if can_be_small(effect))
    likeliest = ((averaging.likeliest(penalties), linear) for averaging in about)
    for values, concerned in chain(likeliest, ((values, frozenset(CATALOGUE)) for values in _alike(current.values))):
        exchange = _exchange(problem, current, named, inflation, values, concerned)
        if exchange is not None:
            return exchange
    return None


def _alike(values: Mapping[str, float]) -> Iterator[dict[str, float]]:
    """Yield values that move a robot nearly alike, but lie too far off for a linear problem.

    Slip and late sensors do (`seen_later`). So do wheels that accelerate within a limit, and a command that rises no
    faster, somewhat later.
    """
    gyro, pose, slip = (values.get(name, 0.0) for name in ("gyro_latency", "pose_latency", SLIP))
    both = min(gyro, pose)
    if both > 0.0 and slip == 0.0:
        yield {**seen_later(values, -both), SLIP: both}
    if slip > 0.0:
        yield {**seen_later(values, slip), SLIP: 0.0}
    slew, current = (values.get(name, np.inf) for name in ("slew_limit", "current_limit"))
    motor, late = values["k1"] * values["k2_over_k3"], max(values.get("command_delay", 0.0), SOMEWHAT)
    if slew < np.inf and current == np.inf:
        yield {**values, "slew_limit": np.inf, "current_limit": slew / motor, "command_delay": late}
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
    """Return the exchange that leads to the effects that some values switch on, if it explains the data better.

    Only effects that are `concerned`, by name, may come or leave; the others stay as they are.
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
    problem: Problem, current: Fit, start: Mapping[str, float], leaving: Sequence[str], coming: Sequence[str]
) -> tuple[dict[str, float], tuple[str, ...]]:
    """Return the values from which the fit of an exchange begins, and what is free in it."""
    gone = {parameter.name for name in leaving for parameter in CATALOGUE[name].parameters}
    own = [parameter.name for name in coming for parameter in CATALOGUE[name].parameters]
    names = (*(name for name in current.names if name not in gone), *own)
    given = problem.excitation.without(current.values, gone)
    return {**given, **{name: start[name] for name in names if name in start}}, names


def _over_edges(problem: Problem, fit: Fit) -> Fit:
    """Return the fit, or a better one with other delays.

    Where all clocks go in step, the sum of squares has an edge wherever two delays make readings and commands meet; a
    fit does not get over it.
    """
    tested = [along(fit, name, aside) for name in fit.names if name in DELAYS for aside in ASIDE]
    squares = problem.squares(tested, fit.noise) if tested else np.empty(0)
    better = [tested[index] for index in np.flatnonzero(squares < fit.squares - BETTER)]
    return min([fit, *problem.refitted(fit, better)], key=lambda one: one.squares)

"""Effects that no fit has: jitter and loss of commands, which act by chance, and coarse ticks, which are read off."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from cmr.estimation.candidates import worth_naming
from cmr.estimation.estimates import Estimate
from cmr.estimation.gains import COARSE
from cmr.estimation.gauss_newton import Fit
from cmr.estimation.problem import Problem
from cmr.estimation.search.command_timing import (
    JITTER,
    LOSS,
    Spread,
    largest_delay,
    period_of,
    share_lost,
    spread_of,
    without_jitter,
    without_loss,
)
from cmr.estimation.search.criteria import THRESHOLD, CandidateEffect, SelectedEffect
from cmr.model.catalogue import CATALOGUE

LATE = ("command_delay", "electrical_lag", "slew_limit")  # as which jitter shows as long as its spread is not looked at
MEANS = ("command_delay", "electrical_lag")  # whose parameter is a mean delay [s]
ALIKE = 12.0  # log-likelihoods (twice) that differ by less cannot be distinguished
MAYBE_CHANCE = 10.0  # drop from which the delays of single commands show; below THRESHOLD both names stand
STD_OF_JITTER = 0.05  # of its size: how delays are spread is not known
LEFT_BY_LATE = 0.003  # of what a fixed delay explains may be left in the spread
SURE_LOSS = 100.0  # drop from which commands are lost; clocks that are not quite even leave some spread, too
PERHAPS = 2.0  # standard deviations by which the share counted may be too small: that commands are lost is sure
READ_OFF = 1e-3  # relative standard deviation of what is read off the data


def chance_on_commands(
    problem: Problem, named: Sequence[SelectedEffect], final: Fit, inflation: float
) -> tuple[SelectedEffect, Problem] | None:
    """Return jitter or loss of commands where the final fit leaves their traces, and the problem without them."""
    late = [one for one in named if one.candidate.effect.name in LATE]
    spread = spread_of(JITTER if late else LOSS, problem, final)
    return _of_chance(problem, final, inflation, late, spread) if spread else None


def with_jitter_as_rival(
    problem: Problem, named: Sequence[SelectedEffect], final: Fit, inflation: float
) -> list[SelectedEffect]:
    """Return the effects; delays whose spread the data do not tell have jitter among their rivals.

    So have those that jitter itself may leave traces of, where it is named or a rival.
    """
    coarse = tick_of(problem) > COARSE
    spread = None
    if any(one.candidate.effect.name in LATE for one in named) and not coarse and problem.by_moments:
        spread = spread_of(JITTER, problem, final)
    if coarse or spread:
        named = [_perhaps_jitter(one, final, inflation, spread) for one in named]
    there = any(JITTER in (one.candidate.effect.name, *one.rivals) for one in named)
    shadows = [there and one.candidate.effect.name in LATE and JITTER not in one.rivals for one in named]
    return [
        replace(one, rivals=(*one.rivals, JITTER)) if shadow else one
        for one, shadow in zip(named, shadows, strict=True)
    ]


def _perhaps_jitter(one: SelectedEffect, final: Fit, inflation: float, jitter: Spread | None) -> SelectedEffect:
    """Return a delay with jitter among its rivals, unless the spread of what follows commands contradicts it.

    `jitter` is None where ticks are too coarse to see single commands.
    """
    if one.candidate.effect.name not in MEANS:
        return one
    mean = sum(final.values[parameter.name] for parameter in one.candidate.effect.parameters)
    excluded = jitter is not None and jitter.drop_at(2.0 * mean) < -ALIKE * inflation
    return one if excluded else replace(one, rivals=(*one.rivals, JITTER))


def _of_chance(
    problem: Problem, final: Fit, inflation: float, late: Sequence[SelectedEffect], spread: Spread
) -> tuple[SelectedEffect, Problem] | None:
    """Return jitter or loss of commands, if the spread shows it, and the problem without it.

    `spread` is that of jitter where effects named make commands `late`, else that of loss.
    """
    of_late = max((one.candidate.drop for one in late), default=0.0)
    if late and spread.drop > max(MAYBE_CHANCE * inflation, LEFT_BY_LATE * of_late):
        value = final.values
        mean = sum(value.get(parameter.name, 0.0) for one in late for parameter in one.candidate.effect.parameters)
        mean = mean if all(one.candidate.effect.name in MEANS for one in late) else 0.5 * spread.value
        drop = spread.drop + of_late
        rivals = tuple(one.candidate.effect.name for one in late) if spread.drop < THRESHOLD else ()
        # The mean of the delays is known better than their spread.
        size = largest_delay(mean, period_of(problem))
        largest = Estimate(size, STD_OF_JITTER * size)
        return _selected(JITTER, largest, drop, rivals, late[0].before), without_jitter(problem, spread, mean)
    share, std = share_lost(problem, spread) if not late else (0.0, 0.0)
    matters = worth_naming({LOSS: share + PERHAPS * std}, {}, problem.excitation)
    if matters and spread.drop > SURE_LOSS * inflation:
        return _selected(LOSS, Estimate(share, std), spread.drop, (), final), without_loss(problem, spread)
    return None


def coarse_ticks(problem: Problem, final: Fit) -> SelectedEffect | None:
    """Return encoder_quantisation where the encoders have few ticks: the readings themselves show it."""
    tick = tick_of(problem)
    if not tick > COARSE:
        return None
    value = 2.0 * np.pi / tick
    readings = sum(int(np.sum(predictor.segment.observations.wheel_use)) for predictor in problem.predictors)
    # Each reading that falls on a tick, where a fine encoder would fall anywhere, is evidence.
    drop = 2.0 * readings * float(np.log(tick / COARSE) + 1.0)
    return _selected("encoder_quantisation", Estimate(value, value * READ_OFF), drop, (), final)


def tick_of(problem: Problem) -> float:
    """Return the size [rad] of an encoder's tick."""
    return max(predictor.segment.tick for predictor in problem.predictors)


def _selected(name: str, estimate: Estimate, drop: float, rivals: tuple[str, ...], before: Fit) -> SelectedEffect:
    values = {**before.values, name: estimate.value}
    candidate = CandidateEffect(CATALOGUE[name], drop, values, None, 0.5 * drop)
    return SelectedEffect(candidate, rivals, before, {name: estimate})

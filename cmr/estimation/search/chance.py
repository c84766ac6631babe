"""Effects that are not fitted: jitter and loss of commands, which are random, and encoder quantisation, which is read
off the data.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from cmr.estimation.candidates import worth_naming
from cmr.estimation.estimates import Estimate
from cmr.estimation.gains import COARSE
from cmr.estimation.gauss_newton import Fit
from cmr.estimation.problem import Problem
from cmr.estimation.search.command_timing import (
    DELAY,
    JITTER,
    LAG,
    LOSS,
    MEANS,
    Timing,
    effective_size,
    largest_delay,
    timing_of,
    without_jitter,
    without_loss,
)
from cmr.estimation.search.criteria import THRESHOLD, TOO_SMALL, CandidateEffect, SelectedEffect
from cmr.model.catalogue import CATALOGUE, definition

ALIKE = 12.0  # log-likelihoods (twice) that differ by less cannot be distinguished
MAYBE_CHANCE = 10.0  # drop from which the delays of single commands are evident; below THRESHOLD both effects are named
STD_OF_JITTER = 0.05  # of its size: the distribution of delays is not known
ELECTRONICS = 1.5e-3  # s of the mean delay that may be common to all commands (wires and electronics), not jitter
SURE_LOSS = 8.0  # drop from which commands are lost
PERHAPS = 2.0  # standard deviations by which the counted share may be too small, given that commands are certainly lost
TICKS = "encoder_quantisation"
READ_OFF = 1e-3  # relative standard deviation of values read off the data


def chance_on_commands(
    problem: Problem,
    named: Sequence[SelectedEffect],
    others: Sequence[tuple[CandidateEffect, str]],
    final: Fit,
    seen: Fit,
) -> tuple[SelectedEffect, Problem] | None:
    """Return jitter or loss of commands if the final fit's residuals show it, and the problem without it.

    A delay among `others`, too small to be named, may be the mean of jitter that is large enough. Friction that is too
    small to be named would look like a loss, so `seen` is the fit with all effects present.
    """
    late = [one for one in named if one.candidate.effect.name in MEANS]
    small = [one for one, why in others if why == TOO_SMALL and one.effect.name in MEANS and one.fit is not None]
    beside = final
    if not late and small:
        late, beside = [SelectedEffect(small[0], (), final)], small[0].fit or final
    jitter = _jitter(problem, beside, late) if late else None
    if jitter and LAG in beside.names:
        # Different delays smooth the response as a lag does: their mean was split between delay and lag.
        delayed = _delayed_only(problem, beside)
        instead = _jitter(problem, delayed, late)
        jitter = instead if instead and delayed.squares - beside.squares < instead.spread else jitter
    if jitter:
        return jitter.effect, jitter.cleaned
    return _lost(problem, final, timing_of(problem, seen, until_next=True))


def with_jitter_as_rival(problem: Problem, named: Sequence[SelectedEffect], final: Fit) -> list[SelectedEffect]:
    """Add jitter to the rivals of delays whose spread the data do not determine; return the effects.

    Effects that jitter can imitate also get it as a rival, if jitter is named or is a rival.
    """
    coarse = tick_of(problem) > COARSE
    timing = None
    if any(one.candidate.effect.name in MEANS for one in named) and not coarse and problem.one_step:
        timing = timing_of(problem, final)
    if coarse or timing:
        named = [_perhaps_jitter(one, final, timing) for one in named]
    there = any(JITTER in (one.candidate.effect.name, *one.rivals) for one in named)
    shadows = [there and one.candidate.effect.name in MEANS and JITTER not in one.rivals for one in named]
    return [
        replace(one, rivals=(*one.rivals, JITTER)) if shadow else one
        for one, shadow in zip(named, shadows, strict=True)
    ]


def _perhaps_jitter(one: SelectedEffect, final: Fit, timing: Timing | None) -> SelectedEffect:
    """Return a delay with jitter among its rivals, unless the spread of the response times contradicts it.

    `timing` is None if ticks are too coarse to resolve single commands.
    """
    if one.candidate.effect.name not in MEANS:
        return one
    excluded = timing is not None and timing.jitter(_size(_mean_delay(final), timing)) < -ALIKE
    return one if excluded else replace(one, rivals=(*one.rivals, JITTER))


def _size(mean: float, timing: Timing) -> float:
    """Return the width [s] of the jitter that causes an apparent mean delay of `mean` [s]."""
    return effective_size(largest_delay(mean, timing.period), timing.period)


def _mean_delay(fit: Fit) -> float:
    """Return the mean delay of the commands [s] in a fit."""
    return sum(fit.values[name] for name in MEANS if name in fit.names)


def _delayed_only(problem: Problem, fit: Fit) -> Fit:
    """Return the fit with a delay in place of a lag."""
    lag = problem.excitation.neutral(LAG)
    delay = min(fit.values.get(DELAY, 0.0) + fit.values[LAG] - lag, definition(DELAY).upper)
    names = (*(name for name in fit.names if name not in MEANS), DELAY)
    return problem.fit({**fit.values, LAG: lag, DELAY: delay}, names, fit.noise, renew=0)


class _Jitter(NamedTuple):
    """Jitter, the problem without it, and the gain from spread delays."""

    effect: SelectedEffect
    cleaned: Problem
    spread: float


def _jitter(problem: Problem, fit: Fit, late: Sequence[SelectedEffect]) -> _Jitter | None:
    """Return jitter in place of the delay effects `late` of a fit, if delays are spread accordingly."""
    timing, mean = timing_of(problem, fit), _mean_delay(fit)
    if timing is None:
        return None
    size = _size(mean, timing)
    spread = timing.jitter(size)
    if spread < MAYBE_CHANCE:
        return None
    # The mean of the delays is better known than their spread.
    largest = largest_delay(mean, timing.period)
    rivals = tuple(one.candidate.effect.name for one in late) if spread < THRESHOLD else ()
    doubt = largest - largest_delay(max(mean - ELECTRONICS, 0.0), timing.period)
    estimate = Estimate(largest, float(np.hypot(STD_OF_JITTER * largest, doubt)))
    gained = spread + max(one.candidate.drop for one in late)
    cleaned = without_jitter(problem, timing.delays(size), mean)
    return _Jitter(read_off(JITTER, estimate, gained, rivals, late[0].before), cleaned, spread)


def _lost(problem: Problem, final: Fit, timing: Timing | None) -> tuple[SelectedEffect, Problem] | None:
    """Return the loss of commands, if it is significant and large enough."""
    loss = timing.loss() if timing else None
    if timing is None or loss is None or loss.drop < SURE_LOSS:
        return None
    if not worth_naming({LOSS: loss.share + PERHAPS * loss.std}, {}, problem.excitation):
        return None
    cleaned = without_loss(problem, timing, loss)
    return read_off(LOSS, Estimate(loss.share, loss.std), loss.drop, (), final), cleaned


def coarse_ticks(problem: Problem, final: Fit) -> SelectedEffect | None:
    """Return encoder_quantisation if the encoders have few ticks, as the readings show."""
    tick = tick_of(problem)
    if not tick > COARSE:
        return None
    value = 2.0 * np.pi / tick
    readings = sum(int(np.sum(predictor.segment.observations.wheel_use)) for predictor in problem.predictors)
    # Each reading exactly on a tick is evidence: those of a fine encoder would lie anywhere.
    drop = 2.0 * readings * float(np.log(tick / COARSE) + 1.0)
    return read_off(TICKS, Estimate(value, value * READ_OFF), drop, (), final)


def tick_of(problem: Problem) -> float:
    """Return the size [rad] of an encoder's tick."""
    return max(predictor.segment.tick for predictor in problem.predictors)


def read_off(name: str, estimate: Estimate, drop: float, rivals: tuple[str, ...], before: Fit) -> SelectedEffect:
    """Return an effect that is not fitted, with its estimated size; `before` is the fit beside it."""
    values = {**before.values, name: estimate.value}
    candidate = CandidateEffect(CATALOGUE[name], drop, values, None, 0.5 * drop)
    return SelectedEffect(candidate, rivals, before, {name: estimate})

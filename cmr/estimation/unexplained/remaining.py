"""Test for structure in the prediction errors that no effect of the catalogue explains.

All possible disturbances, with all possible regressors, are tested at once beside the final model. A term counts only
if it also predicts left-out data, throughout the drive. Structure without a regressor is detected as bursts of errors.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from cmr.estimation.candidates import lanes_of
from cmr.estimation.gains import COARSE
from cmr.estimation.gauss_newton import Fit
from cmr.estimation.prediction import WHEELS, Errors
from cmr.estimation.problem import Problem, tempered
from cmr.estimation.unexplained.bursts import Bursts, bursts
from cmr.estimation.unexplained.result import Unexplained, not_judged
from cmr.estimation.unexplained.scores import Score, predicted_by, remainder, scores
from cmr.estimation.unexplained.share import share_predicted
from cmr.estimation.unexplained.terms import ACCELERATION, drives_of

LEAST, LEAST_SHARE = 40.0, 1e-3  # drop of the sum of squares, and share of it, from which a term is reported
SURELY = 1.5  # factor beyond doubt, without the few blocks that support the term most,
AGREED = 5e-5  # or a drop on which all parts of the drive agree, with this probability by chance
PER_COEFFICIENT = 3.0  # drop that one more coefficient must bring for a term to be better
HOLDS = 0.5  # of the drop must hold on data that it was not fitted to
LEFT_BY_EFFECTS = 0.01  # of the named effects' gain that may remain, since none is exactly as modelled
SMALLEST_SHARE = 0.005  # of the variance of a signal's prediction errors: less does not matter
BURSTS, BURST_SHARE = 3, 0.1  # fewest bursts, and their least share of all of a signal's squared errors
BURSTS_LEFT_BY_EFFECTS = 0.2  # of the named effects' gain that may remain in bursts
WHEELS_ALONE = (
    "The motors were fitted to simulated wheel speeds, whose errors accumulate, and neither poses nor a gyro show how "
    "the body moves."
)
COARSE_ENCODERS = "The encoders' ticks are so coarse that their own errors depend on the speed."


@dataclass(frozen=True, kw_only=True)
class Remaining:
    """Remaining structure: the finding, and the evidence for it.

    `statistic` is the drop of the sum of squared white errors on left-out data by the term found, or the excess of the
    bursts, `threshold` its limit. `scores` are those of all terms, the best first.
    """

    unexplained: Unexplained
    statistic: float
    threshold: float
    scores: tuple[Score, ...]
    bursts: tuple[Bursts, ...]


def remaining(problem: Problem, fit: Fit, base: Fit) -> Remaining:
    """Return what structure remains beside the final fit; `base` is that of the paper's model.

    Errors are one-step prediction errors: for models fitted by free runs, those of the body given the measured wheels.
    """
    (problem, fit), base = problem.one_step_of(fit), problem.one_step_of(base)[1]
    if not problem.batch.rows:
        unexplained = not_judged(WHEELS_ALONE)
        return Remaining(unexplained=unexplained, statistic=0.0, threshold=LEAST, scores=(), bursts=())
    errors = problem.errors(lanes_of([fit.values, base.values]))
    squares = np.sum(tempered(problem.made_white(errors, fit.noise)) ** 2, axis=0)
    explained = max(0.0, float(squares[-1] - squares[0]))
    rest = remainder(problem, fit, errors)
    drives = drives_of(problem.predictors, errors, fit.values["k1"])
    tested = scores(problem, fit, errors, rest, drives)
    tested.sort(key=lambda score: PER_COEFFICIENT * score.freedom - score.held_out)
    loud = bursts(rest)
    spread, least = spread_of(tested), max(LEAST, LEAST_SHARE * len(rest.white), LEFT_BY_EFFECTS * explained)
    rounded = [name for name in WHEELS if only_rounding(name, problem, errors)]
    holding = [one for one in tested if holds(one, spread, least) and not (one.signal in rounded and may_beat(one))][:1]
    predicted = [predicted_by(score.term, problem, fit, errors, rest, drives) for score in holding]
    found = [
        _structure(score, share_predicted(problem.predictors, fit.noise, rest.white, by_term, score.signal), least)
        for score, by_term in zip(holding, predicted, strict=True)
    ]
    # Late stamps from a busy host cause bursts only in the wheels; a jerking robot is visible elsewhere, too.
    sudden = [one for one in loud if one.signal not in WHEELS and bursts_count(one, explained)]
    found += [_bursts(one, explained) for one in sudden][:1]
    found = [one for one in found if one[0].share > SMALLEST_SHARE]
    coarse = max(predictor.segment.tick for predictor in problem.predictors) > COARSE
    if coarse or not found:
        nothing = not_judged(COARSE_ENCODERS) if coarse else Unexplained()
        found = [(nothing, tested[0].held_out if tested else 0.0, least)]
    unexplained, statistic, threshold = max(found, key=lambda one: one[0].share)
    return Remaining(
        unexplained=unexplained, statistic=statistic, threshold=threshold, scores=tuple(tested), bursts=tuple(loud)
    )


def only_rounding(signal: str, problem: Problem, errors: Sequence[Errors]) -> bool:
    """Return whether a signal's errors, in the first column, are no larger than quantisation errors.

    Such errors come from the encoder alone. At a constant reading rate they depend on the speed, because of aliasing
    between ticks and readings.
    """
    pairs = zip(problem.predictors, errors, strict=True)
    known = [(one.of[signal][:, 0], predictor.doubt[signal]) for predictor, one in pairs if signal in one.of]
    if not known:
        return False
    error, doubt = (np.concatenate(column) for column in zip(*known, strict=True))
    return bool(np.mean(error**2) <= 2.0 * np.mean(doubt**2))


def may_beat(score: Score) -> bool:
    """Return whether rounding may cause a term's drop: ticks alias with the speed, not with oscillations."""
    return ACCELERATION not in score.term.regressors


def spread_of(tested: Sequence[Score]) -> float:
    """Return the factor by which the median term's drop exceeds chance, at least 1."""
    return max(1.0, float(np.median([score.drop / score.freedom for score in tested if score.freedom] or [1.0])))


def holds(score: Score, spread: float, least: float) -> bool:
    """Return whether a term explains something beyond doubt, and at least `least`."""
    if score.held_out < max(HOLDS * score.drop, least):
        return False
    return min(score.steady, score.held_out) > SURELY * least or score.chance(spread) < AGREED


def bursts_count(one: Bursts, explained: float) -> bool:
    """Return whether bursts exceed what effects with this gain may leave."""
    return one.number >= BURSTS and one.excess > least_excess(one, explained)


def least_excess(one: Bursts, explained: float) -> float:
    """Return the limit for the excess of bursts beside effects with this gain."""
    return max(BURST_SHARE * one.whole, BURSTS_LEFT_BY_EFFECTS * explained)


def _structure(score: Score, share: float, threshold: float) -> tuple[Unexplained, float, float]:
    words = Unexplained(present=True, signal=score.signal, regressors=score.term.regressors, share=share)
    return words, score.held_out, threshold


def _bursts(one: Bursts, explained: float) -> tuple[Unexplained, float, float]:
    words = Unexplained(
        present=True, signal=one.signal, regressors=("time",), share=one.excess / one.whole, bursts=one.number
    )
    return words, one.excess, least_excess(one, explained)

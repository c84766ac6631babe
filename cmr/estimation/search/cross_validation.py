"""Cross-validate an effect: refit on one fold, score on the other.

For the parts j = 1, 2 (folds.py), with both models fitted on part j alone:

    drop_j = S_j(before) - S_j(after)                 the drop on the part it was fitted on
    gain_j = (S_other(before) - S_other(after)) / 2   the log-likelihood gained on the other part
    share  = largest share of any signal's squares explained on the left-out part

With one-step errors, gain_j >= -LOST drop_j / 2 wherever part j supports the effect by itself; if none does, both drops
must exceed LEAST_SEEN and gain_1 + gain_2 > 0. With free runs, gain_1 + gain_2 > LEAST_GAIN and share >= LEAST_SHARE
are also required.

Reference: M. Stone, Journal of the Royal Statistical Society B 36, 1974.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from cmr.estimation.candidates import Excitation, lanes_of
from cmr.estimation.free_runs import SIGNALS, Errors, Fold, alternating_spans, errors_of
from cmr.estimation.gauss_newton import Fit
from cmr.estimation.problem import Problem
from cmr.estimation.search.folds import first_recordings, two_parts
from cmr.estimation.segments import Segment
from cmr.model.catalogue import definition
from cmr.recordings.signal import Floats

LEAST_SEEN = 4.0  # drop of the sum of squares that each part alone must show
LOST = 0.1  # of the drop on one part that may be lost on the other, since no model is exact
LEAST_GAIN = 10.0  # log-likelihood that an effect must add on the parts that it was not fitted to
LEAST_SHARE = 0.05  # of a signal's squares on data left out that an effect must explain to matter
IN_COMMON = 0.5  # correlation of the traces of two effects above which either may replace the other
SEEN = 0.7  # of the fastest rotation, to allow for sensor errors and soft ground
GYRO = "yaw_rate"
DOES_NOT_HOLD = "It does not hold on another part of the data, fitted again without it."


@dataclass(frozen=True)
class Elsewhere:
    """The result of cross-validating an effect.

    `drops` of the sum of squares are those on the first and the second part when fitted there, `gains` the
    log-likelihood gained on the other part. `of_runs` is the largest share of the squares of wheels and poses explained
    there in free runs, `of_gyro` that of the gyro given the measured wheels.
    """

    drops: tuple[float, float]
    gains: tuple[float, float]
    of_runs: float
    of_gyro: float

    @property
    def share(self) -> float:
        """The largest share of any signal's squares explained on left-out parts."""
        return max(self.of_runs, self.of_gyro)

    @property
    def seen(self) -> bool:
        """Whether each part of the data supports it."""
        return min(self.drops) > LEAST_SEEN

    @property
    def gain(self) -> float:
        """The total log-likelihood gained on left-out parts."""
        return sum(self.gains)

    def spoken(self, significant: float) -> list[tuple[float, float]]:
        """Return drop and gain of each part that supports the effect by itself: with a drop above `significant`."""
        least = max(significant, LEAST_SEEN)
        return [(drop, gain) for drop, gain in zip(self.drops, self.gains, strict=True) if drop > least]


def elsewhere(problem: Problem, before: Fit, after: Fit, by_kind: bool = True) -> Elsewhere:
    """Fit the model with and without an effect on each of two parts, and evaluate both on the other part.

    The parts are those of `two_parts`.
    """
    first = two_parts(problem.predictors, by_kind)
    gyro = np.concatenate([np.full(len(t), n == GYRO) for p in problem.predictors for n, t in p.times.items()])
    drops, gains, of_gyro, models = [], [], np.zeros(2), []
    for part in (first, ~first):
        fits = problem.part(part).fits([(fit.values, fit.names) for fit in (before, after)], after.noise)
        drops.append(fits[0].squares - fits[1].squares)
        values = tuple(fit.values for fit in fits)
        white = problem.white(lanes_of(values), after.noise) ** 2
        squares = np.sum(white[~part], axis=0)
        gains.append(0.5 * float(squares[0] - squares[1]))
        of_gyro += np.sum(white[~part & gyro], axis=0)
        models.append(values)
    share = float(1.0 - of_gyro[1] / of_gyro[0]) if of_gyro[0] > 0.0 else 0.0
    return Elsewhere((drops[0], drops[1]), (gains[0], gains[1]), _share(problem, models, by_kind), share)


def alternatives(before: Fit, one: Fit | None, other: Fit | None) -> bool:
    """Return whether two fits, each with a different effect added to the model `before`, explain the same."""
    if one is None or other is None:
        return False
    first, second = before.rest - one.rest, before.rest - other.rest
    return float(first @ second) > IN_COMMON * float(np.linalg.norm(first) * np.linalg.norm(second))


def _share(problem: Problem, models: Sequence[tuple[Mapping[str, float], ...]], by_kind: bool) -> float:
    """Return the largest share of a signal's squares in free runs that an effect removes, except for the gyro.

    `models` are those before and after, fitted on the first part and on the second; each runs on the other part.
    """
    segments = [predictor.segment for predictor in problem.predictors]
    first = first_recordings(problem.predictors, by_kind) if problem.several else None
    folds = []
    for segment in segments:
        if first is None:
            spans = alternating_spans(segment.observations.time + segment.observations.seconds, 2)
            folds.append([Fold(models[1 - number], _within(segment, spans[number])) for number in range(2)])
        else:
            folds.append([Fold(models[1 if first[segment.recording] else 0])])
    before, after = errors_of(segments, folds)
    signals = [name for name in SIGNALS if name != GYRO and _squares(before, name) > 0.0]
    return max((1.0 - _squares(after, name) / _squares(before, name) for name in signals), default=0.0)


def _within(segment: Segment, spans: Sequence[tuple[float, float]]) -> tuple[tuple[float, float], ...]:
    """Return spans [s since the recording's beginning] as times of the segment."""
    return tuple((begin - segment.observations.time, end - segment.observations.time) for begin, end in spans)


def _squares(errors: Errors, name: str) -> float:
    squares: Floats = errors.squares[name]
    return float(np.sum(squares))


def why_not_elsewhere(problem: Problem, before: Fit, after: Fit | None, significant: float) -> str:
    """Return why an effect fails cross-validation; empty if it passes.

    `significant` is the drop above which a part of the data supports it by itself.
    """
    if after is None:
        return "It was not fitted."
    found = elsewhere(problem, before, after)
    if problem.one_step:
        return why_not_of_moments(found, significant)
    harmless = _harmless(found, significant)
    if not found.seen and problem.several and harmless:  # then the joint gain of both parts of a kind counts
        found = elsewhere(problem, before, after, by_kind=False)
    if not found.seen:
        return "Only a part of the data shows it."
    if found.gain <= LEAST_GAIN or not harmless:
        return DOES_NOT_HOLD
    return "It hardly improves the prediction of data that it was not fitted to." if found.share < LEAST_SHARE else ""


def why_not_of_moments(found: Elsewhere, significant: float) -> str:
    """Return why an effect fails cross-validation by one-step errors.

    A drive that does not excite an effect is no evidence against it. So a fit on a part that supports the effect by
    itself must not make the other part worse; if neither part does, both together must gain.
    """
    if found.spoken(significant):
        return "" if _harmless(found, significant) else DOES_NOT_HOLD
    if not found.seen:
        return "Only a part of the data shows it."
    return DOES_NOT_HOLD if found.gain <= 0.0 else ""


def _harmless(found: Elsewhere, significant: float) -> bool:
    """Return whether no part that supports the effect by itself makes the other part worse."""
    return all(gain >= -0.5 * LOST * drop for drop, gain in found.spoken(significant))


def contradicted(values: Mapping[str, float], excitation: Excitation) -> bool:
    """Return whether an effect limits the yaw rate to less than was measured."""
    return as_seen(values, excitation) != values


def as_seen(values: Mapping[str, float], excitation: Excitation) -> dict[str, float]:
    """Return the values with yaw-rate limits raised to the fastest measured rotation."""
    limits = {name for name in values if definition(name).kind == "yaw_rate"}
    exceeded = {name for name in limits if values[name] < SEEN * excitation.fastest}
    return {name: excitation.fastest if name in exceeded else value for name, value in values.items()}

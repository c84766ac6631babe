"""What an extended model is worth: how much errors of free runs shrink on data left out of its fit, and how surely."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from statistics import NormalDist
from typing import NamedTuple, Protocol

import numpy as np

from cmr.estimation.free_runs import BLOCK, Errors, Fold, alternating_spans, errors_of
from cmr.estimation.prediction import WHEELS
from cmr.estimation.problem import Problem
from cmr.estimation.segments import Segment
from cmr.recordings.signal import Floats, Mask

COVERAGE = 0.95  # of the interval
WINDOWS_IN_A_BLOCK = 2  # windows overlap, and disturbances outlast one; blocks this long are nearly independent
DRAWS = 2000  # more move the ends of the interval by less than a hundredth of its width
FEWEST_BLOCKS = 3  # from fewer nothing is known of how much they vary
GAIN_SIGNALS = {"psi": WHEELS, "yaw_rate": ("yaw_rate",), "pose": ("position",)}
FOLDS = 4
JITTER = "command_jitter"


@dataclass(frozen=True, kw_only=True)
class Gain:
    """By how much errors of free runs shrink on data that nothing was fitted on.

    `ratio` is the baseline's path error over that of the extended model, `interval` its 95 % interval by a block
    bootstrap. `signals` are the ratios by signal: psi, yaw_rate, pose.
    """

    ratio: float
    interval: tuple[float, float]
    signals: Mapping[str, float]


def path_rmse(errors: Errors) -> float:
    """Return the root mean square distance [m] from the real path; NaN where no path was recorded."""
    return errors.rmse("position")


def gain_of(before: Errors, after: Errors, *, seed: int = 0) -> Gain:
    """Return how many times smaller the errors `after` are than those `before`, both over the same windows.

    What was not recorded has no ratio: NaN for the path, no entry among the signals. The interval holds for other
    drives like these; that of fewer than FEWEST_BLOCKS blocks is NaN.
    """
    ratios = {name: ratio_of(before, after, *signals) for name, signals in GAIN_SIGNALS.items()}
    interval = _interval(_in_blocks(before), _in_blocks(after), seed)
    measured = {name: ratio for name, ratio in ratios.items() if math.isfinite(ratio)}
    return Gain(ratio=ratios["pose"], interval=interval, signals=measured)


def ratio_of(before: Errors, after: Errors, *signals: str) -> float:
    """Return the ratio of the root mean square errors of these signals; NaN where there is none."""
    least = after.rmse(*signals)
    return before.rmse(*signals) / least if least > 0.0 else math.nan


def _in_blocks(errors: Errors) -> Floats:
    """Return the sums of the path's squared errors over blocks of windows that follow one another; (blocks,)."""
    measured = errors.counts["position"] > 0
    number = np.floor(errors.begin / (WINDOWS_IN_A_BLOCK * errors.window)).astype(np.int64)
    _, block = np.unique(np.stack([errors.recording, number])[:, measured], axis=1, return_inverse=True)
    return np.asarray(np.bincount(block.ravel(), errors.squares["position"][measured]), np.float64)


def _interval(before: Floats, after: Floats, seed: int) -> tuple[float, float]:
    """Return the interval of the ratio by a block bootstrap: blocks are drawn with replacement, DRAWS times.

    Of few blocks the quantiles lie further out, as those of Student's t do (T. Hesterberg, What Teachers Should Know
    About the Bootstrap, The American Statistician 69, 2015, section 5.3: expanded percentiles).
    """
    from scipy.special import stdtrit

    blocks = len(before)
    if blocks < FEWEST_BLOCKS or not np.sum(after) > 0.0:
        return math.nan, math.nan
    further = math.sqrt(blocks / (blocks - 1)) * float(stdtrit(blocks - 1, (1.0 - COVERAGE) / 2.0))
    tail = NormalDist().cdf(further)
    drawn = _drawn(blocks, seed)
    squared = (drawn @ before) / np.maximum(drawn @ after, np.finfo(np.float64).tiny)
    low, high = np.sqrt(np.quantile(squared, (tail, 1.0 - tail)))
    return float(low), float(high)


@lru_cache(maxsize=2)
def _drawn(blocks: int, seed: int) -> Floats:
    """Return how often each of so many blocks is drawn, (DRAWS, blocks): the same for all gains of one recording."""
    drawn = np.random.default_rng(seed).multinomial(blocks, np.full(blocks, 1.0 / blocks), DRAWS)
    return np.asarray(drawn, np.float64)


class Model(Protocol):
    """Values by name, and those that there would be without some of the data: a fit, or a posterior."""

    @property
    def values(self) -> Mapping[str, float]:
        """All values of parameters by name."""

    def values_without(self, left_out: Mask) -> Mapping[str, float]:
        """Return the values without some white errors, shape (n,)."""


@dataclass(frozen=True)
class Given:
    """A model whose values, by name, were not fitted: they are the same whatever data are left out."""

    values: Mapping[str, float]

    def values_without(self, _left_out: Mask) -> Mapping[str, float]:
        """Return the values."""
        return self.values


@dataclass(frozen=True)
class Measured:
    """Path errors [m] of both models on data that they were fitted on, their errors on data left out, and the gain."""

    before: float
    after: float
    held_out_before: Errors
    held_out_after: Errors
    gain: Gain


@dataclass(frozen=True)
class NominalMeasured:
    """Errors of the robot as it was given, and what the whole model gains over it.

    `values` are all by name, `path_rmse` [m] is over the data that the others were fitted on, `held_out` over the
    windows on which they were measured.
    """

    values: Mapping[str, float]
    path_rmse: float
    held_out: Errors
    gain: Gain


def measure(
    problem: Problem,
    base: Model,
    final: Model,
    chance: Mapping[str, float],
    segments: Sequence[Segment],
    held_out: Sequence[Segment],
) -> Measured:
    """Measure both models on the `segments` they were fitted on, on parts of them left out, or on `held_out` segments.

    `chance` are values by name of effects that no fit has. The problem holds the segments as they were fitted.
    """
    pair = Running(base), Running(final, chance)
    before, after = (path_rmse(errors) for errors in _fitted_errors(pair, segments))
    outside_before, outside_after = _left_out_errors(problem, pair, segments, held_out)
    return Measured(before, after, outside_before, outside_after, gain_of(outside_before, outside_after))


def measure_nominal(
    problem: Problem,
    nominal: Mapping[str, float],
    measured: Measured,
    segments: Sequence[Segment],
    held_out: Sequence[Segment],
    smoothing: Mapping[str, float],
) -> NominalMeasured | None:
    """Measure a robot that was given, by the values of all its parameters, over the windows of what was `measured`.

    `smoothing` are the values of the model that knows most: its sensor effects say where the windows begin. Without
    values of the robot there is nothing to measure: None.
    """
    if not nominal:
        return None
    pair = Running(Given(nominal)), Running(Given(smoothing))
    (fitted, _), (outside, _) = _fitted_errors(pair, segments), _left_out_errors(problem, pair, segments, held_out)
    return NominalMeasured(nominal, path_rmse(fitted), outside, gain_of(outside, measured.held_out_after))


def left_out_gains(
    problem: Problem,
    before: Sequence[Model],
    after: Model,
    chance: Mapping[str, float],
    segments: Sequence[Segment],
    held_out: Sequence[Segment],
) -> list[Gain]:
    """Return what one model gains over each of others where all know the same of what acts by `chance`.

    It is measured on `held_out` segments, without any on parts of the `segments` left out.
    """
    models = [Running(model, chance) for model in (*before, after)]
    *without_it, with_it = _left_out_errors(problem, models, segments, held_out)
    return [gain_of(errors, with_it) for errors in without_it]


class Running(NamedTuple):
    """A model that runs freely: what acts by `chance`, of which no fit knows, is replaced by its mean."""

    model: Model
    chance: Mapping[str, float] = {}

    @property
    def values(self) -> dict[str, float]:
        """All values of parameters by name."""
        return with_mean_of_chance(self.model.values, self.chance)

    def values_without(self, left_out: Mask) -> dict[str, float]:
        """Return the values without some white errors, shape (n,)."""
        return with_mean_of_chance(self.model.values_without(left_out), self.chance)


def with_mean_of_chance(values: Mapping[str, float], chance: Mapping[str, float]) -> dict[str, float]:
    """Return the values of a model in which commands are as late as what acts by `chance` makes them on average."""
    running = dict(values)
    if JITTER in chance:
        running["command_delay"] = running.get("command_delay", 0.0) + 0.5 * chance[JITTER]
    return running


def _fitted_errors(models: Sequence[Running], segments: Sequence[Segment]) -> tuple[Errors, ...]:
    """Return the errors of each model in segments, with its values as they are."""
    fold = Fold(tuple(model.values for model in models))
    return errors_of(segments, [[fold]] * len(segments))


def _left_out_errors(
    problem: Problem, models: Sequence[Running], segments: Sequence[Segment], held_out: Sequence[Segment]
) -> tuple[Errors, ...]:
    """Return the errors of each model on held-out segments, without any on parts of the segments left out."""
    if held_out:
        return _fitted_errors(models, held_out)
    return errors_of(segments, _folds(problem, models, segments))


def _folds(problem: Problem, models: Sequence[Running], segments: Sequence[Segment]) -> list[list[Fold]]:
    """Return for each segment its folds, with all models fitted without each."""
    rows = _row_folds(problem)
    without = [tuple(model.values_without(rows == fold) for model in models) for fold in range(FOLDS)]
    spans = [alternating_spans(segment.observations.time + segment.observations.seconds, FOLDS) for segment in segments]
    return [
        [
            Fold(
                without[fold],
                tuple((b - segment.observations.time, e - segment.observations.time) for b, e in of_piece[fold]),
            )
            for fold in range(FOLDS)
        ]
        for segment, of_piece in zip(segments, spans, strict=True)
    ]


def _row_folds(problem: Problem) -> np.typing.NDArray[np.int64]:
    """Return the fold of each white error of the problem, (n,): blocks of time dealt out in turn."""
    return np.concatenate(
        [
            np.floor((times + predictor.segment.observations.time) / BLOCK).astype(np.int64) % FOLDS
            for predictor in problem.predictors
            for times in predictor.times.values()
        ]
    )

"""The gain of an extended model: the reduction of free-run errors on data left out of its fit, with an interval."""

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
from cmr.model.catalogue import CATALOGUE
from cmr.recordings.signal import Floats, Mask

COVERAGE = 0.95  # of the interval
WINDOWS_IN_A_BLOCK = 2  # windows overlap, and disturbances outlast one; blocks this long are nearly independent
DRAWS = 2000  # more would change the interval by less than a hundredth of its width
FEWEST_BLOCKS = 3  # fewer do not show their variation
GAIN_SIGNALS = {"psi": WHEELS, "yaw_rate": ("yaw_rate",), "pose": ("position",)}
FOLDS = 4  # of the drive, each left out of one fit


@dataclass(frozen=True, kw_only=True)
class Gain:
    """The reduction of free-run errors on data that were not used in a fit.

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
    """Return the ratios of the errors `before` to those `after`, both over the same windows.

    Signals that were not recorded have no ratio: NaN for the path, no entry in `signals`. The interval is valid for
    similar drives; with fewer than FEWEST_BLOCKS blocks it is NaN.
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
    """Return the sums of the path's squared errors over blocks of consecutive windows; (blocks,)."""
    measured = errors.counts["position"] > 0
    number = np.floor(errors.begin / (WINDOWS_IN_A_BLOCK * errors.window)).astype(np.int64)
    _, block = np.unique(np.stack([errors.recording, number])[:, measured], axis=1, return_inverse=True)
    return np.asarray(np.bincount(block.ravel(), errors.squares["position"][measured]), np.float64)


def _interval(before: Floats, after: Floats, seed: int) -> tuple[float, float]:
    """Return the interval of the ratio by a block bootstrap: blocks are drawn with replacement, DRAWS times.

    For few blocks the quantiles are widened, like those of Student's t (T. Hesterberg, What Teachers Should Know About
    the Bootstrap, The American Statistician 69, 2015, section 5.3: expanded percentiles).
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
    """Return how often each block is drawn, (DRAWS, blocks): the same for all gains of one recording."""
    drawn = np.random.default_rng(seed).multinomial(blocks, np.full(blocks, 1.0 / blocks), DRAWS)
    return np.asarray(drawn, np.float64)


class Model(Protocol):
    """A fit or a posterior: values by name, also with some of the data left out."""

    @property
    def values(self) -> Mapping[str, float]:
        """All values of parameters by name."""

    def values_without(self, left_out: Mask) -> Mapping[str, float]:
        """Return the values without some white errors, shape (n,)."""


@dataclass(frozen=True)
class Given:
    """A model with fixed values, by name, that do not depend on the data."""

    values: Mapping[str, float]

    def values_without(self, _left_out: Mask) -> Mapping[str, float]:
        """Return the values."""
        return self.values


@dataclass(frozen=True)
class Measured:
    """Path errors [m] of both models on the fitted data, their errors on left-out data, and the gain."""

    before: float
    after: float
    held_out_before: Errors
    held_out_after: Errors
    gain: Gain


@dataclass(frozen=True)
class NominalMeasured:
    """Errors of the robot as given, and the gain of the whole model over it.

    `values` are all values by name, `path_rmse` [m] is over the data that the other models were fitted on, `held_out`
    over the same windows as theirs.
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

    `chance` are the values by name of random effects, which are not part of a fit. The problem holds the segments as
    they were fitted.
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
    """Measure the robot as given, by all its parameter values, over the windows of `measured`.

    `smoothing` are the values of the most complete model, whose sensor effects determine the start poses of the
    windows. Returns None without values of the robot.
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
    """Return the gains of one model over each of the others, all with the same random effects (`chance`).

    They are measured on `held_out` segments, or else on left-out parts of the `segments`.
    """
    models = [Running(model, chance) for model in (*before, after)]
    *without_it, with_it = _left_out_errors(problem, models, segments, held_out)
    return [gain_of(errors, with_it) for errors in without_it]


class Running(NamedTuple):
    """A model for free runs: random effects (`chance`), which are not part of a fit, are replaced by their means."""

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
    """Return the values of a model with what its random effects do on average."""
    running = dict(values)
    for effect in (one for name, one in CATALOGUE.items() if name in chance):
        for name, share in effect.on_average.items():
            running[name] = running.get(name, 0.0) + share * chance[effect.name]
    return running


def _fitted_errors(models: Sequence[Running], segments: Sequence[Segment]) -> tuple[Errors, ...]:
    """Return the errors of each model in segments, with its values unchanged."""
    fold = Fold(tuple(model.values for model in models))
    return errors_of(segments, [[fold]] * len(segments))


def _left_out_errors(
    problem: Problem, models: Sequence[Running], segments: Sequence[Segment], held_out: Sequence[Segment]
) -> tuple[Errors, ...]:
    """Return the errors of each model on held-out segments, or else on left-out parts of the segments."""
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
    """Return the fold of each white error of the problem, (n,): blocks of time assigned in turn."""
    return np.concatenate(
        [
            np.floor((times + predictor.segment.observations.time) / BLOCK).astype(np.int64) % FOLDS
            for predictor in problem.predictors
            for times in predictor.times.values()
        ]
    )

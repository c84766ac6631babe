"""Measure what an extended model is worth: errors of free runs on data that its parameters were not fitted on."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np

from cmr.estimation.free_runs import BLOCK, Errors, Fold, alternating_spans, errors_of
from cmr.estimation.gain import Gain, gain_of, path_rmse
from cmr.estimation.problem import Problem
from cmr.estimation.segments import Segment
from cmr.recordings.signal import Mask

FOLDS = 4
JITTER = "command_jitter"


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
) -> NominalMeasured:
    """Measure a robot that was given, by the values of all its parameters, over the windows of what was `measured`.

    `smoothing` are the values of the model that knows most: its sensor effects say where the windows begin.
    """
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
        return self._with_chance(self.model.values)

    def values_without(self, left_out: Mask) -> dict[str, float]:
        """Return the values without some white errors, shape (n,)."""
        return self._with_chance(self.model.values_without(left_out))

    def _with_chance(self, values: Mapping[str, float]) -> dict[str, float]:
        running = dict(values)
        if JITTER in self.chance:
            running["command_delay"] = running.get("command_delay", 0.0) + 0.5 * self.chance[JITTER]
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

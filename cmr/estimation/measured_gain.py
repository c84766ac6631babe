"""Measure what an extended model is worth: errors of free runs on data that its parameters were not fitted on."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from cmr.estimation.free_runs import BLOCK, Errors, Fold, alternating_spans, errors_of, joined
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
class Measured:
    """Path errors [m] of both models on data that they were fitted on and on data left out, and the gain there."""

    before: float
    after: float
    held_out_before: float
    held_out_after: float
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
    pair = (base, final)
    models = tuple(_running(model.values, chance if model is final else {}) for model in pair)
    inside = _errors(segments, [[Fold(models)]] * len(segments))
    if held_out:
        outside = _errors(held_out, [[Fold(models)]] * len(held_out))
    else:
        outside = _errors(segments, _folds(problem, pair, chance, segments))
    before, after = (path_rmse(errors) for errors in inside)
    held_out_before, held_out_after = (path_rmse(errors) for errors in outside)
    return Measured(before, after, held_out_before, held_out_after, gain_of(*outside))


def _errors(segments: Sequence[Segment], folds: Sequence[Sequence[Fold]]) -> tuple[Errors, ...]:
    """Return the errors of each model over all segments."""
    parts = [errors_of(segment, of_piece) for segment, of_piece in zip(segments, folds, strict=True)]
    return tuple(joined(of_model) for of_model in zip(*parts, strict=True))


def _folds(
    problem: Problem, pair: Sequence[Model], chance: Mapping[str, float], segments: Sequence[Segment]
) -> list[list[Fold]]:
    """Return for each segment its folds, with both models fitted without each."""
    rows = _row_folds(problem)
    models = [
        tuple(
            _running(model.values_without(rows == fold), chance if number else {}) for number, model in enumerate(pair)
        )
        for fold in range(FOLDS)
    ]
    spans = [alternating_spans(segment.observations.time + segment.observations.seconds, FOLDS) for segment in segments]
    return [
        [
            Fold(
                models[fold],
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


def _running(values: Mapping[str, float], chance: Mapping[str, float]) -> dict[str, float]:
    """Return values to run freely with: what acts by chance is replaced by its mean."""
    running = dict(values)
    if JITTER in chance:
        running["command_delay"] = running.get("command_delay", 0.0) + 0.5 * chance[JITTER]
    return running

"""Residuals of a linearised model: whitened, and orthogonal to its own parameters."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from cmr.estimation.laws.linearised import Linearised
from cmr.estimation.noise import Noise
from cmr.estimation.prediction import SIGNALS
from cmr.estimation.problem import LARGE
from cmr.estimation.unexplained.scores import jerky
from cmr.recordings.signal import Floats, Mask

Indices = np.typing.NDArray[np.int64]


@dataclass(frozen=True)
class Rest:
    """White errors (n,), with large ones clipped, and an orthonormal basis (n, p) of the parameters' traces.

    Errors with `mask` (n,) 0.0 do not count; `signal` (n,) is the number of each error's signal, `time` [s] its time.
    `inflation` is the factor by which scores of irrelevant laws exceed chance.
    """

    white: Floats
    basis: Floats
    mask: Floats
    signal: Indices
    time: Floats
    noise: Noise
    inflation: float = 1.0

    @cached_property
    def samples(self) -> int:
        """How many errors count."""
        return int(np.count_nonzero(self.mask))

    def rows(self, signals: Sequence[str]) -> Indices:
        """Return the rows of the errors of some signals."""
        return np.flatnonzero(np.isin(self.signal, [SIGNALS.index(name) for name in signals]))


def rest_of(model: Linearised, noise: Noise, counted: Mask | None = None) -> Rest:
    """Return the residuals of a model with a noise; errors with `counted` (n,) false do not count."""
    white = cut_off(model, noise)
    mask = np.ones(len(white)) if counted is None else counted.astype(np.float64)
    slopes = model.problem.made_white(model.slopes, noise) * mask[:, None]
    basis = np.linalg.qr(slopes)[0]
    white = white * mask
    white -= basis @ (basis.T @ white)
    return Rest(white, basis, mask, signals_of(model), times_of(model), noise)


def cut_off(model: Linearised, noise: Noise) -> Floats:
    """Return a model's white errors (n,), with large ones clipped, and 0 where large ones are expected."""
    white = model.problem.made_white(model.errors, noise)[:, 0]
    white[jerks(model, noise)] = 0.0
    return np.clip(white, -LARGE, LARGE)


def jerks(model: Linearised, noise: Noise) -> Mask:
    """Return which white errors (n,) are a gyro's that coincide with a jump of the acceleration."""
    parts = []
    for number, (predictor, error) in enumerate(zip(model.problem.predictors, model.errors, strict=True)):
        for name in predictor.times:
            sizes = noise.of[name].sizes[number]
            is_gyro = name == "yaw_rate"
            parts.append(jerky(predictor, error.motion, model.values, sizes) if is_gyro else sizes < 0.0)
    return np.concatenate(parts)


def signals_of(model: Linearised) -> Indices:
    """Return the number of each white error's signal, (n,)."""
    times = [(name, len(of)) for one in model.problem.predictors for name, of in one.times.items()]
    return np.concatenate([np.full(count, SIGNALS.index(name)) for name, count in times])


def times_of(model: Linearised) -> Floats:
    """Return the moment [s] of each white error, (n,)."""
    return np.concatenate(
        [of + one.segment.observations.time for one in model.problem.predictors for of in one.times.values()]
    )

"""The gyro's noise at rest: it is white, whereas the noise model of motion would predict it from the past.

In motion a gyro's errors are correlated: wheels slip for a while. Predicting them from the past removes most of a
constant bias. At rest there is no slip, and the gyro's errors are independent: two seconds of rest determine a gyro's
bias, and its drift, better than a minute of driving.
"""

from dataclasses import dataclass, replace

import numpy as np

from cmr.estimation.noise import Noise
from cmr.estimation.prediction import Batch, Errors, Predictor
from cmr.estimation.search.cross_validation import GYRO
from cmr.recordings.signal import Floats, Mask

BEFORE, AFTER = 0.25, 0.05  # s around a gyro reading for which wheels must stand
STANDS = 0.02  # rad that a wheel may turn meanwhile: a tick or two
FEWEST = 30  # readings at rest from which their noise is known
BLOCK = 25  # readings whose mean shows the size of slow errors
LEAST_SHARE = 0.5  # of the size in motion: readings that repeat exactly are not exact


@dataclass(frozen=True)
class NoiseWithRests(Noise):
    """Noise in which the past of the gyro's errors counts only in motion; at rest their size is `size` [rad/s]."""

    size: float

    def all_white(self, batch: Batch, errors: Errors, first: int = 0) -> Floats:
        """Return the errors of a batch made white, shape (n, C); see `Noise.all_white`."""
        white = super().all_white(batch, errors, first)
        if GYRO not in errors.of:
            return white
        rows = [np.arange(part.start, part.stop) for part in batch.white_rows(GYRO)]
        still = resting(batch)
        white[np.concatenate(rows)[still]] = errors.of[GYRO][still] / self.size
        return white


def with_rests(noise: Noise, batch: Batch, errors: Errors) -> Noise:
    """Return the noise with that of the gyro at rest, by the first candidate's errors; unchanged without a rest."""
    still = resting(batch) if GYRO in noise.of else np.zeros(0, np.bool_)
    if np.sum(still) < FEWEST:
        return noise
    own, known = errors.of[GYRO][still, 0], noise.of[GYRO]
    blocks = own[: len(own) // BLOCK * BLOCK].reshape(-1, BLOCK).mean(axis=1)
    in_motion = np.concatenate(known.sizes)
    least = LEAST_SHARE * float(np.min(in_motion))
    size = float(np.sqrt(max(np.mean(own**2), BLOCK * np.var(blocks), least**2)))
    sizes = np.split(np.where(still, size, in_motion), batch.ends[GYRO][1:-1])
    return NoiseWithRests({**noise.of, GYRO: replace(known, sizes=tuple(sizes))}, size)


def resting(batch: Batch) -> Mask:
    """Return the gyro readings during which the robot stood, by its encoders, (n,); none without encoders."""
    return np.concatenate([_resting(one) for one in batch.predictors if GYRO in one.times] or [np.zeros(0, np.bool_)])


def _resting(predictor: Predictor) -> Mask:
    observations = predictor.segment.observations
    time, wheels, at = observations.wheel_time, observations.wheel, observations.gyro_time
    if len(observations.given) or len(time) < 2:
        return np.zeros(len(at), np.bool_)
    # The readings around, so that a robot whose encoders are read seldom does not seem to stand between them.
    first = np.maximum(np.searchsorted(time, at - BEFORE, side="right") - 1, 0)
    last = np.minimum(np.searchsorted(time, at + AFTER), len(time) - 1)
    turned = np.abs(wheels[last] - wheels[first])
    return np.asarray((np.max(turned, axis=1) < STANDS) & (at >= time[0] + BEFORE) & (at <= time[-1] - AFTER))

"""Judge models by the course that things take, not by each moment: for robots that no model describes moment by moment.

Wheels that a controller of their own drives, stick, or rattle make errors from one reading to the next that have little
to do with what the model lacks. A model that never moves foretells the next reading best, and the robot worst. Here
the wheels' speeds run freely from the commands on; gyro and pose follow the measured wheels. Errors are not made white
by their past: each counts as much less as they last (effective sample size; Bayley and Hammersley, J. R. Stat. Soc.
Suppl. 8, 1946).
"""

from collections.abc import Mapping, Sequence

import numpy as np

from cmr.diagnosis.candidates import Scene
from cmr.diagnosis.gains import WHEELS, interval_of
from cmr.diagnosis.noise import FOREIGN, LEAST_SIZE, SPANS, Noise, SignalNoise
from cmr.diagnosis.prediction import Errors, Predictor
from cmr.diagnosis.study import Study
from cmr.model.observer import Gains, Observer
from cmr.recordings.signal import Floats

MEMORY = 0.1  # s after which the angle of a wheel that runs freely has come to its encoder's: what counts is its speed
UNCORRELATED = 0.05  # correlation from which on errors no longer belong together


class CourseStudy(Study):
    """Recordings to be explained by free runs."""

    by_moments = False

    def __init__(self, predictors: Sequence[Predictor], gains: Gains, scene: Scene) -> None:
        super().__init__(predictors, gains, scene)
        angle = min(1.0, interval_of(predictors) / MEMORY)
        self._free = Gains(angle, 0.0, gains.position, gains.theta)

    def errors(self, values: Mapping[str, object]) -> list[Errors]:
        """Return the errors of wheels that run freely, and of gyro and pose beside wheels as they were measured."""
        following, free = Observer(values, self.gains), Observer(values, self._free)
        return [_of_both(predictor, following, free) for predictor in self.predictors]

    def found(self, errors: Sequence[Errors]) -> Noise:
        """Return the noise that the errors of the first candidate in each piece show: how large, and how lasting."""
        return Noise(
            {name: self._signal(name, errors) for name in SPANS if any(name in p.times for p in self.predictors)}
        )

    def _signal(self, name: str, errors: Sequence[Errors]) -> SignalNoise:
        own = [error.of[name][:, 0] for error in errors if name in error.of]
        size = max(float(np.sqrt(np.mean(np.concatenate(own) ** 2))), LEAST_SIZE)
        size *= np.sqrt(lasting(own))
        sizes = tuple(np.full(len(predictor.times.get(name, ())), size) for predictor in self.predictors)
        return SignalNoise(np.zeros(0), np.zeros(len(FOREIGN)), sizes)


def _of_both(predictor: Predictor, following: Observer, free: Observer) -> Errors:
    errors = predictor.errors_of(following)
    if not any(name in errors.of for name in WHEELS):
        return errors
    wheels = predictor.errors_of(free).of
    return Errors({name: wheels[name] if name in WHEELS else own for name, own in errors.of.items()}, errors.motion)


def lasting(errors: Sequence[Floats]) -> float:
    """Return for how many samples errors, one array (n,) a piece, count as one: at least 1."""
    longest = max(len(one) for one in errors)
    length = 1 << int(np.ceil(np.log2(2 * longest)))
    spectrum = sum(np.abs(np.fft.rfft(one, length)) ** 2 for one in errors)
    covariance = np.fft.irfft(spectrum, length)[:longest]
    if covariance[0] <= 0.0:
        return 1.0
    correlation = covariance[1:] / covariance[0]
    ends = np.flatnonzero(correlation < UNCORRELATED)
    together = correlation[: ends[0]] if len(ends) else correlation
    return float(1.0 + 2.0 * np.sum(together))

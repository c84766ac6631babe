"""What is to be expected of one measure: learnt by Bayesian linear regression from seconds in which nothing changed."""

import math
from collections import deque
from typing import NamedTuple

import numpy as np

from cmr.diagnosis.live.measures import Measure
from cmr.diagnosis.live.second import Second
from cmr.recordings.signal import Floats

MOST = 120  # seconds that are kept; a robot that moves in new ways is learnt again
PASSES = 4  # in which noise and coefficients, each of which follows from the other, settle
OUTLYING = 2.5  # standard deviations; what is further off weighs less (Huber)
LEAST_NOISE = 0.5  # of the measure's scale; less is not believed of so few seconds
STRONGEST_MEMORY = 0.6  # correlation of one second's noise with the next that is believed
FURTHER = 1.25  # times; a regressor may be as much larger than ever before
LIKELY = 4.0  # standard deviations; what is less likely is not learnt: it may be a change
NOVEL = 0.5  # of the noise: where the expectation is more uncertain, a second is learnt instead of judged


class Residual(NamedTuple):
    """By how much a second differs from what was expected, the standard deviations of noise and of the expectation."""

    value: float
    noise: float
    doubt: float

    @property
    def novel(self) -> bool:
        """Whether the robot moved as it had not yet, so that nothing can be said."""
        return self.doubt > NOVEL * self.noise

    @property
    def likely(self) -> bool:
        """Whether it may well be as expected."""
        return abs(self.value) < LIKELY * math.hypot(self.noise, self.doubt)


class Expectation:
    """What is expected of a measure. It is `ready` to judge after the seconds that the measure asks for."""

    def __init__(self, measure: Measure) -> None:
        self.measure = measure
        self._rows: deque[Floats] = deque(maxlen=MOST)
        self._fitted = False
        self._coefficients: Floats = np.zeros(len(measure.prior))
        self._covariance: Floats = np.diag(np.square(measure.prior))
        self._largest: Floats = np.zeros(len(measure.prior))
        self._noise = 1.0

    @property
    def ready(self) -> bool:
        """Whether enough has been learnt."""
        return len(self._rows) >= self.measure.fewest

    def learn(self, second: Second) -> None:
        """Learn from a second in which the measure is known."""
        scale = self.measure.scale(second)
        regressors = np.array(self.measure.regressors(second))
        self._largest = np.maximum(self._largest, np.abs(regressors))
        self._rows.append(np.append(regressors, self.measure.value(second)) / scale)
        self._fitted = False

    def residual(self, second: Second) -> Residual:
        """Compare a second, in which the measure is known, with what is expected."""
        if not self._fitted:
            self._fit()
        scale = self.measure.scale(second)
        regressors = np.array(self.measure.regressors(second))
        # The model is straight only as far as it has been seen: beyond, nothing is known but the prior.
        beyond = np.maximum(np.abs(regressors) - FURTHER * self._largest, 0.0) * self.measure.prior
        doubt = math.sqrt(max(float(regressors @ self._covariance @ regressors + beyond @ beyond), 0.0))
        expected = float(regressors @ self._coefficients)
        return Residual(self.measure.value(second) - expected, self._noise * scale, doubt)

    def _fit(self) -> None:
        """Fit coefficients and noise, which is in units of the scale."""
        rows = np.array(self._rows)
        regressors, values = rows[:, :-1], rows[:, -1]
        prior = np.diag(1.0 / np.square(self.measure.prior))
        weights, variance = np.ones(len(rows)), 1.0
        for _ in range(PASSES):
            information = regressors.T @ (weights[:, None] * regressors) / variance
            covariance = np.linalg.inv(information + prior)
            coefficients = covariance @ (regressors.T @ (weights * values)) / variance
            residuals = values - regressors @ coefficients
            freedom = max(len(rows) - float(np.trace(covariance @ information)), 1.0)
            variance = max(float(np.sum(weights * residuals**2)) / freedom, LEAST_NOISE**2)
            weights = np.minimum(1.0, OUTLYING * math.sqrt(variance) / np.maximum(np.abs(residuals), 1e-12))
        inflation = _memory(residuals) * (1.0 + 1.0 / math.sqrt(2.0 * freedom)) ** 2
        self._noise = math.sqrt(variance * inflation)
        self._coefficients, self._covariance = np.asarray(coefficients), np.asarray(covariance * inflation)
        self._fitted = True


def _memory(residuals: Floats) -> float:
    """Return by how much the variance of a sum of residuals exceeds that of independent ones: 1 or more."""
    power = float(residuals @ residuals)
    correlation = float(residuals[1:] @ residuals[:-1]) / power if power > 0.0 else 0.0
    correlation += (1.0 + 3.0 * correlation) / len(residuals)  # what is too little in a short series (Kendall 1954)
    correlation = min(max(correlation, 0.0), STRONGEST_MEMORY)
    return (1.0 + correlation) / (1.0 - correlation)

"""The expected value of one measure: Bayesian linear regression on seconds without a change."""

import math
from collections import deque
from typing import NamedTuple

import numpy as np

from cmr.diagnosis.live.measures import Measure
from cmr.diagnosis.live.second import Second
from cmr.recordings.signal import Floats

MOST = 120  # seconds kept; a robot that moves in new ways is learned again
PASSES = 4  # iterations in which noise and coefficients, which depend on each other, converge
OUTLYING = 2.5  # standard deviations; larger residuals get less weight (Huber)
LEAST_NOISE = 0.5  # of the measure's scale; a smaller estimate from so few seconds is not trusted
STRONGEST_MEMORY = 0.6  # largest trusted correlation of the noise of consecutive seconds
FURTHER = 1.25  # times; a regressor may exceed its previous range by this factor
LIKELY = 4.0  # standard deviations; a less likely second is not learned, as it may be a change
NOVEL = 0.5  # of the noise: with a less certain expectation, a second is learned instead of judged


class Residual(NamedTuple):
    """The difference of a second from its expected value, with the standard deviations of noise and expectation."""

    value: float
    noise: float
    doubt: float

    @property
    def novel(self) -> bool:
        """Whether the robot moved in a new way, so that no judgement is possible."""
        return self.doubt > NOVEL * self.noise

    @property
    def likely(self) -> bool:
        """Whether it is consistent with the expectation."""
        return abs(self.value) < LIKELY * math.hypot(self.noise, self.doubt)


class Expectation:
    """What is expected of a measure. It is `ready` to judge after the number of seconds that the measure requires."""

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
        # The model is linear only within its data; beyond, only the prior is known.
        beyond = np.maximum(np.abs(regressors) - FURTHER * self._largest, 0.0) * self.measure.prior
        doubt = math.sqrt(max(float(regressors @ self._covariance @ regressors + beyond @ beyond), 0.0))
        expected = float(regressors @ self._coefficients)
        return Residual(self.measure.value(second) - expected, self._noise * scale, doubt)

    def _fit(self) -> None:
        """Fit coefficients and noise, relative to the scale."""
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
    """Return the variance of a sum of residuals relative to independent ones: 1 or more."""
    power = float(residuals @ residuals)
    correlation = float(residuals[1:] @ residuals[:-1]) / power if power > 0.0 else 0.0
    correlation += (1.0 + 3.0 * correlation) / len(residuals)  # bias correction for short series (Kendall 1954)
    correlation = min(max(correlation, 0.0), STRONGEST_MEMORY)
    return (1.0 + correlation) / (1.0 - correlation)

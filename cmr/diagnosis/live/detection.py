"""Detect changes: for each change, with either sign, a cumulative sum of log likelihood ratios.

The sum (CUSUM, Page 1954) adds, for each second, the log likelihood ratio of its residuals with and without the change,
and never falls below zero. Without a change, the mean ratio is 1 whatever the drive, and one sum takes on average at
least exp(threshold) seconds to exceed the threshold (Lorden 1971). If the variance of the noise is larger by a factor f
than was learnt, exp(threshold / f). The contribution of one second is limited: this makes false alarms even rarer, and
a single odd second cannot cause one.
"""

import math
from collections.abc import Mapping
from typing import TypeAlias

from cmr.diagnosis.live.changes import CHANGES, Change, Sizes
from cmr.diagnosis.live.expectation import Residual
from cmr.diagnosis.live.second import Second

FALSE_ALARMS_PER_HOUR = 0.1
NOISE_UNDERESTIMATED = 1.3  # largest underestimation of the noise, since 20 s of learning are uncertain
SUMS = 2 * len(CHANGES)
THRESHOLD = NOISE_UNDERESTIMATED**2 * math.log(SUMS * 3600.0 / FALSE_ALARMS_PER_HOUR)
MOST_OF_A_SECOND = THRESHOLD / 3.0  # at least three seconds must support a change
SURE = 0.25  # of the shift; a measure with a less certain expectation neither supports nor contradicts it

Residuals: TypeAlias = Mapping[str, Residual]
Key: TypeAlias = tuple[str, bool]


class Detector:
    """The sums of all changes, by name and sign."""

    def __init__(self) -> None:
        self._sums: dict[Key, float] = {}
        self._since: dict[Key, int] = {}

    def reset(self) -> None:
        """Start again from zero."""
        self._sums.clear()
        self._since.clear()

    def add(self, second: Second, residuals: Residuals, present: Sizes) -> int | None:
        """Add a second; return the time [us] of the detected change, None without one.

        The residuals are those beyond the changes known to be `present`; for these, the test is whether they disappear,
        or grow by the same amount again.
        """
        for change in CHANGES:
            size = max(change.size, abs(present.get(change.name, 0.0)))
            for sign in (1, -1):
                self._add(change, sign * size, second, residuals)
        alarming = [key for key, value in self._sums.items() if value > THRESHOLD]
        return min((self._since[key] for key in alarming), default=None)

    @property
    def level(self) -> float:
        """The largest sum relative to the threshold, 0 to 1 and more."""
        return max(self._sums.values(), default=0.0) / THRESHOLD

    def _add(self, change: Change, size: float, second: Second, residuals: Residuals) -> None:
        key = (change.name, size > 0.0)
        before = self._sums.get(key, 0.0)
        ratio = log_likelihood_ratio(change, size, second, residuals)
        if before == 0.0:
            self._since[key] = second.end
        self._sums[key] = max(0.0, before + min(ratio, MOST_OF_A_SECOND))


def log_likelihood_ratio(change: Change, size: float, second: Second, residuals: Residuals) -> float:
    """Return the log likelihood ratio, in nats, of residuals with a change of this size to those without."""
    ratio = 0.0
    for name, unit_shift in change.shifts(second).items():
        residual, shift = residuals.get(name), size * unit_shift
        if residual is not None and residual.doubt <= SURE * abs(shift):
            variance = residual.noise**2 + residual.doubt**2
            ratio += shift * (residual.value - 0.5 * shift) / variance
    return ratio

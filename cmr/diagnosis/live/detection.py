"""Notice that something has changed: for each change, and both its signs, a cumulative sum of likelihood ratios.

The sum (CUSUM, Page 1954) adds for each second the logarithm of how much likelier its residuals are after the change
than before it, and never falls below zero. Nothing having changed, the mean ratio is 1, whatever the seconds were
like, and one sum takes on average at least exp(threshold) seconds to exceed the threshold (Lorden 1971). If the
variance of the noise is larger by a factor f than was learnt, exp(threshold / f). What one second may add is cut:
that makes false alarms rarer still, and one strange second is none.
"""

import math
from collections.abc import Mapping
from typing import TypeAlias

from cmr.diagnosis.live.changes import CHANGES, Change, Sizes
from cmr.diagnosis.live.expectation import Residual
from cmr.diagnosis.live.second import Second

FALSE_ALARMS_PER_HOUR = 0.1
NOISE_UNDERESTIMATED = 1.3  # times, at most: what is learnt in 20 s is that uncertain
SUMS = 2 * len(CHANGES)
THRESHOLD = NOISE_UNDERESTIMATED**2 * math.log(SUMS * 3600.0 / FALSE_ALARMS_PER_HOUR)
MOST_OF_A_SECOND = THRESHOLD / 3.0  # at least three seconds must support a change
SURE = 0.25  # of the shift; where the expectation is more uncertain, a measure does not support or contradict it

Residuals: TypeAlias = Mapping[str, Residual]
Key: TypeAlias = tuple[str, bool]


class Detector:
    """The sums of all changes, by name and sign."""

    def __init__(self) -> None:
        self._sums: dict[Key, float] = {}
        self._since: dict[Key, int] = {}

    def reset(self) -> None:
        """Begin again, as if nothing had been seen."""
        self._sums.clear()
        self._since.clear()

    def add(self, second: Second, residuals: Residuals, present: Sizes) -> int | None:
        """Add a second; return the time [us] since when something has changed, None as long as it seems not.

        The residuals are those beyond the changes that are known to be `present`; what these are looked for is that
        they go away, or come once more.
        """
        for change in CHANGES:
            size = max(change.size, abs(present.get(change.name, 0.0)))
            for sign in (1, -1):
                self._add(change, sign * size, second, residuals)
        alarming = [key for key, value in self._sums.items() if value > THRESHOLD]
        return min((self._since[key] for key in alarming), default=None)

    @property
    def level(self) -> float:
        """How near the nearest sum is to the threshold, 0 to 1 and more."""
        return max(self._sums.values(), default=0.0) / THRESHOLD

    def _add(self, change: Change, size: float, second: Second, residuals: Residuals) -> None:
        key = (change.name, size > 0.0)
        before = self._sums.get(key, 0.0)
        ratio = log_likelihood_ratio(change, size, second, residuals)
        if before == 0.0:
            self._since[key] = second.end
        self._sums[key] = max(0.0, before + min(ratio, MOST_OF_A_SECOND))


def log_likelihood_ratio(change: Change, size: float, second: Second, residuals: Residuals) -> float:
    """Return by how much the residuals are likelier, in nats, if there were a change of this size than if not."""
    ratio = 0.0
    for name, unit_shift in change.shifts(second).items():
        residual, shift = residuals.get(name), size * unit_shift
        if residual is not None and residual.doubt <= SURE * abs(shift):
            variance = residual.noise**2 + residual.doubt**2
            ratio += shift * (residual.value - 0.5 * shift) / variance
    return ratio

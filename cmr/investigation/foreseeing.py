"""Predict which effects will not show here, from the growth of the information on each so far and its largest rate.

The information on an effect that shows in every motion grows with time, on one that drifts with the square or the cube
of time. So each effect has its own exponent p, from its squared distance s now, at t, and at half of the time: p = log2
(s(t) / s(t/2)), 1 to 3. Movements chosen for the effect may add information faster, at the rate r of the best one.
Then, at time T,

    s(T) = s(t) + max(r, p s(t) / t) t / p ((T / t)^p - 1).
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

SLOWEST_GROWTH, FASTEST_GROWTH = 1.0, 3.0  # exponents: of effects that show in each motion, and of drift


@dataclass
class Growth:
    """Growth of the squared distances at which effects show in a drive; `rates` [1/s] are the best movements'."""

    rates: Mapping[str, float] = field(default_factory=dict)
    _beside: tuple[str, ...] = ()
    _times: list[float] = field(default_factory=list)
    _seen: list[Mapping[str, float]] = field(default_factory=list)

    def note(self, time: float, seen: Mapping[str, float], beside: tuple[str, ...]) -> None:
        """Note the squared distance of each effect, by name, at `time` [s], `beside` the named effects.

        Beside other names the distances differ: older ones no longer count then.
        """
        if beside != self._beside:
            self._beside, self._times, self._seen = beside, [], []
        self._times.append(time)
        self._seen.append(seen)

    def foreseen(self, name: str, time: float) -> float:
        """Return the predicted squared distance of an effect at `time` [s], with the best movements from now on."""
        now, there = self._times[-1], self._seen[-1][name]
        exponent = self._exponent(name)
        rate = max(self.rates.get(name, 0.0), exponent * there / now)
        return there + rate * now / exponent * (math.pow(max(time / now, 1.0), exponent) - 1.0)

    def _exponent(self, name: str) -> float:
        """Return the power of time with which the squared distance grew; the largest if it is unknown yet."""
        now, there = self._times[-1], self._seen[-1][name]
        if self._times[0] > 0.5 * now or there <= 0.0:
            return FASTEST_GROWTH
        half = float(np.interp(0.5 * now, self._times, [seen.get(name, 0.0) for seen in self._seen]))
        growth = math.log2(there / half) if half > 0.0 else FASTEST_GROWTH
        return min(max(growth, SLOWEST_GROWTH), FASTEST_GROWTH)

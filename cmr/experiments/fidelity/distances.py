"""Distances between sets of experiments, their uncertainty, and whether calibration reduces them.

A distance is Wasserstein's between the distributions of a metric: the mean distance that values must be moved to turn
one set into the other, in the metric's unit. Two sets of real teams also differ, by chance: that is the floor.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
RESAMPLES = 1000
INTERVAL = (2.5, 97.5)  # percent
CHANCE = 0.05  # a distance that chance exceeds more often is not significant

CLOSES = "closes the gap"
NOT_SHOWN = "not shown to close the gap"
WIDENS = "widens the gap"
NO_GAP = "no gap shown"


@dataclass(frozen=True)
class Distance:
    """A distance between two sets, in the metric's unit, with the 95 % interval of its bootstrap.

    `p_value` is the probability of such a distance by chance (permutation test).
    """

    value: float
    low: float
    high: float
    p_value: float


@dataclass(frozen=True)
class Closing:
    """The effect of one preparation of the virtual robots on the distance, compared with another.

    `share` of the distance beyond the floor is closed (1: all, 0: none, negative: it grew), with its 95 % interval; NaN
    without a gap.
    """

    verdict: str
    share: float
    low: float
    high: float


def wasserstein(a: Floats, b: Floats) -> float:
    """Return Wasserstein's distance between two sets of values: the area between their distribution functions."""
    values = np.sort(np.concatenate([a, b]))
    below_a, below_b = (np.searchsorted(np.sort(one), values[:-1], side="right") / len(one) for one in (a, b))
    return float(np.sum(np.abs(below_a - below_b) * np.diff(values)))


def distance(real: Floats, other: Floats, seed: int = 0) -> Distance:
    """Return the distance of a set of experiments to those with real robots; each is of shape (n,), without NaN."""
    random = np.random.default_rng(seed)
    value = wasserstein(real, other)
    drawn = [wasserstein(_again(real, random), _again(other, random)) for _ in range(RESAMPLES)]
    both = np.concatenate([real, other])
    shuffled = [_split(random.permutation(both), len(real)) for _ in range(RESAMPLES)]
    as_far = sum(one >= value - 1e-12 for one in shuffled)
    low, high = np.percentile(drawn, INTERVAL)
    return Distance(value, float(low), float(high), (1 + as_far) / (1 + RESAMPLES))


def closing(real: Floats, before: Floats, after: Floats, floor: float, seed: int = 0) -> Closing:
    """Return the effect of a better preparation of the virtual robots.

    `before` and `after` are of the same experiments, in the same order, with the two preparations; `floor` is the
    distance of real teams among themselves. A change counts only if its 95 % interval excludes zero.
    """
    gap = distance(real, before, seed)
    if gap.p_value > CHANCE or gap.value <= floor:
        return Closing(NO_GAP if distance(real, after, seed).p_value > CHANCE else WIDENS, *3 * [float("nan")])
    random = np.random.default_rng(seed)
    closed = []
    for _ in range(RESAMPLES):
        those, pairs = _again(real, random), random.integers(len(before), size=len(before))
        closed.append(wasserstein(those, before[pairs]) - wasserstein(those, after[pairs]))
    share = (gap.value - wasserstein(real, after)) / (gap.value - floor)
    low, high = (float(one) for one in np.percentile(closed, INTERVAL) / (gap.value - floor))
    verdict = CLOSES if low > 0.0 else WIDENS if high < 0.0 else NOT_SHOWN
    return Closing(verdict, share, low, high)


def _again(values: Floats, random: np.random.Generator) -> Floats:
    return values[random.integers(len(values), size=len(values))]


def _split(values: Floats, first: int) -> float:
    return wasserstein(values[:first], values[first:])

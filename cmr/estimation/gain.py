"""By how much the errors of free runs shrink from one model to another, and how sure that is."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from statistics import NormalDist

import numpy as np

from cmr.estimation.free_runs import Errors
from cmr.estimation.prediction import WHEELS
from cmr.recordings.signal import Floats

COVERAGE = 0.95  # of the interval
WINDOWS_IN_A_BLOCK = 2  # windows overlap, and disturbances outlast one; blocks this long are nearly independent
DRAWS = 2000  # more move the ends of the interval by less than a hundredth of its width
FEWEST_BLOCKS = 3  # from fewer nothing is known of how much they vary
GAIN_SIGNALS = {"psi": WHEELS, "yaw_rate": ("yaw_rate",), "pose": ("position",)}


@dataclass(frozen=True, kw_only=True)
class Gain:
    """By how much errors of free runs shrink on data that nothing was fitted on.

    `ratio` is the baseline's path error over that of the extended model, `interval` its 95 % interval by a block
    bootstrap. `signals` are the ratios by signal: psi, yaw_rate, pose.
    """

    ratio: float
    interval: tuple[float, float]
    signals: Mapping[str, float]


def path_rmse(errors: Errors) -> float:
    """Return the root mean square distance [m] from the real path; NaN where no path was recorded."""
    return errors.rmse("position")


def gain_of(before: Errors, after: Errors, *, seed: int = 0) -> Gain:
    """Return how many times smaller the errors `after` are than those `before`, both over the same windows.

    What was not recorded has no ratio: NaN for the path, no entry among the signals. The interval holds for other
    drives like these; that of fewer than FEWEST_BLOCKS blocks is NaN.
    """
    ratios = {name: ratio_of(before, after, *signals) for name, signals in GAIN_SIGNALS.items()}
    interval = _interval(_in_blocks(before), _in_blocks(after), seed)
    measured = {name: ratio for name, ratio in ratios.items() if math.isfinite(ratio)}
    return Gain(ratio=ratios["pose"], interval=interval, signals=measured)


def ratio_of(before: Errors, after: Errors, *signals: str) -> float:
    """Return the ratio of the root mean square errors of these signals; NaN where there is none."""
    least = after.rmse(*signals)
    return before.rmse(*signals) / least if least > 0.0 else math.nan


def _in_blocks(errors: Errors) -> Floats:
    """Return the sums of the path's squared errors over blocks of windows that follow one another; (blocks,)."""
    measured = errors.counts["position"] > 0
    number = np.floor(errors.begin / (WINDOWS_IN_A_BLOCK * errors.window)).astype(np.int64)
    _, block = np.unique(np.stack([errors.recording, number])[:, measured], axis=1, return_inverse=True)
    return np.asarray(np.bincount(block.ravel(), errors.squares["position"][measured]), np.float64)


def _interval(before: Floats, after: Floats, seed: int) -> tuple[float, float]:
    """Return the interval of the ratio by a block bootstrap: blocks are drawn with replacement, DRAWS times.

    Of few blocks the quantiles lie further out, as those of Student's t do (T. Hesterberg, What Teachers Should Know
    About the Bootstrap, The American Statistician 69, 2015, section 5.3: expanded percentiles).
    """
    from scipy.special import stdtrit

    blocks = len(before)
    if blocks < FEWEST_BLOCKS or not np.sum(after) > 0.0:
        return math.nan, math.nan
    further = math.sqrt(blocks / (blocks - 1)) * float(stdtrit(blocks - 1, (1.0 - COVERAGE) / 2.0))
    tail = NormalDist().cdf(further)
    drawn = _drawn(blocks, seed)
    squared = (drawn @ before) / np.maximum(drawn @ after, np.finfo(np.float64).tiny)
    low, high = np.sqrt(np.quantile(squared, (tail, 1.0 - tail)))
    return float(low), float(high)


@lru_cache(maxsize=2)
def _drawn(blocks: int, seed: int) -> Floats:
    """Return how often each of so many blocks is drawn, (DRAWS, blocks): the same for all gains of one recording."""
    drawn = np.random.default_rng(seed).multinomial(blocks, np.full(blocks, 1.0 / blocks), DRAWS)
    return np.asarray(drawn, np.float64)

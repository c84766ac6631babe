"""Binned means of residuals over a regressor, with standard errors, to reveal structure."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cmr.recordings.signal import Floats

BINS = 15  # between the first and the last percent of a regressor
FEWEST = 2.0  # independent samples in a bin; with fewer, the standard error is unknown
MOST_SAMPLES = 10_000  # samples used, evenly spread; more do not improve a plot
TAIL = 0.005  # share of samples excluded at either end of a regressor, where bins would be almost empty
# Lags at which correlation is computed; it is interpolated in between.
LAGS = (1, 2, 3, 4, 6, 8, 12, 16, 24, 32, 48, 64, 96, 128, 192, 256, 384, 512)
UNCORRELATED = 0.05  # correlation below which samples count as independent

Places = NDArray[np.int64]


class Bins(NamedTuple):
    """Means of a residual in bins of a regressor, shape (BINS,), or empty.

    The bins' centres, how many samples each has, its mean and its standard error; NaN if unknown.
    """

    centre: Floats
    samples: Floats
    mean: Floats
    error: Floats

    @property
    def structure(self) -> float:
        """Sum over all samples of the squared mean of their bin, minus its expectation due to noise."""
        return float(np.nansum(self.samples * (self.mean**2 - self.error**2)))


def binned(regressor: Floats, residual: Floats, edges_of_all: Floats | None = None) -> Bins:
    """Return the means of a residual in bins of equal width of a regressor, both (n,), in order of time.

    Bins with too few samples have no mean, and samples that are not finite do not count. `edges_of_all` are the edges
    for the complete residual, if known, because computing them takes longer than the rest.
    """
    known = np.isfinite(residual)
    usable = np.isfinite(regressor) & known
    edges = edges_of(regressor[usable]) if edges_of_all is None or not known.all() else edges_of_all
    if not len(edges):
        return Bins(*np.empty((4, 0)))
    usable[usable] = (regressor[usable] >= edges[0]) & (regressor[usable] <= edges[-1])
    residual, width = residual[usable], edges[1] - edges[0]
    place = np.minimum((regressor[usable] - edges[0]) / width, BINS - 1).astype(np.int64)
    count = np.bincount(place, minlength=BINS)
    mean = np.bincount(place, residual, BINS) / np.maximum(count, 1)
    deviation = residual - mean[place]
    independent = _independent(place, deviation, count)
    enough = independent > FEWEST
    variance = np.bincount(place, deviation**2, BINS) / np.maximum(count, 1)
    error = np.sqrt(variance / np.where(enough, independent - 1.0, np.nan))
    return Bins(edges[:-1] + width / 2.0, count.astype(np.float64), np.where(enough, mean, np.nan), error)


def edges_of(regressor: Floats) -> Floats:
    """Return the bin edges, shape (BINS + 1,); empty if the regressor is constant."""
    if not len(regressor):
        return np.empty(0)
    low, high = np.quantile(regressor, (TAIL, 1.0 - TAIL))
    return np.linspace(low, high, BINS + 1) if high - low > 1e-9 * max(abs(low), abs(high)) else np.empty(0)


def thinned(count: int, most: int) -> Places:
    """Return at most `most` indices into `count` samples, evenly spread."""
    return np.linspace(0, count - 1, min(count, most)).round().astype(np.int64)


def _independent(place: Places, deviation: Floats, count: Places) -> Floats:
    """Return the effective number of independent samples in each bin, shape (BINS,).

    Deviations are autocorrelated. The variance of the mean of m samples, as a multiple of that of one, is the sum of
    the correlations of all their pairs over m^2; so the pairs in each bin are counted by their lag.
    """
    power = float(deviation @ deviation)
    pairs, last, last_lag = count.astype(np.float64), count.astype(np.float64), 0  # each sample with itself
    for lag in LAGS:
        correlation = float(deviation[lag:] @ deviation[:-lag]) / power if power and lag < len(place) else 0.0
        if correlation < UNCORRELATED:
            break
        together = place[lag:][place[lag:] == place[:-lag]]
        now, steps = correlation * np.bincount(together, minlength=BINS), lag - last_lag
        pairs += (steps + 1) * now + (steps - 1) * last  # twice the sum over the lags from the last one to this
        last, last_lag = np.asarray(now), lag
    return np.asarray(count**2 / np.maximum(pairs, 1.0))

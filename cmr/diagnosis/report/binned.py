"""Look for structure in residuals: their means in bins of a regressor, with standard errors."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cmr.recordings.signal import Floats

BINS = 15  # between the first and the last percent of a regressor
FEWEST = 2.0  # independent samples in a bin; from fewer no standard error is known
MOST_SAMPLES = 10_000  # that are looked at, evenly spread; more sharpen no picture
TAIL = 0.005  # share of the samples left out at either end of a regressor, where bins would be all but empty
# Samples between two that are compared; between these numbers, correlation is taken to change evenly.
LAGS = (1, 2, 3, 4, 6, 8, 12, 16, 24, 32, 48, 64, 96, 128, 192, 256, 384, 512)
UNCORRELATED = 0.05  # correlation from which on samples count as independent

Places = NDArray[np.int64]


class Bins(NamedTuple):
    """Means of a residual in bins of a regressor, shape (BINS,), or empty.

    The bins' centres, how many samples each has, its mean and the standard error of that; NaN where that is not known.
    """

    centre: Floats
    samples: Floats
    mean: Floats
    error: Floats

    @property
    def structure(self) -> float:
        """Sum over all samples of the squared mean of their bin, less what standard errors make of it by chance."""
        return float(np.nansum(self.samples * (self.mean**2 - self.error**2)))


def binned(regressor: Floats, residual: Floats, edges_of_all: Floats | None = None) -> Bins:
    """Return the means of a residual in bins of equal width of a regressor, both (n,), in order of time.

    Bins with too few samples have no mean, and samples that are not finite do not count. `edges_of_all` are the borders
    where all of the residual counts, if they are known: to find them takes longer than all else.
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
    """Return the borders of the bins, shape (BINS + 1,); none where the regressor does not vary."""
    if not len(regressor):
        return np.empty(0)
    low, high = np.quantile(regressor, (TAIL, 1.0 - TAIL))
    return np.linspace(low, high, BINS + 1) if high - low > 1e-9 * max(abs(low), abs(high)) else np.empty(0)


def thinned(count: int, most: int) -> Places:
    """Return at most `most` indices into `count` samples, evenly spread."""
    return np.linspace(0, count - 1, min(count, most)).round().astype(np.int64)


def _independent(place: Places, deviation: Floats, count: Places) -> Floats:
    """Return how many independent samples the samples of each bin are worth, shape (BINS,).

    Deviations last: neighbours in time err alike. The variance of the mean of m samples, as a multiple of that of one,
    is the sum of the correlations of all their pairs over m^2; so the pairs in each bin are counted by their lag.
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

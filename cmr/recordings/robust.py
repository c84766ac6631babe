"""Robust statistics, insensitive to a minority of wrong values."""

import numpy as np
from numpy.typing import NDArray

from cmr.recordings.signal import Floats

TO_DEVIATION = 1.4826  # standard deviations of a normal distribution per median absolute deviation
LEAST_WEIGHT = 1e-100  # smaller weights would overflow in a division
NEGLIGIBLE = 1e-12  # of the total weight; less is negligible
LOCAL = 100  # samples over which local noise is taken
LOUDEST = 2.0  # times the overall noise: a larger value indicates wrong values
SHARES = (0.75, 0.9)
# Quantiles of the distance from 0 of normal noise in one and two dimensions, in standard deviations.
UNIT_QUANTILE = {(1, 0.75): 1.1503, (1, 0.9): 1.6449, (2, 0.75): 1.6651, (2, 0.9): 2.1460}


def running_median(values: Floats, half: int, run: NDArray[np.int64] | None = None) -> Floats:
    """Return the median of each value and its `half` neighbours on either side, shape (n,); mirrored at the ends.

    `run`, shape (n,), not decreasing, numbers the runs of values that are neighbours; without it all are of one.
    """
    half = min(half, len(values) - 1)
    if half < 1:
        return values.copy()
    # Sorting the windows all at once, by exchanges of whole arrays, is faster than one after another.
    columns = [values[index] for index in _mirrored(len(values), half, run)]
    for done in range(half + 1):
        for k in range(2 * half - done):
            low, high = columns[k], columns[k + 1]
            columns[k], columns[k + 1] = np.minimum(low, high), np.maximum(low, high)
    return columns[half]


def quantile(values: Floats, share: float) -> float:
    """Return the value below which about this share of the values lies; 0 without values."""
    if not len(values):
        return 0.0
    rank = min(int(share * len(values)), len(values) - 1)
    return float(np.partition(values, rank)[rank])


def spread(values: Floats) -> float:
    """Return the robust standard deviation of values about 0, from their median magnitude; 0 without values."""
    return TO_DEVIATION * quantile(np.abs(values), 0.5)


def local_noise(sizes: Floats, dimensions: int) -> Floats:
    """Return the standard deviation around each value, shape (n,), of normal noise in one or two dimensions.

    `sizes` are the distances from 0, of which a tenth may be wrong. A quiet part gets the overall noise, so that the
    first motion after it is not taken for an error.
    """
    ranks = [int(share * len(sizes)) for share in SHARES]
    ordered = np.partition(sizes, ranks)
    overall = max(
        float(ordered[rank]) / UNIT_QUANTILE[dimensions, share] for rank, share in zip(ranks, SHARES, strict=True)
    )
    blocks = len(sizes) // LOCAL
    if blocks < 2:
        return np.full(len(sizes), overall)
    rows = np.partition(sizes[: blocks * LOCAL].reshape(blocks, LOCAL), int(SHARES[0] * LOCAL), axis=1)
    noise = np.clip(rows[:, int(SHARES[0] * LOCAL)] / UNIT_QUANTILE[dimensions, SHARES[0]], overall, LOUDEST * overall)
    noise = np.maximum(noise, np.maximum(np.append(noise[1:], 0.0), np.append(0.0, noise[:-1])))
    return np.asarray(noise[np.minimum(np.arange(len(sizes)) // LOCAL, blocks - 1)])


def running_largest(values: Floats, half: int, run: NDArray[np.int64] | None = None) -> Floats:
    """Return the largest of each value and its `half` neighbours on either side in its run, shape (n,)."""
    first, last = run_ends(np.zeros(len(values), np.int64) if run is None else run)
    ahead = behind = values
    place, seen = np.arange(len(values)), 1
    while seen < half + 1:  # twice as many each time
        more = min(seen, half + 1 - seen)
        ahead = np.maximum(ahead, ahead[np.minimum(place + more, last)])
        behind = np.maximum(behind, behind[np.maximum(place - more, first)])
        seen += more
    return np.maximum(ahead, behind)


def running_range(values: Floats, half: int, run: NDArray[np.int64] | None = None) -> Floats:
    """Return the largest less the smallest of each value and its `half` neighbours in its run, shape (n,)."""
    return running_largest(values, half, run) + running_largest(-values, half, run)


def ratio(y: Floats, x: Floats) -> float:
    """Return the factor c that minimises the sum of abs(y - c x); 0 if x is 0 throughout."""
    weight = np.abs(x)
    total = float(weight.sum())
    if not total > LEAST_WEIGHT:
        return 0.0
    used = weight > NEGLIGIBLE * total
    quotient = y[used] / x[used]
    order = np.argsort(quotient)
    middle = np.searchsorted(np.cumsum(weight[used][order]), 0.5 * total)
    return float(quotient[order][min(int(middle), len(order) - 1)])


def wrapped(angle: Floats) -> Floats:
    """Return angles [rad] between -pi and pi."""
    return np.asarray((angle + np.pi) % (2.0 * np.pi) - np.pi)


def run_ends(run: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the first and last index of the run that each value, shape (n,), belongs to."""
    begins = np.append(0, np.flatnonzero(np.diff(run)) + 1)[: len(run)]
    lengths = np.diff(begins, append=len(run))
    return np.repeat(begins, lengths), np.repeat(begins + lengths - 1, lengths)


def _mirrored(count: int, half: int, run: NDArray[np.int64] | None) -> list[NDArray[np.int64]]:
    """Return the places of neighbours -half to half of each value, each of shape (n,), mirrored at its run's ends."""
    place = np.arange(count)
    first, last = run_ends(np.zeros(count, np.int64) if run is None else run)
    columns = []
    for k in range(-half, half + 1):
        there = place + k
        there = np.where(there < first, 2 * first - there, there)
        there = np.where(there > last, 2 * last - there, there)
        columns.append(np.clip(there, first, last))
    return columns

"""Deviations of values near the ends of runs from a line through their neighbours.

Inside a run the median of a value's neighbours follows a steady drift. At an end a value has neighbours on one side
only, so the median lags behind the drift: the offset of a slipping robot at the beginning or end of a piece would look
like an outlier. A straight line through the last few values, with the median of all slopes (Theil-Sen), follows the
drift, and is robust to a few wrong values.
"""

import numpy as np
from numpy.typing import NDArray

from cmr.recordings.robust import run_ends
from cmr.recordings.signal import Floats, Mask

FEWEST = 6  # values required to identify outliers from a line


def off_the_ends(time: Floats, values: Floats, half: int, run: NDArray[np.int64]) -> tuple[Floats, Mask, Mask]:
    """Return the deviation of each value from the line at its end, which values are near an end, and which are
    undetermined.

    All are of shape (n,), as `time` [s], `values`, and the number of the `run` that each is of. Near are the first and
    the last `half` of each run. Runs of fewer than `FEWEST` values are undetermined.
    """
    first, last = run_ends(run)
    place = np.arange(len(run))
    untold = last - first + 1 < FEWEST
    off = np.zeros(len(values))
    near = np.zeros(len(values), np.bool_)
    begins, ends = np.unique(first), np.unique(last)
    for length in np.unique(np.minimum(ends - begins + 1, 2 * half + 1)):
        if length < FEWEST:
            continue
        same = np.minimum(ends - begins + 1, 2 * half + 1) == length
        for start, at_begin in ((begins[same], True), (ends[same] - length + 1, False)):
            window = start[:, None] + np.arange(length)
            here = off_the_line(time[window], values[window])
            shown = min(half, int(length))
            shown_part = slice(0, shown) if at_begin else slice(length - shown, length)
            off[window[:, shown_part]] = here[:, shown_part]
    near = (place - first < half) | (last - place < half)
    return off, near, untold


def off_the_line(time: Floats, values: Floats) -> Floats:
    """Return how far values stand off a straight line over time, each of shape (k, n): a line for each of k rows."""
    one, other = np.triu_indices(values.shape[1], 1)
    dt = time[:, other] - time[:, one]
    slope = np.median((values[:, other] - values[:, one]) / dt, axis=1, keepdims=True)
    level = values - slope * (time - time[:, :1])
    return np.asarray(level - np.median(level, axis=1, keepdims=True))

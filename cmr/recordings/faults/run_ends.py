"""How far the values at the ends of runs stand off the line through those beside them.

In the middle of a run the median of a value's neighbours goes with a steady drift. At an end it has neighbours on one
side only and would lag behind the drift: what a robot that slips is off by at the beginning of a piece, or at its end,
would look like an outlier. A straight line through the last few values, by the median of all their slopes
(Theil-Sen), goes with it, and a few wrong values do not move it.
"""

import numpy as np
from numpy.typing import NDArray

from cmr.recordings.robust import run_ends
from cmr.recordings.signal import Floats, Mask

FEWEST = 6  # values from which a line tells which of them stands off it


def off_the_ends(time: Floats, values: Floats, half: int, run: NDArray[np.int64]) -> tuple[Floats, Mask, Mask]:
    """Return how far each value stands off the line of its end, which are near an end, and which nothing tells of.

    All are of shape (n,), as `time` [s], `values`, and the number of the `run` that each is of. Near are the first and
    the last `half` of each run. Of runs of fewer than `FEWEST` values nothing is reported.
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

"""The loop over all robots of `bounding`."""

import numpy as np
from numpy.typing import NDArray

from cmr.model.compiled import compiled

Floats = NDArray[np.float64]


@compiled("void(f8[:, ::1], f8[:, ::1])")
def bound(duties: Floats, bounded: Floats) -> None:
    """Write duties (2, n) clipped to [-1, 1]; a robot of which one is no number stands."""
    for i in range(duties.shape[1]):
        left, right = duties[0, i], duties[1, i]
        known = ~(np.isnan(left) | np.isnan(right))
        bounded[0, i] = min(max(left, -1.0), 1.0) if known else 0.0
        bounded[1, i] = min(max(right, -1.0), 1.0) if known else 0.0

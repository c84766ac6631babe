"""Least squares with unknowns that are not negative, for two or three of them.

All choices of unknowns that are zero are tried; SciPy's `nnls` does for many unknowns what this does for few, but to
import it takes longer than many a fit.
"""

from itertools import product

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


def nonnegative(normal: Floats, right: Floats) -> Floats:
    """Return the x (n,) of x >= 0 for which x N x / 2 - x r is least; N (n, n) is positive definite, r (n,)."""
    best, least = np.zeros(len(right)), 0.0
    for chosen in product((False, True), repeat=len(right)):
        free = np.flatnonzero(chosen)
        if not len(free):
            continue
        part = np.linalg.solve(normal[np.ix_(free, free)], right[free])
        value = -0.5 * float(part @ right[free])
        if np.all(part >= 0.0) and value < least:
            best, least = np.zeros(len(right)), value
            best[free] = part
    return best

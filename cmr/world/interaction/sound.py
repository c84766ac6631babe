"""Whether what is said of robots can be."""

import numpy as np
from numpy.typing import NDArray

from cmr.model.compiled import compiled

Floats = NDArray[np.float64]


@compiled("b1(f8, f8[::1], f8[::1], f8[::1], f8[::1], f8[::1])")
def all_sound(largest: float, x: Floats, y: Floats, theta: Floats, psi_left: Floats, psi_right: Floats) -> bool:
    """Return whether all numbers of n robots are at most `largest` from 0; one that is no number is not."""
    sound = True
    for column in (x, y, theta, psi_left, psi_right):
        for i in range(len(column)):
            sound &= abs(column[i]) <= largest
    return sound

"""Compiled loops over all robots: limit duties, check bounds, compute velocities."""

import numpy as np
from numpy.typing import NDArray

from cmr.model.compiled import compiled
from cmr.model.elementary import sincos

Floats = NDArray[np.float64]


@compiled("void(f8[:, ::1], f8[:, ::1])")
def bound(duties: Floats, bounded: Floats) -> None:
    """Write duties (2, n) clipped to [-1, 1]; a robot with a NaN gets 0."""
    for i in range(duties.shape[1]):
        left, right = duties[0, i], duties[1, i]
        known = ~(np.isnan(left) | np.isnan(right))
        bounded[0, i] = min(max(left, -1.0), 1.0) if known else 0.0
        bounded[1, i] = min(max(right, -1.0), 1.0) if known else 0.0


@compiled("b1(f8, f8[::1], f8[::1], f8[::1], f8[::1], f8[::1])")
def all_sound(largest: float, x: Floats, y: Floats, theta: Floats, psi_left: Floats, psi_right: Floats) -> bool:
    """Return whether the magnitudes of all numbers of n robots are at most `largest`; False for NaN."""
    sound = True
    for column in (x, y, theta, psi_left, psi_right):
        for i in range(len(column)):
            sound &= abs(column[i]) <= largest
    return sound


@compiled("void(f8[::1], f8[::1], f8[::1], f8, f8[:, ::1])")
def velocities_of(theta: Floats, psi_left: Floats, psi_right: Floats, wheel_radius: float, velocity: Floats) -> None:
    """Write the velocities (2, n) [m/s] of robots with headings [rad] and wheel speeds [rad/s]."""
    speed_x, speed_y = velocity[0], velocity[1]
    for i in range(len(theta)):
        sine, cosine = sincos(theta[i])
        speed = (0.5 * wheel_radius) * (psi_left[i] + psi_right[i])
        speed_x[i], speed_y[i] = speed * cosine, speed * sine

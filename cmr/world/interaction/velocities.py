"""How fast robots go, and where to."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from cmr.model.compiled import compiled
from cmr.model.elementary import sincos

Floats = NDArray[np.float64]


@compiled("void(f8[::1], f8[::1], f8[::1], f8, f8[:, ::1])")
def velocities_of(theta: Floats, psi_left: Floats, psi_right: Floats, wheel_radius: float, velocity: Any) -> None:
    """Write the velocities (2, n) [m/s] of robots with headings [rad] and wheel speeds [rad/s]."""
    speed_x, speed_y = velocity[0], velocity[1]
    for i in range(len(theta)):
        sine, cosine = sincos(theta[i])
        speed = (0.5 * wheel_radius) * (psi_left[i] + psi_right[i])
        speed_x[i], speed_y[i] = speed * cosine, speed * sine

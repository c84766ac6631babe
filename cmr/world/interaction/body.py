"""Robots as bodies: their positions, and a default radius."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cmr.model.parameters import Number

# Half the base width, and 30 % more: a body reaches beyond its wheels. Radius over base width, by their data sheets:
# TurtleBot3 Burger 0.105 / 0.160 m, e-puck 0.035 / 0.053 m, Khepera IV 0.070 / 0.105 m.
RADIUS_PER_BASE_WIDTH = 0.65


class Bodies(NamedTuple):
    """Robots as discs, all arrays in the same order: id and origin of each, and whether this simulator owns it.

    `pose` (3, n) are x, y [m] and theta [rad; world frame], `radius` (n,) is in m. Twins are not bodies and are not
    included.
    """

    robot_id: NDArray[np.int64]
    origin: NDArray[np.int64]
    own: NDArray[np.bool_]
    pose: NDArray[np.float64]
    radius: NDArray[np.float64]


def body_radius(base_width: Number) -> Number:
    """Return the default radius [m] of a robot with this base width [m]."""
    return RADIUS_PER_BASE_WIDTH * base_width

"""Robots as bodies: where they are, and how large they are taken to be where nobody says so."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cmr.model.parameters import Number

# Half the base width, and 30 % more: a body reaches beyond its wheels. Radius over base width, by their data sheets:
# TurtleBot3 Burger 0.105 / 0.160 m, e-puck 0.035 / 0.053 m, Khepera IV 0.070 / 0.105 m.
RADIUS_PER_BASE_WIDTH = 0.65


class Bodies(NamedTuple):
    """Robots as discs, all arrays in the same order: id and origin of each, and whether the simulator asked owns it.

    `pose` (3, n) are x, y [m] and theta [rad; world frame], `radius` (n,) is in m. Twins, which are no bodies, are not
    among them.
    """

    robot_id: NDArray[np.int64]
    origin: NDArray[np.int64]
    own: NDArray[np.bool_]
    pose: NDArray[np.float64]
    radius: NDArray[np.float64]


def body_radius(base_width: Number) -> Number:
    """Return the radius [m] of the disc that a robot of this base width [m] is taken for."""
    return RADIUS_PER_BASE_WIDTH * base_width

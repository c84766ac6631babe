"""Rotations about the vertical as quaternions, as ROS represents headings."""

import math


def heading(x: float, y: float, z: float, w: float) -> float:
    """Return the rotation about the vertical [rad] of a quaternion of any length; NaN if it has none."""
    squares = x * x + y * y + z * z + w * w
    if not 0.0 < squares < math.inf:
        return math.nan
    return math.atan2(2.0 * (w * z + x * y), w * w + x * x - y * y - z * z)


def turned(theta: float) -> tuple[float, float]:
    """Return z and w of the unit quaternion that turns by `theta` [rad] about the vertical; x and y are 0."""
    return math.sin(0.5 * theta), math.cos(0.5 * theta)

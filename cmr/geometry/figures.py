"""Figures on the floor: a figure-eight to drive, and lines, grids and circles of robots at their start."""

import math

import numpy as np

from cmr.geometry.places import Pose

POINTS = 200  # of one figure-eight
LENGTH = 6.097  # of Gerono's lemniscate, relative to the distance from its crossing to a tip


def figure_eight(x: float, y: float, theta: float, size: float, laps: int = 1) -> tuple[list[float], list[float]]:
    """Return the points [m; world frame] of a figure-eight that starts and ends at its crossing.

    The curve is Gerono's lemniscate, `size` [m] from the crossing to each tip; the robot leaves (x, y) with heading
    `theta` [rad], turns right through the first lobe and left through the second.
    """
    t = np.linspace(0.0, 2.0 * np.pi * laps, POINTS * laps + 1)
    along, across = size * np.sin(t), size * np.sin(t) * np.cos(t)
    rotation = theta - math.pi / 4.0  # the curve leaves its crossing at 45 degrees
    return (
        (x + along * math.cos(rotation) - across * math.sin(rotation)).tolist(),
        (y + along * math.sin(rotation) + across * math.cos(rotation)).tolist(),
    )


def line(count: int, spacing: float, first: Pose) -> list[Pose]:
    """Return poses one behind the other, `spacing` [m] apart, all with the heading of the first."""
    dx, dy = math.cos(first.theta) * spacing, math.sin(first.theta) * spacing
    return [Pose(first.x - k * dx, first.y - k * dy, first.theta) for k in range(count)]


def grid(count: int, spacing: float, centre: Pose) -> list[Pose]:
    """Return poses in rows and columns `spacing` [m] apart around a centre, which stays free.

    Their number per side is even, so the nearest stand 0.7 spacings from the centre. All have its heading.
    """
    columns = math.ceil(math.sqrt(count))
    columns += columns % 2
    middle = (columns - 1) / 2.0
    return [
        Pose(centre.x + (k % columns - middle) * spacing, centre.y + (k // columns - middle) * spacing, centre.theta)
        for k in range(count)
    ]


def circle(count: int, spacing: float, centre: Pose) -> list[Pose]:
    """Return poses on a circle, neighbours `spacing` [m] apart, each headed `theta` to the left of outwards.

    The circle has a radius of one spacing at least; the first robot stands in the direction of x.
    """
    radius = spacing if count < 3 else max(spacing / (2.0 * math.sin(math.pi / count)), spacing)
    bearings = [2.0 * math.pi * k / count for k in range(count)]
    return [Pose(centre.x + radius * math.cos(b), centre.y + radius * math.sin(b), b + centre.theta) for b in bearings]

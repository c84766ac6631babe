"""Poses, points, discs and walls as plain numbers in m and rad, in the world frame."""

import math
from typing import NamedTuple, TypeAlias

Point: TypeAlias = tuple[float, float]  # x, y [m]


class Pose(NamedTuple):
    """A place [m; world frame] and a heading [rad, counter-clockwise from x]."""

    x: float
    y: float
    theta: float = 0.0


class Disc(NamedTuple):
    """A round obstacle: its centre and radius [m; world frame]."""

    x: float
    y: float
    radius: float


class Wall(NamedTuple):
    """A straight wall from one point to another [m; world frame]."""

    x1: float
    y1: float
    x2: float
    y2: float


def distance_to(point: Pose, wall: Wall) -> float:
    """Return how far [m] a point is from a wall."""
    dx, dy = wall.x2 - wall.x1, wall.y2 - wall.y1
    length = dx * dx + dy * dy
    along = ((point.x - wall.x1) * dx + (point.y - wall.y1) * dy) / length if length else 0.0
    share = min(max(along, 0.0), 1.0)
    return math.hypot(wall.x1 + share * dx - point.x, wall.y1 + share * dy - point.y)

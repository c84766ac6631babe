"""Shapes of robots, digits and circles: vertices and faces, in metres, and rotations about the vertical."""

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Mesh = tuple[Floats, NDArray[np.int64]]  # vertices (v, 3) and faces (f, 3)

LENGTH, WIDTH, HEIGHT = 0.20, 0.15, 0.07  # m, of a drawn robot; its true size is unknown
NOSE = 0.05  # m of the length that taper to the front
CLEARANCE = 0.015  # m under the body
WHEEL_LENGTH, WHEEL_WIDTH = 0.07, 0.03  # m
DIGIT_HEIGHT, DIGIT_WIDTH, STROKE = 0.075, 0.034, 0.009  # m
DIGIT_PITCH = 0.058  # m from digit to digit
# Segments of a seven-segment digit: position in half widths and half heights, and whether vertical.
BARS = {"a": (0, 2, False), "b": (1, 1, True), "c": (1, -1, True), "d": (0, -2, False)}
BARS |= {"e": (-1, -1, True), "f": (-1, 1, True), "g": (0, 0, False)}
LIT = ("abcdef", "bc", "abged", "abgcd", "fgbc", "afgcd", "afgedc", "abc", "abcdefg", "abcdfg")  # by digit


def robot() -> Mesh:
    """Return a body with a nose that points along x, and four wheels; the origin is on the floor below its centre."""
    side = WIDTH / 2
    parts = [prism(_outline(), CLEARANCE, CLEARANCE + HEIGHT)]
    for x in (-0.55, 0.4):
        for y in (-1.0, 1.0):
            parts.append(_box(x * LENGTH / 2, y * (side + WHEEL_WIDTH / 2), WHEEL_LENGTH, WHEEL_WIDTH, 0.0, 0.06))
    return _joined(parts)


def plain_robot() -> Mesh:
    """Return only the top of a robot's body: with thousands, no more is visible, and they draw much faster."""
    corners = [np.array((x, y, CLEARANCE + HEIGHT)) for x, y in _outline()]
    return np.array(corners), np.array([(0, k, k + 1) for k in range(1, len(corners) - 1)])


def _outline() -> list[tuple[float, float]]:
    """Return the corners of a robot's body, counter-clockwise."""
    back, side, shoulder, front = -LENGTH / 2, WIDTH / 2, LENGTH / 2 - NOSE, LENGTH / 2
    return [(back, -side), (shoulder, -side), (front, 0.0), (shoulder, side), (back, side)]


def digit(number: int) -> Mesh:
    """Return a digit that lies flat, to be read from above with y upwards; its centre is the origin."""
    parts = []
    for name in LIT[number]:
        across, along, is_upright = BARS[name]
        x, y = across * DIGIT_WIDTH / 2, along * DIGIT_HEIGHT / 4
        size = (STROKE, DIGIT_HEIGHT / 2 + STROKE) if is_upright else (DIGIT_WIDTH + STROKE, STROKE)
        parts.append(_patch(x, y, *size))
    return _joined(parts)


def cylinder(radius: float, height: float, sides: int = 40) -> Mesh:
    """Return an upright cylinder [m] that stands on the floor."""
    return prism([(radius * np.cos(a), radius * np.sin(a)) for a in _angles(sides)], 0.0, height)


def circle(x: float, y: float, radius: float, sides: int = 32) -> Floats:
    """Return the ends (n, 2, 2) of lines around a point [m]."""
    angles = _angles(sides)
    return closed(np.stack([x + radius * np.cos(angles), y + radius * np.sin(angles)], axis=1))


def closed(corners: Floats) -> Floats:
    """Return the ends (n, 2, 2) of the sides of a polygon with these corners (n, 2)."""
    return np.stack([corners, np.roll(corners, -1, axis=0)], axis=1)


def chain(points: Floats) -> Floats:
    """Return the ends (n - 1, 2, 2) of lines from each point (n, 2) to the next."""
    return np.stack([points[:-1], points[1:]], axis=1)


def at_height(ends: Floats, height: float) -> Floats:
    """Return lines of the floor (n, 2, 2) as lines in space (n, 2, 3), at this height [m]."""
    return np.concatenate([ends, np.full((*ends.shape[:2], 1), height)], axis=2)


def turned(theta: Floats) -> Floats:
    """Return unit quaternions (n, 4), real part first, of turns about the vertical [rad]."""
    result = np.zeros((len(theta), 4))
    result[:, 0], result[:, 3] = np.cos(theta / 2), np.sin(theta / 2)
    return result


def prism(outline: list[tuple[float, float]], bottom: float, top: float) -> Mesh:
    """Return an upright prism over a convex outline that runs counter-clockwise; corners are not shared by faces."""
    low = [np.array((x, y, bottom)) for x, y in outline]
    high = [np.array((x, y, top)) for x, y in outline]
    vertices: list[Floats] = []
    faces: list[tuple[int, int, int]] = []
    for polygon in ([*high], [*low][::-1], *_walls(low, high)):
        first = len(vertices)
        vertices += polygon
        faces += [(first, first + k, first + k + 1) for k in range(1, len(polygon) - 1)]
    return np.array(vertices), np.array(faces)


def _walls(low: list[Floats], high: list[Floats]) -> list[list[Floats]]:
    count = len(low)
    return [[low[k], low[(k + 1) % count], high[(k + 1) % count], high[k]] for k in range(count)]


def _box(x: float, y: float, length: float, width: float, bottom: float, top: float) -> Mesh:
    back, front, right, left = x - length / 2, x + length / 2, y - width / 2, y + width / 2
    return prism([(back, right), (front, right), (front, left), (back, left)], bottom, top)


def _patch(x: float, y: float, length: float, width: float) -> Mesh:
    """Return a flat rectangle visible from above: thousands of digits are drawn."""
    corners = [(-1, -1), (1, -1), (1, 1), (-1, 1)]
    vertices = np.array([(x + i * length / 2, y + j * width / 2, 0.0) for i, j in corners])
    return vertices, np.array([(0, 1, 2), (0, 2, 3)])


def _joined(parts: list[Mesh]) -> Mesh:
    firsts = np.cumsum([0] + [len(vertices) for vertices, _ in parts[:-1]])
    faces = [triangles + first for (_, triangles), first in zip(parts, firsts, strict=True)]
    vertices: Floats = np.concatenate([vertices for vertices, _ in parts])
    return vertices, np.concatenate(faces)


def _angles(sides: int) -> Floats:
    return np.linspace(0.0, 2 * np.pi, sides, endpoint=False)

"""Corners of tags from the edges of their black squares, to a few hundredths of a pixel.

OpenCV's own methods are slower or less accurate (scripts/benchmarks/camera.py measures them): its AprilTag refinement
detects all quads again, and blur shifts its sub-pixel corners inwards. Blur does not move a straight edge: here a line
is fitted to each of a square's four sides, through some twenty crossings from black to white, and the corners are the
intersections of these lines.
"""

import numpy as np
from numpy.typing import NDArray

from cmr.camera.lens import Floats, Lens

# Shares of a side at which the edge is located: away from the corners, which blur rounds.
ALONG = np.linspace(0.08, 0.92, 24)
ACROSS = np.linspace(-1.0, 1.0, 13)  # shares of the reach
REACH = 3.0  # pixels to each side of the estimated edge,
REACH_CELLS = 0.7  # and at most this share of a tag's cell, beyond which its pattern begins
LOOKS = 2  # iterations; the second searches around the result of the first
CELLS = 8  # of a tag of 36h11 along a side, with its black border


def refined(picture: Floats, corners: Floats, lens: Lens) -> Floats:
    """Return the corners (n, 4, 2) of tags in undistorted pixels, from approximate corners in pixels of the picture.

    `picture` (height, width) is grey; the tags are black on white. A corner that cannot be refined is returned
    unchanged.
    """
    count = len(corners)
    for _ in range(LOOKS):
        points, weights = _crossings(picture, corners)
        lines = _lines(points.reshape(-1, len(ALONG), 2), weights.reshape(-1, len(ALONG)))
        found = _meetings(*(part.reshape(count, 4, 2) for part in lines))
        corners = np.where(_near(found, corners), found, corners)
    straight = lens.straight(points.reshape(-1, 2)).reshape(-1, len(ALONG), 2)
    lines = _lines(straight, weights.reshape(-1, len(ALONG)))
    found = _meetings(*(part.reshape(count, 4, 2) for part in lines))
    rough = lens.straight(corners.reshape(-1, 2)).reshape(count, 4, 2)
    return np.where(_near(found, rough), found, rough)


def _crossings(picture: Floats, corners: Floats) -> tuple[Floats, Floats]:
    """Return the crossings of each side of each tag (n, 4, along, 2), and their weights (n, 4, along)."""
    following = np.roll(corners, -1, axis=1)
    side = following - corners
    length = np.maximum(np.linalg.norm(side, axis=2, keepdims=True), 1e-9)
    # Corners go round clockwise as one sees them, so outwards is to the left of each side (v points down).
    outwards = np.stack([side[..., 1], -side[..., 0]], axis=2) / length
    reach = np.minimum(REACH, REACH_CELLS * length.min(axis=1, keepdims=True) / CELLS)
    offsets = ACROSS * reach
    feet = corners[:, :, None] + ALONG[:, None] * side[:, :, None]
    places = feet[:, :, :, None] + offsets[:, :, None, :, None] * outwards[:, :, None, None]
    steps = np.maximum(np.diff(_brightness(picture, places), axis=3), 0.0) ** 2
    middles = (offsets[..., 1:] + offsets[..., :-1]) / 2.0
    total = steps.sum(axis=3)
    off = (steps * middles[:, :, None]).sum(axis=3) / np.maximum(total, 1e-9)
    return feet + off[..., None] * outwards[:, :, None], np.sqrt(total)


def _brightness(picture: Floats, places: Floats) -> Floats:
    """Return the brightness at places between pixels; beyond the picture, that of its edge."""
    height, width = picture.shape
    u = np.clip(places[..., 0], 0.0, width - 1.001)
    v = np.clip(places[..., 1], 0.0, height - 1.001)
    left, top = u.astype(np.intp), v.astype(np.intp)
    u, v = u - left, v - top
    first = top * width + left
    flat = picture.ravel()
    upper = flat[first] * (1.0 - u) + flat[first + 1] * u
    lower = flat[first + width] * (1.0 - u) + flat[first + width + 1] * u
    brightness: Floats = upper * (1.0 - v) + lower * v
    return brightness


def _lines(points: Floats, weights: Floats) -> tuple[Floats, Floats]:
    """Return for each line a point on it (n, 2) and its direction (n, 2), fitted to points (n, k, 2).

    Points far off the line of the others, where something covers the edge, have no weight.
    """
    weights = weights + 1e-12
    for _ in range(2):
        total = weights.sum(axis=1)[:, None]
        middle = (weights[..., None] * points).sum(axis=1) / total
        x, y = np.moveaxis(points - middle[:, None], 2, 0)
        xx, yy, xy = ((weights * product).sum(axis=1) for product in (x * x, y * y, x * y))
        angle = 0.5 * np.arctan2(2.0 * xy, xx - yy)
        along = np.stack([np.cos(angle), np.sin(angle)], axis=1)
        off = np.abs(y * along[:, :1] - x * along[:, 1:])
        usual = np.maximum(np.median(off, axis=1, keepdims=True), 0.02)
        weights = np.where(off <= 4.0 * usual, weights, 1e-12)
    return middle, along


def _meetings(places: Floats, directions: Floats) -> Floats:
    """Return corners (n, 4, 2): the intersections of each side's line with that of the side before."""
    earlier, along = np.roll(places, 1, axis=1), np.roll(directions, 1, axis=1)
    cross = along[..., 0] * directions[..., 1] - along[..., 1] * directions[..., 0]
    gap = places - earlier
    cross = np.where(np.abs(cross) < 1e-6, np.nan, cross)
    reach = (gap[..., 0] * directions[..., 1] - gap[..., 1] * directions[..., 0]) / cross
    return earlier + reach[..., None] * along


def _near(found: Floats, rough: Floats) -> NDArray[np.bool_]:
    """Return per tag whether all of its corners are near the approximate ones (n, 1, 1)."""
    off = np.linalg.norm(found - rough, axis=2).max(axis=1)
    near: NDArray[np.bool_] = (off < 2.0 * REACH)[:, None, None]
    return near

"""A planar range sensor: rays in all directions against discs and walls.

A disc is tested only against the rays between its two tangents, a wall against those between the ends of its part
within range, and only discs in the cells around the robot are tested: the cost of a scan depends on what is nearby, not
on rays times objects.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cmr.model.compiled import compiled
from cmr.model.elementary import sincos
from cmr.world.interaction.cells import binned_around

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]

MOST_RAYS = 10_000
ROUNDING = 1e-9  # rays; a body that ends exactly on a ray is hit by it


@dataclass(frozen=True)
class RangeSensor:
    """Rays evenly around a robot's centre: the first at `first` [rad, 0 ahead], `step` [rad] apart, up to `reach` [m].

    Raises ValueError for impossible values.
    """

    rays: int = 360
    first: float = -math.pi
    step: float = 2.0 * math.pi / 360
    reach: float = 5.0

    def __post_init__(self) -> None:
        if not 1 <= self.rays <= MOST_RAYS:
            raise ValueError(f"a range sensor has 1 to {MOST_RAYS} rays, not {self.rays}")
        if not (self.step > 0.0 and self.step * (self.rays - 1) <= 2.0 * math.pi + 1e-9):
            raise ValueError(
                f"the rays must follow counter-clockwise within one turn; {self.step} rad apart they do not"
            )
        if not (math.isfinite(self.first) and 0.0 < self.reach < math.inf):
            raise ValueError("the first ray's angle must be a number, the reach a number above 0")

    def scan(self, pose: ArrayLike, own: ArrayLike, discs: ArrayLike, walls: ArrayLike) -> Floats:
        """Return the ranges [m] of n sensors, (n, rays); inf where nothing is within reach, 0 inside a disc.

        `pose` (3, n) are x, y [m] and theta [rad] of the sensors; `own` (n,) says which of the discs is the sensor's
        own robot, which it does not see (-1: none). `discs` (3, d) are x, y, radius [m], `walls` (4, w) are x1, y1, x2,
        y2 [m]. Discs and sensors at NaN see nothing and are not seen.
        """
        pose, discs, walls = (np.ascontiguousarray(rows, dtype=float) for rows in (pose, discs, walls))
        ranges = np.empty((pose.shape[1], self.rays))
        _scan(pose, np.ascontiguousarray(own, np.int64), discs, walls, self.first, self.step, self.reach, ranges)
        return ranges


@compiled("void(f8[:, ::1], i8[::1], f8[:, ::1], f8[:, ::1], f8, f8, f8, f8[:, ::1])")
def _scan(pose, own, discs, walls, first, step, reach, ranges):  # type: ignore[no-untyped-def]
    rays, count = ranges.shape[1], discs.shape[1]
    if len(own) == 0:
        return
    widest = 0.0
    for d in range(count):
        if discs[2, d] > widest:
            widest = discs[2, d]
    x, y = np.zeros(count + len(own)), np.zeros(count + len(own))  # robots at NaN stay at the origin and are not hit
    for points, start in ((discs, 0), (pose, count)):
        for k in range(points.shape[1]):
            if math.isfinite(points[0, k]) and math.isfinite(points[1, k]):
                x[start + k], y[start + k] = points[0, k], points[1, k]
    code, begin, members, shift, around, span = binned_around(x, y, reach + widest)
    sines, cosines = np.empty(rays), np.empty(rays)
    for k in range(rays):
        sines[k], cosines[k] = sincos(first + k * step)
    for i in range(len(own)):
        sine, cosine = sincos(pose[2, i])
        row = ranges[i]
        row[:] = np.inf
        for cell in range(len(around)):
            b = np.int64((code[count + i] + around[cell]) >> shift)
            for k in range(begin[b], begin[b + span]):
                d = members[k]
                if d >= count or d == own[i]:
                    continue
                dx, dy, radius = discs[0, d] - pose[0, i], discs[1, d] - pose[1, i], discs[2, d]
                if dx * dx + dy * dy <= (reach + radius) * (reach + radius):
                    ahead, left = cosine * dx + sine * dy, cosine * dy - sine * dx
                    _meet_disc(ahead, left, radius, first, step, reach, sines, cosines, row)
        for w in range(walls.shape[1]):
            dx1, dy1 = walls[0, w] - pose[0, i], walls[1, w] - pose[1, i]
            dx2, dy2 = walls[2, w] - pose[0, i], walls[3, w] - pose[1, i]
            ahead, left = cosine * dx1 + sine * dy1, cosine * dy1 - sine * dx1
            along, across = cosine * dx2 + sine * dy2 - ahead, cosine * dy2 - sine * dx2 - left
            _meet_wall(ahead, left, along, across, first, step, reach, sines, cosines, row)


@compiled("void(f8, f8, f8, f8, f8, f8, f8[::1], f8[::1], f8[::1])")
def _meet_disc(x, y, radius, first, step, reach, sines, cosines, row):  # type: ignore[no-untyped-def]
    """Shorten the rays that hit a disc at (x, y) [m; the sensor's frame]."""
    squared = x * x + y * y
    if squared <= radius * radius:
        row[:] = 0.0
        return
    half = math.asin(radius / math.sqrt(squared))
    turn = 2.0 * math.pi / step
    begin = (math.atan2(y, x) - half - first) / step - ROUNDING
    begin -= turn * math.floor(begin / turn)
    count = 2.0 * half / step + 2.0 * ROUNDING
    beyond = squared - radius * radius
    for lap in range(2):
        low, high = math.ceil(begin - lap * turn), math.floor(begin - lap * turn + count)
        for k in range(max(low, 0), min(high + 1, len(row))):
            along = x * cosines[k] + y * sines[k]
            # The nearer root of t^2 - 2 t along + beyond = 0, computed without cancellation.
            distance = beyond / (along + math.sqrt(max(along * along - beyond, 0.0)))
            if distance <= reach:
                row[k] = min(row[k], distance)


@compiled("void(f8, f8, f8, f8, f8, f8, f8, f8[::1], f8[::1], f8[::1])")
def _meet_wall(x, y, ex, ey, first, step, reach, sines, cosines, row):  # type: ignore[no-untyped-def]
    """Shorten the rays that hit a wall from (x, y) to (x + ex, y + ey) [m; the sensor's frame]."""
    squared = ex * ex + ey * ey
    middle = -(x * ex + y * ey) / squared
    off = x * ey - y * ex  # distance of the line from the sensor, times the wall's length
    chord = reach * reach * squared - off * off
    if chord <= 0.0 or off == 0.0:  # out of reach, or seen edge on
        return
    share = math.sqrt(chord) / squared
    start, end = max(middle - share, 0.0), min(middle + share, 1.0)
    if start >= end:
        return
    if off < 0.0:
        start, end = end, start  # counter-clockwise seen from the sensor
    turn = 2.0 * math.pi / step
    begin_angle = math.atan2(y + start * ey, x + start * ex)
    width = math.atan2(y + end * ey, x + end * ex) - begin_angle
    width -= 2.0 * math.pi * math.floor(width / (2.0 * math.pi))
    begin = (begin_angle - first) / step - ROUNDING
    begin -= turn * math.floor(begin / turn)
    for lap in range(2):
        low, high = math.ceil(begin - lap * turn), math.floor(begin - lap * turn + width / step + 2.0 * ROUNDING)
        for k in range(max(low, 0), min(high + 1, len(row))):
            distance = off / (cosines[k] * ey - sines[k] * ex)
            if 0.0 <= distance <= reach:
                row[k] = min(row[k], distance)

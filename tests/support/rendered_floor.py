"""Pictures of a floor with tags and robots, from known poses, by arithmetic of its own: it shares none with cmr.camera.

Rays go from the eye through each part of a pixel and meet boxes, sheets or the floor; lens, blur and noise follow.
Pixel (0, 0) has its centre at u = 0, v = 0.
"""

import math
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from scipy.ndimage import gaussian_filter

# Tags 0 to 15 of the family 36h11 as Edwin Olson's AprilTag program listed them: 6 rows of 6 bits, 1 is white, the
# first bit bottom right: so are they upright in OpenCV's sense.
CODES = (
    0xD5D628584, 0xD97F18B49, 0xDD280910E, 0xE479E9C98, 0xEBCBCA822, 0xF31DAB3AC, 0x056A5D085, 0x10652E1D4,
    0x22B1DFEAD, 0x265AD0472, 0x34FE91B86, 0x3FF962CD5, 0x43A25329A, 0x474B4385F, 0x4E9D243E9, 0x5246149AE,
)  # fmt: skip
PARTS = 4  # of a pixel, in each direction; of a pattern, which is large, one less
MARGIN = 1.5  # cells of white around a tag
BLACK, WHITE = 30.0, 215.0  # of 255
Array = Any


@dataclass(frozen=True)
class Eye:
    """A camera: focal length and centre [pixels], lens distortion k1, k2, p1, p2; where it is and looks at [m]."""

    width: int = 1280
    height: int = 720
    focal: float = 920.0
    centre: tuple[float, float] = (648.3, 355.1)
    lens: tuple[float, float, float, float] = (-0.12, 0.03, 0.0006, -0.0004)
    position: tuple[float, float, float] = (0.1, -0.5, 2.5)
    looks_at: tuple[float, float, float] = (0.0, 0.0, 0.0)
    roll: float = 0.03

    @cached_property
    def axes(self) -> Array:
        """Rows: right, down and ahead of the camera, in the world."""
        ahead = np.subtract(self.looks_at, self.position)
        ahead = ahead / np.linalg.norm(ahead)
        right = np.cross(ahead, (0.0, 1.0, 0.0) if abs(ahead[2]) > 0.99 else (0.0, 0.0, 1.0))
        right = right / np.linalg.norm(right)
        down = np.cross(ahead, right)
        c, s = math.cos(self.roll), math.sin(self.roll)
        return np.array([c * right + s * down, c * down - s * right, ahead])

    def _bent(self, x: Array, y: Array) -> tuple[Array, Array]:
        """Where the lens puts what a pinhole would put at (x, y), one focal length away (Brown's model)."""
        k1, k2, p1, p2 = self.lens
        square = x * x + y * y
        radial = 1.0 + k1 * square + k2 * square * square
        return (
            x * radial + 2.0 * p1 * x * y + p2 * (square + 2.0 * x * x),
            y * radial + p1 * (square + 2.0 * y * y) + 2.0 * p2 * x * y,
        )

    def pixels(self, points: Array) -> Array:
        """Where points of the world (n, 3) are in the picture (n, 2)."""
        seen = (np.asarray(points, float) - self.position) @ self.axes.T
        bent = self._bent(seen[:, 0] / seen[:, 2], seen[:, 1] / seen[:, 2])
        return np.stack([self.centre[0] + self.focal * bent[0], self.centre[1] + self.focal * bent[1]], axis=1)

    @cached_property
    def rays(self) -> Array:
        """Direction of each pixel's ray in the world (height, width, 3)."""
        u, v = np.meshgrid(np.arange(self.width, dtype=float), np.arange(self.height, dtype=float))
        goal_x, goal_y = (u - self.centre[0]) / self.focal, (v - self.centre[1]) / self.focal
        x, y = goal_x, goal_y
        for _ in range(25):
            bent_x, bent_y = self._bent(x, y)
            x, y = x + goal_x - bent_x, y + goal_y - bent_y
        return np.stack([x, y, np.ones_like(x)], axis=2) @ self.axes

    def rays_of_parts(self, top: int, left: int, bottom: int, right: int, parts: int) -> Array:
        """Rays through parts x parts places of each pixel of a rectangle."""
        rows, columns = slice(max(top - 1, 0), bottom + 1), slice(max(left - 1, 0), right + 1)
        rays = self.rays[rows, columns]
        inside = (slice(top - rows.start, bottom - rows.start), slice(left - columns.start, right - columns.start))
        along_v, along_u = np.gradient(rays, axis=(0, 1))
        places = (np.arange(parts) + 0.5) / parts - 0.5
        v, u = (places[:, None] for _ in range(2))
        fine = rays[inside][:, None, :, None] + along_v[inside][:, None, :, None] * v[:, None, None]
        return fine + along_u[inside][:, None, :, None] * u  # rows, parts, columns, parts, 3


@dataclass(frozen=True)
class Sheet:
    """A tag on a white sheet: number, centre [m], where its top points [rad], edge of the black square [m]."""

    number: int
    x: float
    y: float
    theta: float
    size: float = 0.16
    z: float = 0.0

    @property
    def corners(self) -> Array:
        """Corners of the black square in the world: top left, top right, bottom right, bottom left."""
        c, s, half = math.cos(self.theta), math.sin(self.theta), self.size / 2.0
        return np.array(
            [
                (self.x + c * a * half - s * b * half, self.y + s * a * half + c * b * half, self.z)
                for a, b in ((1, 1), (1, -1), (-1, -1), (-1, 1))
            ]
        )

    def shade(self, x: Array, y: Array) -> tuple[Array, Array]:
        """Brightness at points of the world in the sheet's plane, and which of them are on the sheet."""
        c, s = math.cos(self.theta), math.sin(self.theta)
        forward = (c * (x - self.x) + s * (y - self.y)) / self.size * 8.0
        left = (-s * (x - self.x) + c * (y - self.y)) / self.size * 8.0
        row, column = np.floor(4.0 - forward).astype(int), np.floor(4.0 - left).astype(int)
        black = (row >= 0) & (row < 8) & (column >= 0) & (column < 8)
        inner = (row >= 1) & (row < 7) & (column >= 1) & (column < 7)
        bit = np.where(inner, (row - 1) * 6 + (column - 1), 0)
        white = inner & ((CODES[self.number] >> bit) & 1 == 1)
        on_sheet = np.maximum(np.abs(forward), np.abs(left)) <= 4.0 + MARGIN
        return np.where(black & ~white, BLACK, WHITE), on_sheet


@dataclass(frozen=True)
class Box:
    """A robot: pose of its centre on the floor, its box [m], and the tag on top (None: none)."""

    x: float
    y: float
    theta: float
    tag: int | None = 0
    length: float = 0.24
    width: float = 0.22
    height: float = 0.10
    tag_size: float = 0.16

    @property
    def corners(self) -> Array:
        """The eight corners in the world: those on the floor first."""
        c, s = math.cos(self.theta), math.sin(self.theta)
        ends = [(a * self.length / 2.0, b * self.width / 2.0) for a, b in ((1, 1), (1, -1), (-1, -1), (-1, 1))]
        return np.array(
            [(self.x + c * a - s * b, self.y + s * a + c * b, z) for z in (0.0, self.height) for a, b in ends]
        )

    @property
    def sheet(self) -> Sheet:
        return Sheet(self.tag or 0, self.x, self.y, self.theta, self.tag_size, self.height)

    def shade(self, eye: Eye, rays: Array) -> tuple[Array, Array]:
        """Brightness along rays, and which of them meet the box: slab by slab in the robot's own axes."""
        c, s = math.cos(self.theta), math.sin(self.theta)
        turn = np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
        start = turn @ np.subtract(eye.position, (self.x, self.y, 0.0))
        along = rays @ turn.T
        low = np.array([-self.length / 2.0, -self.width / 2.0, 0.0])
        high = np.array([self.length / 2.0, self.width / 2.0, self.height])
        first, second = (low - start) / along, (high - start) / along
        enters, leaves = np.minimum(first, second), np.maximum(first, second).min(axis=-1)
        face, distance = enters.argmax(axis=-1), enters.max(axis=-1)
        met = (distance < leaves) & (distance > 0.0)
        shade = np.choose(face, [70.0, 90.0, 140.0])
        if self.tag is not None:
            place = distance[..., None] * rays + eye.position
            tag, on_sheet = self.sheet.shade(place[..., 0], place[..., 1])
            shade = np.where((face == 2) & on_sheet, tag, shade)
        return shade, met


@dataclass(frozen=True)
class Pattern:
    """Square cells, 0 black and 255 white, on a white plate anywhere: its centre, where right and up are on it [m]."""

    cells: Array
    cell: float
    centre: tuple[float, float, float]
    right: tuple[float, float, float]
    up: tuple[float, float, float]
    margin: float = 0.02

    @property
    def corners(self) -> Array:
        """Corners of the plate in the world."""
        rows, columns = self.cells.shape
        wide, high = columns * self.cell / 2.0 + self.margin, rows * self.cell / 2.0 + self.margin
        ends = ((-wide, high), (wide, high), (wide, -high), (-wide, -high))
        return np.array([np.add(self.centre, a * np.array(self.right) + b * np.array(self.up)) for a, b in ends])

    def shade(self, eye: Eye, rays: Array) -> tuple[Array, Array]:
        """Brightness along rays, and which of them meet the plate."""
        rows, columns = self.cells.shape
        outwards = np.cross(self.right, self.up)
        start = np.subtract(eye.position, self.centre)
        distance = -(start @ outwards) / (rays @ outwards)
        across = columns / 2.0 + (distance * (rays @ np.array(self.right)) + start @ self.right) / self.cell
        down = rows / 2.0 - (distance * (rays @ np.array(self.up)) + start @ self.up) / self.cell
        beyond = self.margin / self.cell
        met = (across > -beyond) & (across < columns + beyond) & (down > -beyond) & (down < rows + beyond)
        column, row = np.floor(across).astype(int), np.floor(down).astype(int)
        inside = (column >= 0) & (column < columns) & (row >= 0) & (row < rows)
        black = inside & (self.cells[np.clip(row, 0, rows - 1), np.clip(column, 0, columns - 1)] == 0)
        return np.where(black, BLACK, WHITE), met & (distance > 0.0)


class Scene:
    """A floor with tags under a camera; `picture` shows it with robots on it."""

    def __init__(
        self,
        eye: Eye,
        tags: Iterable[Sheet] = (),
        *,
        blur: float = 0.7,
        noise: float = 3.0,
        seed: int = 0,
        parts: int = PARTS,
    ):
        self.eye, self.blur, self.parts = eye, blur, parts
        self._random = np.random.default_rng(seed)
        self._floor = self._bare_floor()
        for tag in tags:
            self._add(self._floor, _scaled(tag.corners, 1.6), lambda rays, tag=tag: self._of_sheet(tag, rays))
        self._seen = gaussian_filter(self._floor, blur)
        self._noise = self._random.normal(0.0, noise, (eye.height + 64, eye.width + 64)).astype(np.float32)

    def picture(self, things: Iterable[Box | Pattern] = ()) -> Array:
        """Return a picture (height, width), 0 to 255, with robots and patterns; the nearer hide the farther."""
        floor, seen = self._floor.copy(), self._seen.copy()
        places = []
        for thing in sorted(things, key=lambda thing: -math.dist(self.eye.position, thing.corners.mean(axis=0))):
            parts = self.parts - 1 if isinstance(thing, Pattern) else self.parts
            place = self._add(floor, thing.corners, lambda rays, thing=thing: thing.shade(self.eye, rays), parts)
            places += [place] if place else []
        for top, left, bottom, right in places:
            rows, columns = slice(max(top - 9, 0), bottom + 9), slice(max(left - 9, 0), right + 9)
            patch = gaussian_filter(floor[rows, columns], self.blur)
            margin = slice(4 if rows.start else 0, -4), slice(4 if columns.start else 0, -4)
            seen[rows, columns][margin] = patch[margin]
        down, across = self._random.integers(0, 64, 2)
        seen += self._noise[down : down + self.eye.height, across : across + self.eye.width]
        return np.clip(np.round(seen), 0, 255).astype(np.uint8)

    def _bare_floor(self) -> Array:
        """A floor with stains and grain, fixed to the world."""
        rays = self.eye.rays
        with np.errstate(divide="ignore", invalid="ignore"):
            distance = -self.eye.position[2] / rays[..., 2]
        x, y = (distance * rays[..., k] + self.eye.position[k] for k in (0, 1))
        stains = 8.0 * np.sin(3.1 * x + 1.0) * np.sin(2.3 * y) + 4.0 * np.sin(17.0 * x + 5.0 * y)
        planks = np.where((np.floor(x / 0.25) + np.floor(y / 1.3)) % 2.0 == 0.0, 6.0, 0.0)
        floor = 125.0 + stains + planks + self._random.normal(0.0, 3.0, x.shape)
        return np.where(distance > 0.0, floor, 180.0).astype(np.float32)

    def _of_sheet(self, tag: Sheet, rays: Array) -> tuple[Array, Array]:
        distance = (tag.z - self.eye.position[2]) / rays[..., 2]
        return tag.shade(*(distance * rays[..., k] + self.eye.position[k] for k in (0, 1)))

    def _add(self, floor: Array, corners: Array, shade: Any, parts: int = PARTS) -> tuple[int, int, int, int] | None:
        """Draw what covers the corners' place in the picture; return the rectangle, None where it is outside."""
        pixels = self.eye.pixels(corners)
        left, top = (int(low) for low in np.maximum(np.floor(pixels.min(axis=0)) - 3, 0))
        right, bottom = (
            int(high) for high in np.minimum(np.ceil(pixels.max(axis=0)) + 3, (self.eye.width, self.eye.height))
        )
        if right - left < 2 or bottom - top < 2:
            return None
        brightness, met = shade(self.eye.rays_of_parts(top, left, bottom, right, parts))
        cover = met.mean(axis=(1, 3))
        drawn = (brightness * met).mean(axis=(1, 3))
        floor[top:bottom, left:right] = floor[top:bottom, left:right] * (1.0 - cover) + drawn
        return top, left, bottom, right


def _scaled(corners: Array, scale: float) -> Array:
    """Return the corners moved away from their middle."""
    middle = corners.mean(axis=0)
    return middle + scale * (corners - middle)


FLOOR_TAGS = tuple(
    Sheet(number, x, y, theta)
    for number, x, y, theta in (
        (10, -1.2, -0.55, 1.57),
        (11, 1.25, -0.55, 1.5),
        (12, 1.2, 0.7, -0.2),
        (13, -1.15, 0.72, 3.0),
    )
)

"""Virtual robots, waypoints and trails in the camera's picture: at their place and size, occluded by real robots."""

import math
from collections.abc import Iterable, Sequence
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from cmr.camera.floor import RobotTag, turned
from cmr.camera.lens import Floats, Lens
from cmr.camera.place import Place
from cmr.camera.tracks import Shown

Picture = NDArray[np.uint8]
Colour = tuple[int, int, int]  # blue, green, red
BLUE: Colour = (216, 79, 31)
PALE: Colour = (240, 170, 120)
RED: Colour = (40, 40, 220)
WHITE: Colour = (255, 255, 255)
SHIFT = 4  # bits behind the point: OpenCV draws to a sixteenth of a pixel
NEAREST = 0.05  # m before the camera; what is nearer cannot be drawn
BEYOND = 1.3  # times the picture's size; farther out nothing is drawn, as the lens model is not valid there
OPAQUE = 0.85  # opacity of a virtual robot; the floor shines through a little, to show that it is not real
# Faces of a box by its corners, as `box` returns them, with how bright each is.
SIDES = (((0, 1, 5, 4), 0.75), ((1, 2, 6, 5), 0.55), ((2, 3, 7, 6), 0.65), ((3, 0, 4, 7), 0.55))
TOP = (4, 5, 6, 7)


class Waypoints(NamedTuple):
    """The waypoints of a robot [m; world]."""

    x: Sequence[float]
    y: Sequence[float]


def box(x: float, y: float, theta: float, size: RobotTag) -> Floats:
    """Return the corners (8, 3) [m; world] of a robot's box: four on the floor, the four above them.

    Each four begin ahead to the left and go round clockwise seen from above.
    """
    half = np.array([(1.0, 1.0), (1.0, -1.0), (-1.0, -1.0), (-1.0, 1.0)]) * (size.length / 2.0, size.width / 2.0)
    ground = turned(half, theta) + np.array([x, y])
    return np.concatenate([np.column_stack([ground, np.full(4, z)]) for z in (0.0, size.height)])


class Drawer:
    """Draws into the pictures of one lens; `size` is the box of virtual robots."""

    def __init__(self, lens: Lens, size: RobotTag) -> None:
        self.lens, self.size = lens, size
        reach = [max(lens.cx, lens.width - lens.cx) / lens.fx, max(lens.cy, lens.height - lens.cy) / lens.fy]
        self._reach = BEYOND * np.array(reach)

    def draw(
        self,
        picture: Picture,
        place: Place,
        virtual: Iterable[Shown],
        real: Iterable[tuple[Shown, RobotTag]],
        waypoints: Iterable[Waypoints] = (),
    ) -> Picture:
        """Return the picture with virtual robots in it; real robots hide what is on the floor or behind them."""
        drawn = picture.copy()
        virtual = list(virtual)
        for robot in virtual:
            self._trail(drawn, place, robot)
        for path in waypoints:
            self._waypoints(drawn, place, path)
        everybody = [(robot, self.size, True) for robot in virtual] + [(robot, size, False) for robot, size in real]
        for robot, size, is_virtual in sorted(everybody, key=lambda entry: -_distance(place, entry[0])):
            corners = box(robot.x, robot.y, robot.theta, size)
            pixels = self.pixels(place, corners)
            if not np.isfinite(pixels).all() or not self._inside(pixels):
                continue
            if is_virtual:
                self._robot(drawn, place, robot, corners, pixels)
            else:
                _restored(drawn, picture, pixels)
        return drawn

    def pixels(self, place: Place, points: Floats) -> Floats:
        """Return where points of the world (n, 3) are in the picture (n, 2); NaN far outside and behind the camera."""
        before = place.before_camera(points)
        ahead = before[:, 2] > NEAREST
        shares = before[:, :2] / np.where(ahead, before[:, 2], 1.0)[:, None]
        known = ahead & (np.abs(shares) <= self._reach).all(axis=1)
        pixels = np.full((len(points), 2), np.nan)
        if known.any():
            pixels[known] = self.lens.pixels(before[known])
        return pixels

    def _inside(self, pixels: Floats) -> bool:
        low, high = pixels.min(axis=0), pixels.max(axis=0)
        return bool((high >= 0.0).all() and low[0] < self.lens.width and low[1] < self.lens.height)

    def _trail(self, drawn: Picture, place: Place, robot: Shown) -> None:
        points = np.array([(*point, 0.0) for point in robot.trail]).reshape(-1, 3)
        self._line(drawn, self.pixels(place, points), PALE, 2)

    def _waypoints(self, drawn: Picture, place: Place, path: Waypoints) -> None:
        points = np.column_stack([path.x, path.y, np.zeros(len(path.x))]).reshape(-1, 3)
        self._line(drawn, self.pixels(place, points), RED, 1)
        for point in points:  # discs of 3 cm that lie on the floor
            angles = np.linspace(0.0, 2.0 * math.pi, 13)[:-1]
            disc = point + 0.03 * np.column_stack([np.cos(angles), np.sin(angles), np.zeros(12)])
            pixels = self.pixels(place, disc)
            if np.isfinite(pixels).all():
                _filled(drawn, pixels, RED)

    def _line(self, drawn: Picture, pixels: Floats, colour: Colour, width: int) -> None:
        """Draw a line on the floor; points outside the picture break it."""
        breaks = np.flatnonzero(~np.isfinite(pixels).all(axis=1))
        for part in np.split(pixels, breaks):
            part = part[np.isfinite(part).all(axis=1)]
            if len(part) > 1:
                cv2.polylines(drawn, [_fixed(part)], False, colour, width, cv2.LINE_AA, SHIFT)

    def _robot(self, drawn: Picture, place: Place, robot: Shown, corners: Floats, pixels: Floats) -> None:
        """Draw the visible sides, the top, an arrow ahead and the id."""
        left, top = np.clip(np.floor(pixels.min(axis=0)) - 2, 0, None).astype(int)
        right, bottom = np.ceil(pixels.max(axis=0)).astype(int) + 3
        window = drawn[top:bottom, left:right]
        before, pixels = window.copy(), pixels - (left, top)
        for face, brightness in SIDES:
            if _seen_from_outside(corners[list(face)], place.eye):
                _filled(window, pixels[list(face)], tuple(int(part * brightness) for part in BLUE))
        _filled(window, pixels[list(TOP)], BLUE)
        arrow = np.array([(0.4, 0.0), (0.1, 0.3), (0.1, -0.3)]) * (self.size.length, self.size.width)
        tip = np.column_stack([turned(arrow, robot.theta) + np.array([robot.x, robot.y]), np.full(3, self.size.height)])
        tip_pixels = self.pixels(place, tip) - (left, top)
        if np.isfinite(tip_pixels).all():
            _filled(window, tip_pixels, WHITE)
        cv2.addWeighted(window, OPAQUE, before, 1.0 - OPAQUE, 0.0, window)
        behind = pixels[list(TOP)][2:].mean(axis=0) * 0.6 + pixels[list(TOP)].mean(axis=0) * 0.4
        _label(window, str(robot.robot_id), behind)


def _distance(place: Place, robot: Shown) -> float:
    return math.dist(place.eye, (robot.x, robot.y, 0.0))


def _seen_from_outside(face: Floats, eye: Floats) -> bool:
    """Return whether the eye is on the outer side of a face whose corners `SIDES` lists."""
    normal = np.cross(face[3] - face[0], face[1] - face[0])
    return float(normal @ (eye - face[0])) > 0.0


def _fixed(pixels: Floats) -> NDArray[np.int32]:
    """Return pixels in the fixed-point format of OpenCV's drawing functions."""
    return np.round(pixels * (1 << SHIFT)).astype(np.int32)


def _filled(drawn: Picture, pixels: Floats, colour: tuple[int, ...]) -> None:
    cv2.fillConvexPoly(drawn, _fixed(pixels), colour, cv2.LINE_AA, SHIFT)


def _label(drawn: Picture, text: str, middle: Floats) -> None:
    (width, height), _ = cv2.getTextSize(text, cv2.FONT_HERSHEY_SIMPLEX, 0.4, 1)
    corner = (int(middle[0] - width / 2.0), int(middle[1] + height / 2.0))
    cv2.putText(drawn, text, corner, cv2.FONT_HERSHEY_SIMPLEX, 0.4, WHITE, 1, cv2.LINE_AA)


def _restored(drawn: Picture, picture: Picture, pixels: Floats) -> None:
    """Show the picture again where a real robot's box is: it covers what was drawn there."""
    mask = np.zeros(picture.shape[:2], np.uint8)
    hull = cv2.convexHull(pixels.astype(np.float32)).reshape(-1, 2).astype(float)
    cv2.fillConvexPoly(mask, _fixed(hull), 255, cv2.LINE_8, SHIFT)
    left, top, wide, high = cv2.boundingRect(mask)
    rows, columns = slice(top, top + high), slice(left, left + wide)
    covered = mask[rows, columns] > 0
    drawn[rows, columns][covered] = picture[rows, columns][covered]

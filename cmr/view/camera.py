"""A visitor's camera: free, from above, or following a robot."""

import numpy as np
import viser

from cmr.view.data.robots import Floats, Robots
from cmr.view.look import PANEL_SHARE

FREE, TOP, FOLLOW = "free", "from above", "follow the robot"
LEAST_EXTENT = 3.0  # smallest extent of the picture [m]
MARGIN = 2.0  # m around the outermost robots, half on each side
EDGE = 0.8  # m beyond the outermost robots before a camera above is moved
TILT = 1e-3  # offset of a camera above to the south, relative to its height, so that north is up
USUAL = 0.75  # rad, field of view assumed until a browser reports its own
PHONE = 0.7  # width over height of a window, below which it counts as a phone
CLOSE = (-1.2, -1.2, 1.2)  # m from a followed robot
TOUCHED = 0.01  # displacement, relative to its height, that shows that the visitor moved a camera above

INITIAL = (0.0, -0.01, 6.0)  # m; initial position in a browser

Point = tuple[float, float, float]


def overview(robots: Robots, field_of_view: float = USUAL, aspect: float = 1.0) -> tuple[Point, Point]:
    """Return position and target [m] of a camera above that shows all robots.

    On a phone they are above the panel.
    """
    covered = PANEL_SHARE if aspect < PHONE else 0.0
    low, high = rectangle(robots)
    x, y = ((low + high) / 2).tolist()
    width, depth = (high - low + MARGIN).tolist()
    extent = max(width / max(aspect, 0.1), max(depth, LEAST_EXTENT) / (1.0 - covered))
    y -= covered / 2 * extent
    height = extent / 2 / float(np.tan(field_of_view / 2))
    return (x, y - TILT * height, height), (x, y, 0.0)


def rectangle(robots: Robots) -> Floats:
    """Return the lowest and the highest x and y of robots, shape (2, 2) [m]; zeros without robots."""
    if not robots.pose.size:
        return np.zeros((2, 2))
    return np.stack([robots.pose[:2].min(axis=1), robots.pose[:2].max(axis=1)])


def is_beyond(robots: Robots, known: Floats) -> bool:
    """Return whether a robot is so far outside a rectangle that a camera placed above it may not show the robot."""
    low, high = rectangle(robots)
    return bool((low < known[0] - EDGE).any() or (high > known[1] + EDGE).any())


class Camera:
    """The camera of one visitor."""

    def __init__(self, client: viser.ClientHandle) -> None:
        self._camera = client.camera
        self._mode = FREE
        self._followed: tuple[int, Point] | None = None
        self._above: tuple[Point, Floats] | None = None  # where it was placed, and the rectangle of robots then

    def choose(self, mode: str, robots: Robots) -> None:
        """Change its mode."""
        self._mode, self._followed, self._above = mode, None, None
        if mode == TOP:
            self._rise(robots)

    def advance(self, robots: Robots, robot_id: int) -> None:
        """Follow the chosen robot; from above, keep all robots in the picture."""
        if self._mode == TOP and self._above is not None and self._untouched(self._above[0]):
            if is_beyond(robots, self._above[1]) or not self._is_at(self._above[0]):
                self._rise(robots)
            return
        place = robots.place(robot_id) if self._mode == FOLLOW else None
        if place is None:
            return
        point = (place[0], place[1], 0.0)
        if self._followed is None or self._followed[0] != robot_id:
            self._place((point[0] + CLOSE[0], point[1] + CLOSE[1], CLOSE[2]), point)
        else:
            # The visitor may turn and zoom: only the robot's displacement is added, to position and target.
            self._camera.position = self._camera.position + np.subtract(point, self._followed[1])
        self._followed = robot_id, point

    def _rise(self, robots: Robots) -> None:
        position, target = overview(robots, self._camera.fov, self._camera.aspect)
        self._above = position, rectangle(robots)
        self._place(position, target)

    def _untouched(self, position: Point) -> bool:
        """Return whether the camera is where it was placed, or at its initial position in a slow browser."""
        return self._is_at(position) or self._is_at(INITIAL)

    def _is_at(self, position: Point) -> bool:
        return float(np.linalg.norm(self._camera.position - position)) < TOUCHED * position[2]

    def _place(self, position: Point, target: Point) -> None:
        self._camera.position = position
        self._camera.look_at = target

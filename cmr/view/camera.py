"""Where a visitor's camera is: free, from above, or following a robot."""

import numpy as np
import viser

from cmr.view.data.robots import Floats, Robots
from cmr.view.look import PANEL_SHARE

FREE, TOP, FOLLOW = "free", "from above", "follow the robot"
LEAST_EXTENT = 3.0  # m that are in the picture at least
MARGIN = 2.0  # m around the outermost robots, half on each side
EDGE = 0.8  # m that a robot may get beyond the outermost ones before a camera above is put again
TILT = 1e-3  # of its height by which a camera above stands south, so that north is up
USUAL = 0.75  # rad, field of view of a browser that has not reported its own yet
PHONE = 0.7  # width over height of a window, below which it is taken for that of a phone
CLOSE = (-1.2, -1.2, 1.2)  # m from a robot that is followed
TOUCHED = 0.01  # of its height by which a camera above is elsewhere once the visitor has moved it

INITIAL = (0.0, -0.01, 6.0)  # m; where a browser has it that has not heard of another place yet

Point = tuple[float, float, float]


def overview(robots: Robots, field_of_view: float = USUAL, aspect: float = 1.0) -> tuple[Point, Point]:
    """Return where a camera above stands that has all robots in its picture, and where it looks [m].

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
    """Return the lowest and the highest x and y of robots, shape (2, 2) [m]; zeros where nobody is."""
    if not robots.pose.size:
        return np.zeros((2, 2))
    return np.stack([robots.pose[:2].min(axis=1), robots.pose[:2].max(axis=1)])


def is_beyond(robots: Robots, known: Floats) -> bool:
    """Return whether a robot is so far outside a rectangle that a camera put above it may not show the robot."""
    low, high = rectangle(robots)
    return bool((low < known[0] - EDGE).any() or (high > known[1] + EDGE).any())


class Camera:
    """The camera of one visitor."""

    def __init__(self, client: viser.ClientHandle) -> None:
        self._camera = client.camera
        self._mode = FREE
        self._followed: tuple[int, Point] | None = None
        self._above: tuple[Point, Floats] | None = None  # where it was put, and the rectangle of robots there

    def choose(self, mode: str, robots: Robots) -> None:
        """Change the way in which it moves."""
        self._mode, self._followed, self._above = mode, None, None
        if mode == TOP:
            self._rise(robots)

    def advance(self, robots: Robots, robot_id: int) -> None:
        """Go with the robot that is followed, if one is; from above, keep all robots in the picture."""
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
            # The visitor may turn and zoom meanwhile: only the robot's own way is added. Where it looks moves along.
            self._camera.position = self._camera.position + np.subtract(point, self._followed[1])
        self._followed = robot_id, point

    def _rise(self, robots: Robots) -> None:
        position, target = overview(robots, self._camera.fov, self._camera.aspect)
        self._above = position, rectangle(robots)
        self._place(position, target)

    def _untouched(self, position: Point) -> bool:
        """Return whether the camera is where it was put, or where a browser began that was too slow to hear of that."""
        return self._is_at(position) or self._is_at(INITIAL)

    def _is_at(self, position: Point) -> bool:
        return float(np.linalg.norm(self._camera.position - position)) < TOUCHED * position[2]

    def _place(self, position: Point, target: Point) -> None:
        self._camera.position = position
        self._camera.look_at = target

"""Where a visitor's camera is: free, from above, or following a robot."""

import numpy as np
import viser

from cmr.view.robots import Robots

FREE, TOP, FOLLOW = "free", "from above", "follow the robot"
LEAST_EXTENT = 3.0  # m that are in the picture at least
MARGIN = 2.0  # m around the outermost robots, half on each side
TILT = 1e-3  # of its height by which a camera above stands south, so that north is up
USUAL = 0.75  # rad, field of view of a browser that has not told its own yet
CLOSE = (-1.2, -1.2, 1.2)  # m from a robot that is followed

Point = tuple[float, float, float]


def overview(robots: Robots, field_of_view: float = USUAL, aspect: float = 1.0) -> tuple[Point, Point]:
    """Return where a camera above stands that has all robots in its picture, and where it looks [m]."""
    x, y = robots.pose[:2] if robots.pose.size else np.zeros((2, 1))
    centre = float(np.min(x) + np.max(x)) / 2, float(np.min(y) + np.max(y)) / 2
    width, depth = float(np.ptp(x)) + MARGIN, float(np.ptp(y)) + MARGIN
    extent = max(width / max(aspect, 0.1), depth, LEAST_EXTENT)
    height = extent / 2 / float(np.tan(field_of_view / 2))
    return (centre[0], centre[1] - TILT * height, height), (*centre, 0.0)


class Camera:
    """The camera of one visitor."""

    def __init__(self, client: viser.ClientHandle) -> None:
        self._camera = client.camera
        self._mode = FREE
        self._followed: tuple[int, Point] | None = None

    def choose(self, mode: str, robots: Robots) -> None:
        """Change the way in which it moves."""
        self._mode, self._followed = mode, None
        if mode == TOP:
            self._place(*overview(robots, self._camera.fov, self._camera.aspect))

    def advance(self, robots: Robots, robot_id: int) -> None:
        """Go with the robot that is followed, if one is."""
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

    def _place(self, position: Point, target: Point) -> None:
        self._camera.position = position
        self._camera.look_at = target

"""What a robot and its twin drove: the drive on which the robot was calibrated, and the first one after it.

A twin starts each drive where its robot is and is commanded as it is, so their paths tell how good its parameters are.
"""

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np

from cmr.view.robots import Floats, Robots

MOVING = 0.2  # rad/s of both wheels together
REST = 1_000_000  # us at rest, or unseen, that end a drive
PERIOD = 100_000  # us between the points of a path, at least
LONGEST = 120_000_000  # us of a drive that are kept
SHORTEST = 1.0  # m that a robot has driven before its path is shown


class Paths(NamedTuple):
    """Where a robot and its twin were [m], each of shape (n, 2), at times [s] of shape (n,)."""

    seconds: Floats
    real: Floats
    twin: Floats

    @property
    def rmse(self) -> float:
        """Root mean square distance between the two over time [m], however unevenly that was looked at."""
        squares = np.sum((self.real - self.twin) ** 2, axis=1)
        steps = np.diff(self.seconds)
        return float(np.sqrt(np.sum(steps * (squares[1:] + squares[:-1]) / 2) / steps.sum()))


class _Course:
    """The drives of one robot; a point is the time [us], (x, y) of the robot and (x, y) of its twin [m]."""

    def __init__(self) -> None:
        self.current: list[tuple[float, ...]] = []
        self.before: list[tuple[float, ...]] = []
        self.after: list[tuple[float, ...]] | None = None
        self._began = self._moved = 0

    def take(self, now: int, point: tuple[float, ...], is_moving: bool) -> None:
        if not is_moving:
            return
        if now - self._moved > REST:
            self._began, self.current = now, []
            if self.before and self.after is None:
                self.after = self.current
        self._moved = now
        if now - self._began <= LONGEST:
            self.current.append((now, *point))

    def calibrate(self) -> None:
        # What is driven on, without a rest, is of neither drive.
        self.before, self.after, self.current = self.current, None, []


class Drives:
    """Follows the drives of all robots with twins."""

    def __init__(self) -> None:
        self._courses: dict[int, _Course] = {}
        self._sampled = 0

    def due(self, now: int) -> bool:
        """Tell whether it is time for another point, `now` [us]."""
        return not 0 <= now - self._sampled < PERIOD

    def sample(self, now: int, real: Robots, twins: Robots) -> None:
        """Note where robots and, in the same order, their twins are, `now` [us]."""
        self._sampled = now
        points = np.concatenate([real.pose[:2], twins.pose[:2]]).T.tolist()
        moving = np.abs(real.wheels).sum(axis=0) > MOVING
        for robot_id, point, is_moving in zip(real.robot_id.tolist(), points, moving.tolist(), strict=True):
            self._courses.setdefault(robot_id, _Course()).take(now, tuple(point), is_moving)

    def calibrated(self, robot_id: int) -> None:
        """Note that a robot has just been calibrated on its last drive."""
        self._courses.setdefault(robot_id, _Course()).calibrate()

    def of(self, robot_id: int) -> tuple[Paths | None, Paths | None]:
        """Return the paths before and after the robot's last calibration; before the first one, those of now."""
        course = self._courses.get(robot_id)
        if course is None:
            return None, None
        return _paths(course.before or course.current), _paths(course.after or ())


def _paths(points: Iterable[tuple[float, ...]]) -> Paths | None:
    columns = np.array(list(points)).reshape(-1, 5)
    paths = Paths((columns[:, 0] - columns[:1, 0]) / 1e6, columns[:, 1:3], columns[:, 3:])
    way = np.hypot(*np.diff(paths.real, axis=0).T).sum()
    return paths if way >= SHORTEST else None

"""Drives of a robot and its twin: the one on which the robot was calibrated, and the first one after it.

A twin starts each drive at its robot's pose with the same commands, so their paths show the quality of its parameters.
"""

from bisect import bisect_right
from collections.abc import Iterable, Sequence
from typing import NamedTuple, TypeAlias

import numpy as np

from cmr.view.data.robots import Floats, Robots

MOVING = 0.2  # rad/s of both wheels together
REST = 1_000_000  # us at rest, or unseen, that end a drive
PERIOD = 100_000  # us between the points of a path, at least
LONGEST = 120_000_000  # us of a drive that are kept
SHORTEST = 1.0  # m that a robot has driven before its path is shown
Point: TypeAlias = tuple[float, ...]


class Paths(NamedTuple):
    """Positions of a robot and its twin [m], each of shape (n, 2), at times [s] of shape (n,)."""

    seconds: Floats
    real: Floats
    twin: Floats

    @property
    def rmse(self) -> float:
        """Root mean square distance between the two over time [m], independent of sampling."""
        squares = np.sum((self.real - self.twin) ** 2, axis=1)
        steps = np.diff(self.seconds)
        return float(np.sqrt(np.sum(steps * (squares[1:] + squares[:-1]) / 2) / steps.sum()))


class Course:
    """The drives of one robot; a point is the time [us], (x, y) of the robot and (x, y) of its twin [m].

    `before` is the drive of its last calibration, `after` the first one that began since, `current` the last.
    """

    def __init__(self, before: Sequence[Point] = (), moved: int = 0) -> None:
        self.current: list[Point] = []
        self.before = list(before)
        self.after: list[Point] | None = None
        self._began, self._moved = moved, moved
        self._calibrated_on_until = self._driven_on_until = moved  # without a rest; and since the calibration

    def take(self, now: int, point: tuple[float, ...], is_moving: bool) -> None:
        """Add the positions of robot and twin at `now` [us]."""
        if not is_moving:
            return
        if now - self._moved > REST:
            self._began, self.current = now, []
            if self.before and self.after is None:
                self.after = self.current
        self._moved = now
        if self.after is None:
            self._driven_on_until = now
        if now - self._began <= LONGEST:
            self.current.append((now, *point))

    def calibrated(self) -> "Course":
        """Return the course that begins with a calibration at this moment."""
        # Motion that continues without a rest belongs to neither drive.
        return Course(self.current, self._moved)

    def until(self, utime: int) -> "Course":
        """Return it as of a time since its calibration."""
        result = Course(self.before, min(utime, self._driven_on_until))
        after = _until(self.after or (), utime)
        if after:
            result.after = after
            result.go_on(after, int(after[-1][0]))
        return result

    def drive_until(self, utime: int) -> tuple[list[Point], int]:
        """Return the calibration's drive as of an earlier time, and when the robot last moved [us]."""
        return _until(self.before, utime), min(utime, self._calibrated_on_until)

    def go_on(self, drive: list[Point], moved: int) -> None:
        """Continue a drive; the robot last moved at `moved` [us]."""
        if self.after and self.after[0] == drive[0]:
            drive = self.after
        self.current, self._began, self._moved = drive, int(drive[0][0]), moved


class Drives:
    """Tracks the drives of all robots with twins."""

    def __init__(self, courses: dict[int, Course] | None = None) -> None:
        self._courses = courses or {}
        self._sampled = 0

    def due(self, now: int) -> bool:
        """Return whether it is time for another point, `now` [us]."""
        return not 0 <= now - self._sampled < PERIOD

    def sample(self, now: int, real: Robots, twins: Robots) -> None:
        """Add the positions of robots and, in the same order, their twins, at `now` [us]."""
        self._sampled = now
        points = np.concatenate([real.pose[:2], twins.pose[:2]]).T.tolist()
        moving = np.abs(real.wheels).sum(axis=0) > MOVING
        for robot_id, point, is_moving in zip(real.robot_id.tolist(), points, moving.tolist(), strict=True):
            self._courses.setdefault(robot_id, Course()).take(now, tuple(point), is_moving)

    def calibrated(self, robot_id: int) -> Course:
        """Record that a robot has just been calibrated on its last drive; return its new course."""
        course = self._courses[robot_id] = self._courses.get(robot_id, Course()).calibrated()
        return course

    def of(self, robot_id: int) -> tuple[Paths | None, Paths | None]:
        """Return the paths before and after the robot's last calibration; before the first one, the current ones."""
        course = self._courses.get(robot_id)
        if course is None:
            return None, None
        return _paths(course.before or course.current), _paths(course.after or ())


class Calibrations:
    """Courses of robots around their calibrations, in order."""

    def __init__(self) -> None:
        self._done: list[tuple[int, int, Course]] = []  # when [us], which robot, and its course

    def add(self, utime: int, robot_id: int, course: Course) -> None:
        """Add a calibration at `utime` [us]; its course continues."""
        self._done.append((utime, robot_id, course))

    def drives(self, utime: int) -> Drives:
        """Return the drives of all robots as of a time [us]."""
        courses: dict[int, Course] = {}
        to_come: set[int] = set()
        for done, robot_id, course in self._done:
            if done <= utime:
                courses[robot_id] = course.until(utime)
            elif robot_id not in to_come:
                to_come.add(robot_id)
                lasting, moved = course.drive_until(utime)
                if lasting:
                    courses.setdefault(robot_id, Course()).go_on(lasting, moved)
        return Drives(courses)


def _until(points: Sequence[Point], utime: int) -> list[Point]:
    return list(points[: bisect_right(points, float(utime), key=lambda point: point[0])])


def _paths(points: Iterable[tuple[float, ...]]) -> Paths | None:
    columns = np.array(list(points)).reshape(-1, 5)
    paths = Paths((columns[:, 0] - columns[:1, 0]) / 1e6, columns[:, 1:3], columns[:, 3:])
    way = np.hypot(*np.diff(paths.real, axis=0).T).sum()
    return paths if way >= SHORTEST else None

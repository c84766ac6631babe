"""Record a drive by hand: duties over time, from the first motion to the last, as a manoeuvre that can be repeated."""

import math
from pathlib import Path

import numpy as np

from cmr.geometry.manoeuvres import TYPICAL
from cmr.geometry.manoeuvres.recorded import save
from cmr.model.parameters import RobotParameters
from cmr.world.view import Robot

MARGIN = 0.2  # m, and ...
SPARE = 1.2  # ... times the way from the start: a drive repeated without poses ends elsewhere
LONGEST = 3000.0  # s


class Recorder:
    """Records the commands of a robot, and its largest distance from the start."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self._began = 0  # us
        self._rows: list[tuple[float, float, float]] = []
        self._moved = 0  # number of rows up to the last non-zero command
        self._start: tuple[float, float] | None = None
        self._furthest = 0.0

    @property
    def seconds(self) -> float:
        """Duration of the drive so far [s]."""
        return self._rows[self._moved - 1][0] if self._moved else 0.0

    def take(self, utime: int, duties: tuple[float, float], me: Robot | None) -> None:
        """Record the duties commanded at `utime` [us], and the robot's position."""
        moves = any(duties)
        if not self._rows and not moves:
            return
        self._began = self._began or utime - 1_000
        time = (utime - self._began) * 1e-6
        if time > LONGEST or (self._rows and time <= self._rows[-1][0]):
            return
        self._rows.append((time, *duties))
        self._moved = len(self._rows) if moves else self._moved
        if me is not None:
            place = (float(me.state.x), float(me.state.y))
            self._start = self._start or place
            self._furthest = max(self._furthest, math.dist(self._start, place))

    def finish(self, robot_id: int, robot: RobotParameters | None) -> str:
        """Write the drive, if there was one; return a sentence about it. Raises OSError."""
        if not self._moved:
            return f"{self.path} was not written: the robot was not driven."
        rows = self._rows[: self._moved + 1]  # with the first zero after it
        save(self.path, np.array(rows), robot_id, self._space(robot))
        return (
            f"{self.path} holds a drive of {self.seconds:.1f} s. To drive it again: cmr-pilot --robot {robot_id} "
            f"--behaviour manoeuvre,name={self.path}"
        )

    def _space(self, robot: RobotParameters | None) -> float:
        """Return the space [m] that a typical robot would need for it (`Manoeuvre.space_for`, backwards)."""
        space = SPARE * self._furthest + MARGIN
        if robot is None:
            return space
        faster = (robot.wheel_radius / robot.k1) / (TYPICAL.wheel_radius / TYPICAL.k1)
        return space / max(float(faster), float(robot.base_width / TYPICAL.base_width))

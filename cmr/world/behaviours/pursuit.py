"""Drive along a path: how far along it the robot is, where to aim, and which duties take it there.

Source of the steering law: Coulter, Implementation of the Pure Pursuit Path Tracking Algorithm, CMU 1992.
"""

import math
from bisect import bisect_right

from cmr.model.body import wheels, wrap
from cmr.model.motor import duty_for_speed
from cmr.model.parameters import RobotParameters
from cmr.world.view import Robot

SEARCH_AHEAD = 0.5  # m of path looked at for the point nearest to the robot; a crossing must not be mistaken for it
LARGEST_DUTY = 0.9  # leaves the motors something to turn with


class Path:
    """A path of points [m; world frame] that may grow at its end, and the robot's progress along it."""

    def __init__(self) -> None:
        self.progress = 0.0
        self._x: list[float] = []
        self._y: list[float] = []
        self._along: list[float] = []

    @property
    def length(self) -> float:
        """Length from the first point to the last [m]."""
        return self._along[-1] if self._along else 0.0

    def append(self, x: float, y: float, spacing: float = 1e-6) -> None:
        """Add a point at the end, unless it is nearer than `spacing` [m] to the one before."""
        if not self._along:
            self._along.append(0.0)
        else:
            distance = math.hypot(x - self._x[-1], y - self._y[-1])
            if distance < spacing:
                return
            self._along.append(self._along[-1] + distance)
        self._x.append(x)
        self._y.append(y)

    def at(self, along: float) -> tuple[float, float]:
        """Return the point this far [m] along the path; its ends beyond them."""
        index = min(max(bisect_right(self._along, along) - 1, 0), len(self._along) - 2)
        if index < 0:
            return self._x[0], self._y[0]
        span = self._along[index + 1] - self._along[index]
        share = min(max((along - self._along[index]) / span, 0.0), 1.0)
        return (
            self._x[index] + share * (self._x[index + 1] - self._x[index]),
            self._y[index] + share * (self._y[index + 1] - self._y[index]),
        )

    def advance(self, x: float, y: float) -> None:
        """Move the progress on to the point nearest to the robot, never back."""
        index = max(bisect_right(self._along, self.progress) - 1, 0)
        best = math.inf
        progress = self.progress
        while index < len(self._along) - 1 and self._along[index] <= self.progress + SEARCH_AHEAD:
            along, distance = self._nearest_on(index, x, y)
            if distance < best and along >= self.progress:
                best, progress = distance, along
            index += 1
        self.progress = progress

    def _nearest_on(self, index: int, x: float, y: float) -> tuple[float, float]:
        """Return how far along the path, and how far from it, the nearest point of one piece is."""
        dx, dy = self._x[index + 1] - self._x[index], self._y[index + 1] - self._y[index]
        span = self._along[index + 1] - self._along[index]
        share = min(max(((x - self._x[index]) * dx + (y - self._y[index]) * dy) / span**2, 0.0), 1.0)
        distance = math.hypot(self._x[index] + share * dx - x, self._y[index] + share * dy - y)
        return self._along[index] + share * span, distance


def steer(me: Robot, target: tuple[float, float], speed: float, parameters: RobotParameters) -> tuple[float, float]:
    """Return the duties (left, right) that take the robot to a target point at this speed [m/s].

    It follows the arc through the target; where that lies behind, it turns on the spot.
    """
    dx, dy = target[0] - me.state.x, target[1] - me.state.y
    distance = max(math.hypot(dx, dy), 1e-6)
    bearing = float(wrap(math.atan2(dy, dx) - me.state.theta))
    if abs(bearing) < math.pi / 2.0:
        yaw_rate = 2.0 * speed * math.sin(bearing) / distance
    else:
        yaw_rate = math.copysign(2.0 * speed / parameters.base_width, bearing)
        speed = 0.0
    duties = [duty_for_speed(psi, parameters) for psi in wheels(speed, yaw_rate, parameters)]
    excess = max(1.0, *(abs(duty) / LARGEST_DUTY for duty in duties))
    return duties[0] / excess, duties[1] / excess

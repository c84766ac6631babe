"""Drive a named manoeuvre: duties over time, open loop, so that the log shows how the motors respond."""

import math

from cmr.bus.streams import COMMAND_LIFETIME
from cmr.geometry.manoeuvres import Duties, in_sequence
from cmr.geometry.manoeuvres.table import BETWEEN
from cmr.model.parameters import RobotParameters
from cmr.world.behaviours.behaviour import Behaviour
from cmr.world.view import Robot, WorldView

LARGEST_SPEED = 1.1  # times the manoeuvres' duty of 0.9 is nearly full drive
MOST_REPEATS = 100


class DriveManoeuvre(Behaviour):
    """Drive the manoeuvre `name` (or several in turn: steps+circles), `start` [s] after the beginning, then stop.

    `speed` multiplies all duties, `repeats` is the number of repetitions. The robot is not steered, so it stops for
    good if its centre is further than `space` [m] from its start, or if the drive was interrupted: it must not resume
    unexpectedly. By default `space` is the space of the manoeuvre for a robot of this speed and width
    (`cmr.geometry.manoeuvres.table`).
    """

    def __init__(
        self,
        name: str = "rich_drive",
        speed: float = 1.0,
        repeats: int = 1,
        start: float = 2.0,
        space: float | None = None,
    ) -> None:
        if not 0.0 < speed <= LARGEST_SPEED or not 1 <= repeats <= MOST_REPEATS:
            raise ValueError(f"speed must be above 0 up to {LARGEST_SPEED:g}, repeats 1 to {MOST_REPEATS}")
        if start < 0.0 or (space is not None and space <= 0.0):
            raise ValueError("start must be 0 or more, space above 0")
        self.manoeuvre = in_sequence(BETWEEN.join([name] * repeats))
        self.name, self.speed, self.start, self.space = name, speed, start, space
        self._duties: Duties | None = None
        self._place = (0.0, 0.0)
        self._began = self._last_utime = 0

    def command(self, utime: int, me: Robot, _world: WorldView, parameters: RobotParameters) -> tuple[float, float]:
        """Return the current duties; zero before and after the manoeuvre, and after it had to stop."""
        if self._duties is None:
            self._duties = self._begin(utime, me, parameters)
        time = (utime - self._began) * 1e-6 - self.start
        self.problem = self.problem or self._why_to_stop(utime, me)
        self.finished = bool(self.problem) or time >= self._duties.duration
        self._last_utime = utime
        left, right = self._duties.at(time)
        return (0.0, 0.0) if self.finished else (float(left), float(right))

    def _begin(self, utime: int, me: Robot, parameters: RobotParameters) -> Duties:
        """Note where and when the drive begins; return its duties for this robot."""
        self._began = self._last_utime = utime
        self._place = me.state.x, me.state.y
        self.space = self.space or self.manoeuvre.space_for(parameters, self.speed)
        return self.manoeuvre.duties(parameters, self.speed)

    def _why_to_stop(self, utime: int, me: Robot) -> str:
        """Return a sentence on why the robot must stop; empty while it may continue."""
        silence = utime - self._last_utime
        if abs(silence) > COMMAND_LIFETIME:
            return f"{self.name} was interrupted for {abs(silence) * 1e-6:.1f} s. Start it again."
        away = math.dist(self._place, (me.state.x, me.state.y))
        if self.space is not None and away > self.space:
            return (
                f"{self.name} took the robot {away:.2f} m from where it began; {self.space:.2f} m are allowed. "
                "Calibrate the robot first, drive with a smaller speed=, or clear the floor and allow more with space=."
            )
        return ""

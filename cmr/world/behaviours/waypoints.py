"""Drive paths of waypoints, from the bus or from a setting."""

import math

import numpy as np

from cmr.world.behaviours.paths import Paths
from cmr.world.behaviours.seeking import ACCELERATION, CLEARANCE, LOOK_AHEAD, Goals, Seeker, Team
from cmr.world.behaviours.team import Floats
from cmr.world.lazy_module import LazyModule
from cmr.world.view import Robots, WorldView

path_following = LazyModule("cmr.world.behaviours.path_following")
ARRIVED = 0.02  # m before the end of the path
MOST_POINTS = 100_000

Path = tuple[list[float], list[float]]


class Waypoints(Seeker):
    """Drive the waypoints of WAYPOINTS_N at `speed` [m/s] and stop at the last, going round obstacles.

    `points`, as in `points=0:0/1.5:0/1.5:1` [m; world frame], are driven from the start on, `laps` times (each lap
    but the last leads back to the first point). The path begins where the robot is.
    """

    def __init__(self, speed: float = 0.3, points: str = "", laps: int = 1, clearance: float = CLEARANCE) -> None:
        super().__init__(speed, clearance, progress=0.0, piece=0, announced=0)
        if laps < 1:
            raise ValueError("laps must be 1 or more")
        x, y = read_points(points)
        if laps * len(x) > MOST_POINTS:
            raise ValueError(f"{laps} laps of {len(x)} points are more than {MOST_POINTS} points")
        self.points: Path = (x * laps, y * laps)
        self._paths = Paths()
        self._to_lay: dict[int, Path] = {}  # by row
        self._announced = 0  # number of robots that were sent a path

    def take_waypoints(self, robot_id: int, x: list[float], y: list[float]) -> None:
        """Set one robot's path, starting where it is."""
        self._tell(self.memory.row(robot_id), (list(x), list(y)))

    def goals(self, utime: int, team: Team, me: Robots, world: WorldView) -> Goals:
        """Return points a short way ahead on the paths, and speeds at which robots can stop at the end."""
        target_x, target_y, remaining = self._pursue(utime, team, me, world)
        speed, round_it = np.empty(len(remaining)), np.empty(len(remaining), bool)
        settings = (ARRIVED, ACCELERATION, self.speed)
        path_following.stop_at_end(team.row, self._paths.count, remaining, team.apart, *settings, speed, round_it)
        return Goals(target_x, target_y, speed, round_it)

    def begins(self, _utime: int, _row: int, _x: float, _y: float, _theta: float) -> Path | None:
        """Return the default path of a robot at this pose [m, m, rad] that was sent none; None: not yet."""
        return self.points

    def _pursue(self, utime: int, team: Team, _me: Robots, _world: WorldView) -> tuple[Floats, Floats, Floats]:
        """Update progress; return targets and the remaining lengths of the paths, -1 without a path."""
        self._paths.make_room(len(self.memory), 0)
        self._lay(utime, team)
        paths, memory = self._paths, self.memory
        target_x, target_y, remaining = np.empty((3, len(team.x)))
        path_following.pursue(
            *(team.row, *paths.arrays, team.x, team.y, LOOK_AHEAD),
            *(memory["progress"], memory["piece"], target_x, target_y, remaining),
        )
        return target_x, target_y, remaining

    def _lay(self, utime: int, team: Team) -> None:
        """Lay the paths that are new, from where the robots are."""
        if self._announced < len(self.memory):
            for k in np.flatnonzero(self.memory["announced"][team.row] == 0).tolist():
                row = int(team.row[k])
                path = self.begins(utime, row, team.x[k], team.y[k], team.theta[k])
                if path is not None:
                    self._tell(row, path)
        if not self._to_lay:
            return
        places = {row: k for k, row in enumerate(team.row.tolist())}
        for row in self._to_lay.keys() & places.keys():
            x, y = self._to_lay.pop(row)
            k = places[row]
            start = ([float(team.x[k])], [float(team.y[k])]) if x else ([], [])
            self._paths.put(row, start[0] + x, start[1] + y)
            self.memory["progress"][row] = self.memory["piece"][row] = 0

    def _tell(self, row: int, path: Path) -> None:
        """Store a path that begins where the robot is at its next decision."""
        self._announced += int(self.memory["announced"][row] == 0)
        self.memory["announced"][row] = 1
        self._to_lay[row] = path


def read_points(text: str) -> Path:
    """Return the points of `x:y/x:y/...` [m]; an empty text gives none. Raises ValueError for anything else."""
    x, y = [], []
    for point in text.split("/") if text else []:
        numbers = [float(number) for number in point.split(":")]
        if len(numbers) != 2 or not all(math.isfinite(number) and abs(number) <= 1e6 for number in numbers):
            raise ValueError(f"points are written as points=0:0/1.5:0/1.5:1, in m; {point!r} is not")
        x.append(numbers[0])
        y.append(numbers[1])
    return x, y

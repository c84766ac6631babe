"""A behaviour of many robots: one object decides for all that run it, in arrays."""

from abc import ABC, abstractmethod
from typing import Any, ClassVar, TypeAlias

import numpy as np
from numpy.typing import NDArray

from cmr.model.parameters import RobotParameters
from cmr.world.behaviours.behaviour import Behaviour
from cmr.world.bounding import bounded
from cmr.world.view import Robot, Robots, WorldView

Floats: TypeAlias = NDArray[np.float64]
Indices: TypeAlias = NDArray[np.int64]
Duties: TypeAlias = NDArray[np.float64]  # (n, 2): left and right of each robot, -1 to 1

ROOM = 16  # initial capacity in robots; doubled when full


class TeamBehaviour(ABC):
    """Decides for many robots at once, from their knowledge of the world.

    Derive from it, give the constructor keyword arguments with defaults, and name the class as `your.module:YourClass`,
    or register it in the entry-point group `cmr.behaviours`. In cmr-sim all robots with the same description share one
    object; in cmr-pilot an object drives one real robot. Settings named in `per_robot` may differ among robots that
    share an object: `adopt` sets them. `finished` and `problem` are as in Behaviour.
    """

    per_robot: ClassVar[frozenset[str]] = frozenset()
    finished = False
    problem = ""

    @abstractmethod
    def commands(self, utime: int, me: Robots, world: WorldView, parameters: RobotParameters) -> Duties:
        """Return the duties (left, right), -1 to 1, of the n robots `me` at `utime` [us], as an array (n, 2).

        `me` are the robots that decide now: any of those that run this behaviour, in any order, including new ones. The
        fields of `me.state` and of `parameters`, those of each robot's model, are arrays of length n.
        """

    def take_waypoints(self, robot_id: int, x: list[float], y: list[float]) -> None:  # noqa: B027 - few have waypoints
        """Accept a path for one robot, as points [m; world frame]; empty means stop. Ignored unless overridden."""

    def adopt(self, robot_id: int, settings: dict[str, object]) -> None:  # noqa: B027 - few settings differ
        """Set one robot's values of the settings named in `per_robot`."""

    def prepare(self) -> None:  # noqa: B027 - most have nothing to load
        """Load or compile what `commands` needs, if that takes long. Called before the first turn, when nothing waits
        for it.
        """


class Memory:
    """A behaviour's memory of each robot: named arrays with a row for every robot id seen so far."""

    def __init__(self, **initial: float) -> None:
        self._initial = initial
        self._columns: dict[str, NDArray[np.number]] = {name: np.full(ROOM, value) for name, value in initial.items()}
        self._row_of: dict[int, int] = {}
        self._asked: tuple[int, ...] = ()
        self._answer: Indices = np.zeros(0, np.int64)

    def __getitem__(self, name: str) -> Any:
        """Return the named array; its dtype is that of the initial value.

        It may be longer than there are rows, and is replaced when rows are added.
        """
        return self._columns[name]

    def __len__(self) -> int:
        return len(self._row_of)

    @property
    def robot_ids(self) -> list[int]:
        """The ids of all robots seen so far, row by row."""
        return list(self._row_of)

    def rows(self, robot_ids: tuple[int, ...]) -> Indices:
        """Return the rows of these robots; new robots begin with the initial values."""
        if robot_ids is not self._asked:  # the tuple is the same object as long as the same robots are there
            self._answer = np.array([self.row(robot_id) for robot_id in robot_ids], np.int64)
            self._asked = robot_ids
        return self._answer

    def row(self, robot_id: int) -> int:
        """Return the row of one robot."""
        if robot_id not in self._row_of:
            self._row_of[robot_id] = len(self._row_of)
            if len(self._row_of) > len(next(iter(self._columns.values()), ())):
                self._grow()
        return self._row_of[robot_id]

    def _grow(self) -> None:
        for name, column in self._columns.items():
            self._columns[name] = np.append(column, np.full(len(column), self._initial[name], column.dtype))


class Alone(Behaviour):
    """One robot driven by a team behaviour, as in cmr-pilot."""

    def __init__(self, team: TeamBehaviour, robot_id: int) -> None:
        self.team = team
        self._robot_id = robot_id

    def command(self, utime: int, me: Robot, world: WorldView, parameters: RobotParameters) -> tuple[float, float]:
        """Return the duties (left, right) of the robot."""
        left, right = duties_of(self.team, utime, Robots.of([me]), world, stacked([parameters]))[0].tolist()
        self.finished, self.problem = self.team.finished, self.team.problem
        return left, right

    def prepare(self) -> None:
        """Prepare the team behaviour."""
        bounded(np.zeros((1, 2)))
        self.team.prepare()

    def take_waypoints(self, x: list[float], y: list[float]) -> None:
        """Pass the waypoints on."""
        self.team.take_waypoints(self._robot_id, x, y)


def stacked(parameters: list[RobotParameters]) -> RobotParameters:
    """Return the parameters of many robots as arrays, with effects if any robot has some."""
    if any(each.effects for each in parameters):
        from cmr.model.catalogue import together  # robots of the paper's model do not need the catalogue

        return together(parameters)
    return RobotParameters(*np.array([[*each] for each in parameters], dtype=float).reshape(-1, 4).T.copy())


def duties_of(
    behaviour: TeamBehaviour, utime: int, me: Robots, world: WorldView, parameters: RobotParameters
) -> Duties:
    """Return a behaviour's duties clipped to [-1, 1]; 0 for a robot with a NaN.

    Raises ValueError unless it returns a pair for each robot.
    """
    duties = np.asarray(behaviour.commands(utime, me, world, parameters), dtype=float)
    if duties.shape != (len(me.robot_id), 2):
        name = type(behaviour).__name__
        raise ValueError(
            f"{name}.commands must return an array of shape ({len(me.robot_id)}, 2), left and right of each robot; "
            f"it returned one of shape {duties.shape}."
        )
    return bounded(duties)

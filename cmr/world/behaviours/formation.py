"""Keep a place in a formation: line, column, wedge or circle."""

import math

import numpy as np

from cmr.world.behaviours.seeking import CLEARANCE, Goals, Seeker, Team, wheel_radius_of
from cmr.world.behaviours.team import Floats, Indices
from cmr.world.lazy_module import LazyModule
from cmr.world.surroundings import MISSING, Members, Surroundings
from cmr.world.view import Robots, WorldView

placing = LazyModule("cmr.world.behaviours.placing")
NO_LEADER = -1
SHAPES = ("line", "column", "wedge", "circle")


class Formation(Seeker):
    """Keep a place in a formation with the robot `leader`, or, with leader=-1, around the centre of the team.

    `shape` is line (abreast), column (behind one another), wedge or circle; neighbours are `spacing` [m] apart. It
    turns with the leader; without one it faces `heading` [rad]. Places are assigned in the order of `members`, robot
    ids as in `members=0:11:12`, or else by the ids of the robots with this description; a robot that leaves keeps its
    place. In cmr-pilot name the members, so that the real robot and cmr-sim agree. Robots stand while the leader is not
    in the world.
    """

    def __init__(
        self,
        leader: int = 10,
        shape: str = "wedge",
        spacing: float = 0.5,
        speed: float = 0.6,
        members: str = "",
        heading: float = 0.0,
        clearance: float = CLEARANCE,
    ) -> None:
        super().__init__(speed, clearance)
        if shape not in SHAPES:
            raise ValueError(f"shape is one of {', '.join(SHAPES)}, not {shape!r}")
        if not spacing > 0.0:
            raise ValueError("spacing must be above 0")
        self.leader, self.shape, self.spacing, self.heading = leader, shape, spacing, heading
        self.members = tuple(int(robot_id) for robot_id in members.split(":")) if members else ()
        self._members: Members | None = None
        self._leader_index = MISSING
        self._known = 0
        self._places: Floats = np.zeros((2, 0))
        self._row: Indices | None = None
        self._own_places: Floats = np.zeros((2, 0))

    def goals(self, _utime: int, team: Team, _me: Robots, world: WorldView) -> Goals:
        """Return targets that bring robots to their places and keep them there as the places move."""
        around = world.surroundings()
        if len(self.memory) != self._known:
            self._known, self._places, self._row = len(self.memory), self._places_by_row(), None
        if team.row is not self._row:  # the array is the same object as long as the same robots are there
            self._row, self._own_places = team.row, np.ascontiguousarray(self._places[:, team.row])
        ahead, left = self._own_places
        target_x, target_y, speed, distance = np.empty((4, len(team.row)))
        anchor = self._anchor(around, team)
        placing.keep_places(anchor, ahead, left, team.x, team.y, self.speed, target_x, target_y, speed, distance)
        return Goals(target_x, target_y, speed, distance > 2.0 * team.apart)

    def _team(self) -> list[int]:
        return list(self.members) or sorted(self.memory.robot_ids)

    def _places_by_row(self) -> Floats:
        """Return the place of each robot of the memory, ahead and to the left [m]; NaN for those that are not in it."""
        team = self._team()
        places = places_of(self.shape, self.spacing, len(team), with_leader=self.leader != NO_LEADER)
        rank = {robot_id: number for number, robot_id in enumerate(team)}
        nowhere = np.full(2, math.nan)
        return np.array([places[rank[i]] if i in rank else nowhere for i in self.memory.robot_ids]).reshape(-1, 2).T

    def _anchor(self, around: Surroundings, team: Team) -> Floats:
        """Return pose [m, m, rad], speed [m/s] and yaw rate [rad/s] of the formation's reference; NaN if missing."""
        if self.leader == NO_LEADER:
            index = around.members.index_of(np.array(self._team(), np.int64))
            index = index[index != MISSING]
            if not len(index):
                return np.full(5, math.nan)
            return np.array([np.mean(around.x[index]), np.mean(around.y[index]), self.heading, 0.0, 0.0])
        if around.members is not self._members:
            self._members, self._leader_index = around.members, int(around.members.index_of(np.array([self.leader]))[0])
        leader = self._leader_index
        if leader == MISSING or not len(team.row):
            return np.full(5, math.nan)
        left, right = around.psi_left[leader], around.psi_right[leader]
        radius = wheel_radius_of(team)
        yaw_rate = radius * (right - left) / float(team.parameters.base_width[0])
        pose = (around.x[leader], around.y[leader], around.theta[leader])
        return np.array([*pose, radius * (left + right) / 2.0, yaw_rate])


def places_of(shape: str, spacing: float, count: int, *, with_leader: bool) -> Floats:
    """Return `count` places (count, 2), ahead and to the left [m], of a leader or of the middle of the team."""
    if shape == "circle":
        angle = 2.0 * np.pi * np.arange(count) / max(count, 1)
        radius = spacing / (2.0 * math.sin(math.pi / count)) if count > 1 else 0.0
        radius = max(radius, spacing) if with_leader else radius
        return radius * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    number = np.arange(1 if with_leader else 0, count + 1 if with_leader else count)
    rank, side = (number + 1) // 2, np.where(number % 2 == 1, 1.0, -1.0)
    places = {
        "line": np.stack([0.0 * rank, side * rank], axis=1),
        "column": np.stack([-1.0 * number, 0.0 * number], axis=1),
        "wedge": np.stack([-1.0 * rank, side * rank], axis=1) / math.sqrt(2.0),
    }[shape]
    return spacing * (places if with_leader or not count else places - places.mean(axis=0))

"""A follower: drives where its leader drove, at a distance."""

from typing import Any, ClassVar

import numpy as np

from cmr.world.behaviours.paths import Paths
from cmr.world.behaviours.seeking import CLEARANCE, LOOK_AHEAD, Goals, Seeker, Team
from cmr.world.behaviours.team import Floats, Indices
from cmr.world.lazy_module import LazyModule
from cmr.world.surroundings import Members
from cmr.world.view import Robots, WorldView

path_following = LazyModule("cmr.world.behaviours.path_following")
SPEED_PER_DISTANCE = 1.5  # 1/s: speed for each metre too far behind
DEAD_ZONE = 0.02  # m; nearer than this to its place, the robot rests
MOST_POINTS = 4096  # of a trail: 160 m; a leader further ahead is followed by a shorter way


class Follow(Seeker):
    """Follow the robot `leader` on its trail, `gap` [m] behind it along the trail, at most at `speed` [m/s].

    The robot drives the leader's path, not the shortest way to the leader, so that a leader can make it drive a
    figure-eight. It rests while the leader is not in the world, and before robots and discs in its way (`clearance`).
    A leader may follow another: so they drive in line.
    """

    per_robot: ClassVar[frozenset[str]] = frozenset({"leader", "gap"})

    def __init__(self, leader: int = 10, gap: float = 0.5, speed: float = 0.6, clearance: float = CLEARANCE) -> None:
        if gap <= 0.0 or speed <= 0.0:
            raise ValueError("gap and speed must be above 0")
        super().__init__(speed, clearance, leader=leader, gap=gap, progress=0.0, piece=0)
        self._trails = Paths()
        self._leaders: tuple[Indices, Members, Indices] | None = None

    def adopt(self, robot_id: int, settings: dict[str, Any]) -> None:
        """Let one robot have a leader, or a gap, of its own."""
        row, self._leaders = self.memory.row(robot_id), None
        for name, value in settings.items():
            self.memory[name][row] = value

    def goals(self, _utime: int, team: Team, _me: Robots, world: WorldView) -> Goals:
        """Return points on the trails, and speeds that keep the gaps."""
        length, target_x, target_y, remaining = self._pursue(team, world)
        progress, gap, speed = self.memory["progress"], self.memory["gap"], np.empty(len(length))
        path_following.keep_gaps(
            team.row, length, remaining, progress, gap, SPEED_PER_DISTANCE, DEAD_ZONE, self.speed, speed
        )
        return Goals(target_x, target_y, speed, np.zeros(len(speed), bool))

    def _pursue(self, team: Team, world: WorldView) -> tuple[Floats, Floats, Floats, Floats]:
        """Let trails and progress grow; return the lengths of the trails, targets and what remains of the paths."""
        around, memory, trails = world.surroundings(), self.memory, self._trails
        leader = self._leaders_of(team.row, around.members)
        trails.make_room(len(memory), 0)
        path, place = trails.arrays, (memory["progress"], memory["piece"])
        length, target_x, target_y, remaining = np.empty((4, len(team.x)))
        most = path_following.trail(team.row, leader, *path, around.x, around.y, team.x, team.y, *place, length)
        path_following.pursue(team.row, *path, team.x, team.y, LOOK_AHEAD, *place, target_x, target_y, remaining)
        if trails.room < min(2 * most, MOST_POINTS):
            trails.make_room(0, 2 * most)
        return length, target_x, target_y, remaining

    def _leaders_of(self, row: Indices, members: Members) -> Indices:
        """Return where the leaders are among everybody; the answer is kept as long as the same are asked for."""
        if self._leaders is None or self._leaders[0] is not row or self._leaders[1] is not members:
            self._leaders = (row, members, members.index_of(self.memory["leader"][row]))
        return self._leaders[2]

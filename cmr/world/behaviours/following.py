"""A follower: drives where its leader drove, at a distance."""

from typing import ClassVar

import numpy as np

from cmr.world.behaviours.leaders import Leaders
from cmr.world.behaviours.paths import Paths
from cmr.world.behaviours.seeking import CLEARANCE, LOOK_AHEAD, Goals, Seeker, Team
from cmr.world.behaviours.team import Floats
from cmr.world.lazy_module import LazyModule
from cmr.world.view import Robots, WorldView

path_following = LazyModule("cmr.world.behaviours.path_following")
SPEED_PER_DISTANCE = 1.5  # 1/s: speed for each metre too far behind
DEAD_ZONE = 0.02  # m; nearer than this to its place, the robot rests
MOST_POINTS = 4096  # of a trail: 160 m; a leader further ahead is followed by a shorter way


class Follow(Seeker):
    """Follow the robot `leader` on its trail, `gap` [m] behind it along the trail, at most at `speed` [m/s].

    The robot drives the leader's path, not the shortest way to the leader, so that a leader can make it drive a
    figure-eight. It stops while the leader is not in the world, and before robots and discs in its way (`clearance`).
    Leaders may follow other leaders, forming a line.
    """

    per_robot: ClassVar[frozenset[str]] = frozenset({"leader", "gap"})

    def __init__(self, leader: int = 10, gap: float = 0.5, speed: float = 0.6, clearance: float = CLEARANCE) -> None:
        if gap <= 0.0 or speed <= 0.0:
            raise ValueError("gap and speed must be above 0")
        super().__init__(speed, clearance, leader=leader, gap=gap, progress=0.0, piece=0)
        self._trails = Paths()
        self._leaders = Leaders(self.memory)

    def adopt(self, robot_id: int, settings: dict[str, object]) -> None:
        """Set one robot's own leader or gap."""
        self._leaders.adopt(robot_id, settings)

    def goals(self, _utime: int, team: Team, me: Robots, world: WorldView) -> Goals:
        """Return points on the trails, and speeds that keep the gaps."""
        length, target_x, target_y, remaining = self._pursue(team, me, world)
        progress, gap, speed = self.memory["progress"], self.memory["gap"], np.empty(len(length))
        path_following.keep_gaps(
            team.row, length, remaining, progress, gap, SPEED_PER_DISTANCE, DEAD_ZONE, self.speed, speed
        )
        return Goals(target_x, target_y, speed, np.zeros(len(speed), bool))

    def _pursue(self, team: Team, me: Robots, world: WorldView) -> tuple[Floats, Floats, Floats, Floats]:
        """Extend the trails and update progress; return the lengths of the trails, targets and what remains of the
        paths.
        """
        around, memory, trails = world.surroundings(), self.memory, self._trails
        leader = self._leaders.places(team.row, me.robot_id, around.members)
        trails.make_room(len(memory), 0)
        path, place = trails.arrays, (memory["progress"], memory["piece"])
        length, target_x, target_y, remaining = np.empty((4, len(team.x)))
        most = path_following.trail(team.row, leader, *path, around.x, around.y, team.x, team.y, *place, length)
        path_following.pursue(team.row, *path, team.x, team.y, LOOK_AHEAD, *place, target_x, target_y, remaining)
        if trails.room < min(2 * most, MOST_POINTS):
            trails.make_room(0, 2 * most)
        return length, target_x, target_y, remaining

"""Drive waypoints through a crossing, one robot at a time, in the order that a rule of the road gives."""

import numpy as np
from numpy.typing import NDArray

from cmr.world.behaviours.crossing import NOBODY, SMALLEST_ZONE, Crossing, crossing_loops
from cmr.world.behaviours.seeking import ACCELERATION, CLEARANCE, Goals, Team
from cmr.world.behaviours.team import Indices
from cmr.world.behaviours.waypoints import Waypoints
from cmr.world.view import Robots, WorldView

RULES = ("right", "first")


class RightOfWay(Waypoints):
    """Drive waypoints, as `waypoints` does, through a crossing about (`at_x`, `at_y`) [m] without a traffic light.

    Robots stop `zone` [m] before the middle of it until it is their turn: with rule=right nobody goes while another
    waits on its right, with rule=first who came first goes first. If each has another on its right, or several arrive
    at once, the lowest id goes. Paths of opposite directions must leave room for two robots side by side, and end
    outside the zone.
    """

    def __init__(
        self,
        speed: float = 0.3,
        points: str = "",
        laps: int = 1,
        at_x: float = 0.0,
        at_y: float = 0.0,
        zone: float = 0.8,
        rule: str = "right",
        clearance: float = CLEARANCE,
    ) -> None:
        super().__init__(speed, points, laps, clearance)
        if rule not in RULES:
            raise ValueError(f"rule is right or first, not {rule!r}")
        if not zone > SMALLEST_ZONE:
            raise ValueError(f"zone must be above {SMALLEST_ZONE:g} m")
        self._crossing = Crossing(at_x, at_y, zone, by_right=rule == "right")
        self._place: Indices | None = None
        self._robot_id: Indices = np.zeros(0, np.int64)

    def goals(self, utime: int, team: Team, me: Robots, world: WorldView) -> Goals:
        """Return target points on the paths, with speeds that stop waiting robots at their lines."""
        goals = super().goals(utime, team, me, world)
        goals.round_it[:] = False  # robots in the way will move on
        inward = self._heads_in(team, goals)
        around = world.surroundings()
        free = self._crossing.free_for(utime, around, team.place, inward)
        if team.place is not self._place:
            self._place = team.place
            self._robot_id = np.append(around.members.robot_id, NOBODY)[team.place]  # a MISSING robot counts as NOBODY
        self._crossing.wait(self._robot_id, team.x, team.y, inward, free, ACCELERATION, goals.speed)
        return goals

    def _heads_in(self, team: Team, goals: Goals) -> NDArray[np.bool_]:
        """Return which robots head for the middle; robots at rest do not."""
        inward = np.empty(len(team.x), bool)
        at = self._crossing.at_x, self._crossing.at_y
        crossing_loops.head_in(*at, team.x, team.y, goals.x, goals.y, goals.speed, inward)
        return inward

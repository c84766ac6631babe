"""Rows of the behaviours: what a decision costs for each robot, neighbours and steering included."""

from collections.abc import Iterator

import numpy as np

from benchmarks.drive import TRUTH
from benchmarks.report import Row, per_robot
from benchmarks.timing import clocked, in_turns
from cmr.model.motion import RobotState
from cmr.world.behaviours import TeamBehaviour
from cmr.world.behaviours.flocking import Flock
from cmr.world.behaviours.following import Follow
from cmr.world.behaviours.formation import Formation
from cmr.world.behaviours.right_of_way import RightOfWay
from cmr.world.behaviours.team import duties_of, stacked
from cmr.world.behaviours.waypoints import Waypoints
from cmr.world.view import VIRTUAL, Robots, WorldView

ROBOTS = 1_000
AREA_OF_ONE = 4.0  # m^2 for each robot
LONGEST = 100e-9  # s for each robot and step
STEP = 10_000  # us


class Moment:
    """A world of robots at random places in which everybody is asked again and again, each time a step later."""

    def __init__(self, team: TeamBehaviour) -> None:
        random = np.random.default_rng(0)
        side = np.sqrt(ROBOTS * AREA_OF_ONE) / 2.0
        state = RobotState(
            *random.uniform(-side, side, (2, ROBOTS)),
            random.uniform(-3.0, 3.0, ROBOTS),
            *random.uniform(0.0, 7.0, (2, ROBOTS)),
            *np.zeros((2, ROBOTS)),
        )
        self._team, self._world, self._utime = team, WorldView(), 1_800_000_000_000_000
        self._robots = Robots(tuple(range(ROBOTS)), (VIRTUAL,) * ROBOTS, state)
        self._parameters = stacked([TRUTH] * ROBOTS)
        for robot_id in range(ROBOTS):
            team.take_waypoints(robot_id, *random.uniform(-side, side, (2, 10)).tolist())

    def decide(self) -> None:
        """Decide for everybody; neighbours are looked up anew, as after each step."""
        self._utime += STEP
        self._world.take(self._utime, self._robots)
        duties_of(self._team, self._utime, self._robots, self._world, self._parameters)


def behaviours() -> Iterator[Row]:
    """Measure each shipped behaviour of many robots."""
    teams: dict[str, TeamBehaviour] = {
        "follow": Follow(leader=0),
        "waypoints": Waypoints(),
        "formation": Formation(leader=0),
        "flock": Flock(),
        "right_of_way": RightOfWay(),
    }
    for name, timing in in_turns({name: clocked(Moment(team).decide) for name, team in teams.items()}).items():
        yield Row(
            f"decision of {ROBOTS:,} robots, {name}",
            per_robot(timing, ROBOTS),
            goal=f"{LONGEST * 1e9:g} ns",
            reached=timing.median / ROBOTS <= LONGEST,
        )

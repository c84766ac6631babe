"""Rows of the behaviours: the cost of a decision per robot, including the search for neighbours and steering."""

import math
from collections.abc import Iterator
from itertools import count

import numpy as np

from benchmarks.drive import EPOCH, NOMINAL, TRUTH
from benchmarks.report import Row, per_robot, seconds
from benchmarks.timing import clocked, in_turns
from cmr.model.catalogue import together
from cmr.model.motion import RobotState
from cmr.model.parameters import RobotParameters
from cmr.parameters.following import ParameterFollower
from cmr.world.behaviours import Behaviour, TeamBehaviour
from cmr.world.behaviours.flocking import Flock
from cmr.world.behaviours.following import Follow
from cmr.world.behaviours.formation import Formation
from cmr.world.behaviours.right_of_way import RightOfWay
from cmr.world.behaviours.shadowing import Shadow
from cmr.world.behaviours.team import duties_of
from cmr.world.behaviours.waypoints import Waypoints
from cmr.world.view import VIRTUAL, Numbers, Robot, Robots, WorldView
from cmr.world.world import VirtualRobot, World

ROBOTS = 1_000
AREA_PER_ROBOT = 4.0  # m^2
LONGEST = 100e-9  # s for each robot and step
STEP = 10_000  # us
LEG = 2_000_000  # us after which robots reverse direction
ONE_BY_ONE = 200  # robots, each with its own behaviour in Python
SPACING = 0.7  # m between them


class Chase(Behaviour):
    """An example of a user's behaviour for one robot: drive towards another robot, and stop half a metre away."""

    def __init__(self, ahead: int) -> None:
        self.ahead = ahead

    def command(self, _utime: int, me: Robot, world: WorldView, _parameters: RobotParameters) -> tuple[float, float]:
        """Return the duties (left, right)."""
        other = world.robot(self.ahead)
        if other is None:
            return 0.1, 0.2
        dx, dy = other.state.x - me.state.x, other.state.y - me.state.y
        bearing = math.atan2(dy, dx) - me.state.theta
        forward = 0.2 * math.cos(bearing) * (math.hypot(dx, dy) > 0.5)
        turn = 0.06 * math.sin(bearing)
        return forward - turn, forward + turn


class Moment:
    """A world of robots at random places, whose decisions are computed step after step.

    They drive to and fro at their wheel speeds; robots at rest would cost less.
    """

    def __init__(self, team: TeamBehaviour) -> None:
        random = np.random.default_rng(0)
        side = np.sqrt(ROBOTS * AREA_PER_ROBOT) / 2.0
        x, y = random.uniform(-side, side, (2, ROBOTS))
        theta = random.uniform(-3.0, 3.0, ROBOTS)
        psi_left, psi_right = random.uniform(0.0, 7.0, (2, ROBOTS))
        state = RobotState.at_rest(x, y, theta)._replace(psi_left=psi_left, psi_right=psi_right)
        self._team, self._world, self._utime = team, WorldView(), 1_800_000_000_000_000
        self._robots = Robots(Numbers(range(ROBOTS)), Numbers([VIRTUAL] * ROBOTS), state)
        self._parameters = together([TRUTH] * ROBOTS)
        ahead = 0.5 * TRUTH.wheel_radius * (psi_left + psi_right) * STEP * 1e-6
        self._dx, self._dy = ahead * np.cos(theta), ahead * np.sin(theta)
        for robot_id in range(ROBOTS):
            team.take_waypoints(robot_id, *random.uniform(-side, side, (2, 10)).tolist())

    def decide(self) -> None:
        """Advance by a step, and decide for all robots."""
        self._utime += STEP
        is_forward = self._utime // LEG % 2 == 0
        for place, way in ((self._robots.state.x, self._dx), (self._robots.state.y, self._dy)):
            (np.add if is_forward else np.subtract)(place, way, out=place)
        self._world.take(self._utime, self._robots)
        duties_of(self._team, self._utime, self._robots, self._world, self._parameters)


def behaviours() -> Iterator[Row]:
    """Measure each shipped behaviour of many robots."""
    teams: dict[str, TeamBehaviour] = {
        "follow": Follow(leader=0),
        "shadow": Shadow(leader=0),
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
    yield _one_by_one()


def _one_by_one() -> Row:
    """Measure a whole world, without the bus, of robots that each have their own Python behaviour."""
    side = math.isqrt(ONE_BY_ONE - 1) + 1
    robots = [
        VirtualRobot(robot_id, Chase(robot_id - 1), 0, robot_id % side * SPACING, robot_id // side * SPACING)
        for robot_id in range(ONE_BY_ONE)
    ]
    world = World(robots, ParameterFollower)
    world.handle(EPOCH, "PARAMETERS_0", NOMINAL.announcement(1))
    moments = count(EPOCH, STEP)
    world.advance(next(moments))
    timing = in_turns({"world": clocked(lambda: world.advance(next(moments)))})["world"]
    share = timing.median / (STEP * 1e-6)
    return Row(
        f"a step of a world of {ONE_BY_ONE} robots, each with its own behaviour in Python",
        seconds(timing),
        f"{share:.0%} of a core at 100 Hz",
        "100%",
        share <= 1.0,
    )

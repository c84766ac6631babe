"""Common base of the shipped behaviours: each gives targets and speeds; this module drives robots there safely."""

from abc import abstractmethod
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cmr.model.motion import RobotState
from cmr.model.parameters import RobotParameters
from cmr.world.behaviours.team import Duties, Floats, Indices, Memory, TeamBehaviour
from cmr.world.interaction.body import body_radius
from cmr.world.lazy_module import LazyModule
from cmr.world.surroundings import Members, Surroundings
from cmr.world.view import VIRTUAL, Robot, Robots, WorldView

border = LazyModule("cmr.world.behaviours.border")
clearance = LazyModule("cmr.world.behaviours.clearance")
steering = LazyModule("cmr.world.behaviours.steering")
ACCELERATION = 0.5  # m/s^2
LONGEST_TURN = 0.1  # s; after a longer pause, speed grows only by as much as in this time
CLEARANCE = 0.05  # m between the bodies of robots
LOOK_AHEAD = 0.15  # m along a path to the target point


class Team(NamedTuple):
    """The n robots that decide now: their rows in the memory, their indices among all robots, poses and parameters.

    `radius` [m] is that of each body, `apart` [m] the least distance between its centre and that of another robot.
    """

    row: Indices
    place: Indices
    x: Floats
    y: Floats
    theta: Floats
    radius: Floats
    apart: Floats
    parameters: RobotParameters


class Goals(NamedTuple):
    """Where n robots head for [m], how fast [m/s], and which may go round obstacles."""

    x: Floats
    y: Floats
    speed: Floats
    round_it: NDArray[np.bool_]


class Seeker(TeamBehaviour):
    """A behaviour whose robots drive to target points; derive from it and implement `goals`.

    They accelerate with ACCELERATION, keep their bodies `clearance` [m] away from other robots and discs, and their
    centres as far inside the world's geofence. If there is no way past, they stop.
    """

    def __init__(self, speed: float, clearance: float, **remembered: float) -> None:
        if not speed > 0.0 or not clearance >= 0.0:
            raise ValueError("speed must be above 0, clearance 0 or more")
        self.speed, self.clearance = speed, clearance
        self.memory = Memory(speed=0.0, utime=0.0, **remembered)
        self._index: tuple[tuple[int, ...], Members, Indices] | None = None
        self._sizes: tuple[RobotParameters, Floats, Floats] | None = None
        self._widest = 0.0  # largest `apart` [m]

    @abstractmethod
    def goals(self, utime: int, team: Team, me: Robots, world: WorldView) -> Goals:
        """Return the targets and speeds of these robots; with speed 0 a robot stops."""

    def prepare(self) -> None:
        """Load the compiled functions by running them with no robot of ours among two others."""
        nobody, world = np.zeros(0), WorldView()
        world.take(0, Robots.of(Robot(0, robot_id, VIRTUAL, RobotState.at_rest()) for robot_id in range(2)))
        self.commands(0, Robots.of([]), world, RobotParameters(nobody, nobody, nobody, nobody))

    def commands(self, utime: int, me: Robots, world: WorldView, parameters: RobotParameters) -> Duties:
        """Return the duties that drive robots to their `goals`."""
        around = world.surroundings()
        row = self.memory.rows(me.robot_id)
        x, y, theta = (np.ascontiguousarray(column, dtype=float) for column in me.state[:3])
        index, sizes = self._index_of(me.robot_id, around.members), self._sizes_of(parameters)
        team = Team(row, index, x, y, theta, *sizes, parameters)
        goals = self.goals(utime, team, me, world)
        decided, speed = self.memory["utime"], self.memory["speed"]
        highest = steering.gather_speed(row, float(utime), LONGEST_TURN, ACCELERATION, decided, speed, goals.speed)
        forward = self._keep_clear(team, goals, highest, around, world)
        duties = np.empty((2, len(row)))
        body = (parameters.wheel_radius, parameters.k1, parameters.base_width)
        steering.steer(row, x, y, theta, *goals[:3], forward, *body, speed, *duties)
        return duties.T

    def _keep_clear(self, team: Team, goals: Goals, highest: float, around: Surroundings, world: WorldView) -> Floats:
        """Limit speeds, of which `highest` is the largest, and move targets, to avoid obstacles.

        Returns the speed limits along the headings [m/s].
        """
        forward = np.empty(len(team.row))
        near = around.neighbours(clearance.view_needed(self._widest, highest, clearance.REACTION))
        speed_x, speed_y = around.velocities(wheel_radius_of(team))
        clearance.keep_clear(
            *(team.place, team.theta, near.start, near.index, around.x, around.y, speed_x, speed_y),
            *(world.obstacles.discs, goals.round_it, team.radius, self.clearance, clearance.REACTION),
            *(goals.x, goals.y, goals.speed, forward),
        )
        if world.geofence:
            how = (self.clearance, clearance.REACTION)
            border.stop_before(team.x, team.y, team.theta, world.geofence.outline, *how, forward)
        return forward

    def _sizes_of(self, parameters: RobotParameters) -> tuple[Floats, Floats]:
        """Return the radius of each robot and its distance to others [m]; cached for the same robots."""
        if self._sizes is None or self._sizes[0] is not parameters:
            radius = body_radius(parameters.base_width)
            self._sizes = (parameters, radius, 2.0 * radius + self.clearance)
            self._widest = float(self._sizes[2].max(initial=0.0))
        return self._sizes[1:]

    def _index_of(self, robot_ids: tuple[int, ...], members: Members) -> Indices:
        """Return the indices of these robots among all; cached while the arguments are the same."""
        if self._index is None or self._index[0] is not robot_ids or self._index[1] is not members:
            self._index = (robot_ids, members, members.index_of(np.array(robot_ids, np.int64)))
        return self._index[2]


def corners_of(world: WorldView) -> Floats:
    """Return the corners of the world's geofence (2, n) [m], empty without one."""
    return world.geofence.outline if world.geofence else np.zeros((2, 0))


def wheel_radius_of(team: Team) -> float:
    """Return the wheel radius [m] for computing other robots' speeds, which are assumed to be of the same kind."""
    return float(team.parameters.wheel_radius[0]) if len(team.row) else 0.0

"""One experiment with a team, without hardware or bus, faster than real time and deterministic for a seed.

Simulator, estimators and pilots are those of the live system (`cmr.world`), fed with messages at the same rates.
Virtual robots follow the model. Real robots follow an independent plant, which is hidden from the model.
"""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from cmr.bus.streams import PARAMETERS, WORLD_STATE
from cmr.experiments.team.metrics import Way, passed
from cmr.experiments.team.plan import RobotPlan, Scenario
from cmr.experiments.team.real_robots import PERIOD, OnChannel, RealRobots
from cmr.experiments.team.roles import Roles
from cmr.experiments.team.scoring import scores, ways_of
from cmr.experiments.team.world import virtual_robots, waypoints_of, world_of
from cmr.geometry.obstacles import Geofence
from cmr.geometry.places import Pose
from cmr.parameters.file import ParameterFile
from cmr.parameters.following import ParameterFollower
from cmr.world.behaviours import BehaviourError
from cmr.world.pilot import Pilot
from cmr.world.view import VIRTUAL, world_messages
from cmr.world.world import VirtualRobot, World

Floats = NDArray[np.float64]
EPOCH = 1_700_000_000_000_000  # us; start time of experiments
RECORD_EVERY = 2  # periods: trajectories at 25 Hz


class ExperimentError(Exception):
    """The experiment cannot be run; the text gives the reason and the remedy."""


@dataclass(frozen=True)
class TeamRun:
    """The true trajectories: `time` [s] of shape (t,), `x`, `y` [m] and `theta` [rad] of shape (t, n).

    `robot_ids` are those of the columns; `metrics` holds the team's metrics by name, in the units of
    `cmr.experiments.team.metrics`, NaN for undefined ones. `waypoints_reached`: all robots have passed their waypoints.
    """

    robot_ids: tuple[int, ...]
    time: Floats
    x: Floats
    y: Floats
    theta: Floats
    metrics: Mapping[str, float]
    waypoints_reached: bool


def run(
    scenario: Scenario,
    roles: Roles,
    seed: int,
    *,
    listen: Callable[[int, OnChannel], None] = lambda _utime, _message: None,
) -> TeamRun:
    """Run a scenario until its duration is over, or its waypoints are reached if this ends it.

    `seed` determines all random numbers. `listen` gets all messages from and to real robots, with their time [us].
    Raises ExperimentError for a robot without a start or a behaviour, and if the scenario has process noise that the
    parameter file does not specify.
    """
    world, real = _world(scenario, roles, seed), _real_robots(scenario, roles, seed)
    for message in waypoints_of(scenario.robots, EPOCH):
        world.handle(EPOCH, *message)
        real.hear(EPOCH, [message])
    places: list[Floats] = []
    all_passed = False
    ways = ways_of(scenario, {robot.robot_id: column for column, robot in enumerate(scenario.robots)})
    counts = dict.fromkeys(ways, 0)  # waypoints passed
    for period in range(round(scenario.duration * 1e6) // PERIOD + 1):
        utime = EPOCH + period * PERIOD
        if period % RECORD_EVERY == 0:
            places.append(_places(scenario, world, real))
            all_passed = _count_waypoints(counts, ways, places[-1])
            if scenario.ends_when.waypoints_reached and all_passed:
                break
        _take_turns(utime, world, real, listen)
    return _run_of(scenario, np.array(places), all_passed)


def _take_turns(utime: int, world: World, real: RealRobots, listen: Callable[[int, OnChannel], None]) -> None:
    """Simulate a period: robots measure, the simulator advances, pilots receive its messages and decide."""
    for message in real.advance(utime):
        world.handle(utime, *message)
        listen(utime, message)
    world.advance(utime)
    real.hear(utime, [(WORLD_STATE.name, message) for message in world_messages(utime, world.everybody())])
    for message in real.decide(utime):
        world.handle(utime, *message)
        listen(utime, message)


def _count_waypoints(counts: dict[int, int], ways: Mapping[int, Way], places: Floats) -> bool:
    """Update the number of waypoints passed by robots at these positions, (3, n), by column; return whether all are
    passed.
    """
    for column, way in ways.items():
        counts[column] = passed(float(places[0, column]), float(places[1, column]), way, counts[column])
    return all(counts[column] == len(way) for column, way in ways.items())


def _of_one_program(robots: Iterable[RobotPlan], believed: ParameterFile) -> list[VirtualRobot]:
    """Return robots that one program moves, with their behaviours; they steer by the believed parameters.

    Raises ExperimentError for a robot without a behaviour or a start, or with an invalid behaviour.
    """
    plans = [replace(robot, parameters_of=believed.robot_id, start=_start(robot)) for robot in robots]
    for robot in plans:
        if robot.behaviour is None:
            raise ExperimentError(f"Robot {robot.robot_id} has no behaviour; without hardware nobody else commands it.")
    try:
        return virtual_robots(plans)
    except BehaviourError as error:
        raise ExperimentError(str(error)) from error


def _start(robot: RobotPlan) -> Pose:
    if robot.start is None:
        raise ExperimentError(f"Robot {robot.robot_id} has no start: without hardware somebody must say where it is.")
    return robot.start


def _world(scenario: Scenario, roles: Roles, seed: int) -> World:
    """Return the simulator with all virtual robots, and parameters for everybody."""
    robots = [robot for robot in scenario.robots if robot.robot_id not in roles.real]
    virtual, follow = _of_one_program(robots, roles.believed), partial(_follower, roles.believed)
    world = world_of(scenario, virtual, follow, own_parameters=roles.moves_by, seed=seed)
    if world.noise_problem:
        raise ExperimentError(world.noise_problem)
    return world


def _real_robots(scenario: Scenario, roles: Roles, seed: int) -> RealRobots:
    robots = [robot for robot in scenario.robots if robot.robot_id in roles.real]
    return RealRobots(
        [_pilot(robot, roles.believed, scenario.fence) for robot in robots],
        [roles.laboratory.robot(r.robot_id) for r in robots],
        np.reshape([_start(robot) for robot in robots], (-1, 3)).T,
        [(seed, robot.robot_id) for robot in robots],
    )


def _pilot(robot: RobotPlan, believed: ParameterFile, geofence: Geofence | None) -> Pilot:
    """Return the pilot of a real robot, with a behaviour of its own, since each pilot is a separate program."""
    [moved] = _of_one_program([robot], believed)
    return Pilot(robot.robot_id, moved.behaviour, _follower(believed, robot.robot_id), geofence=geofence)


def _follower(believed: ParameterFile, robot_id: int) -> ParameterFollower:
    """Return the follower of a robot's parameters: the believed ones, under its own id."""
    follower = ParameterFollower(robot_id)
    announced = replace(believed, robot_id=robot_id).announcement(sequence=1)
    follower.handle(0, PARAMETERS.channel(robot_id), announced)
    return follower


def _places(scenario: Scenario, world: World, real: RealRobots) -> Floats:
    """Return the true poses of all robots, shape (3, n), in the order of the scenario."""
    everybody = world.everybody()
    simulated = np.array(everybody.state[:3], dtype=float)
    keys = zip(everybody.robot_id, everybody.origin, strict=True)
    columns = {robot_id: simulated[:, at] for at, (robot_id, origin) in enumerate(keys) if origin == VIRTUAL}
    columns.update(zip(real.robot_ids, real.place.T.copy(), strict=True))
    return np.array([columns.get(robot.robot_id, _start(robot)) for robot in scenario.robots]).T


def _run_of(scenario: Scenario, places: Floats, waypoints_reached: bool) -> TeamRun:
    """Return the run with its metrics; `places` has the shape (t, 3, n)."""
    time: Floats = np.arange(len(places), dtype=float) * (RECORD_EVERY * PERIOD * 1e-6)
    x, y, theta = places.transpose(1, 0, 2)
    ids = tuple(robot.robot_id for robot in scenario.robots)
    return TeamRun(ids, time, x, y, theta, scores(scenario, ids, time, x, y), waypoints_reached)

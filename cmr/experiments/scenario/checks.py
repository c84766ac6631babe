"""Consistency checks between the robots of a scenario, and with their surroundings."""

import math
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import replace
from itertools import product
from pathlib import Path

from cmr.documents.document import DocumentError, Item, Place
from cmr.experiments.scenario.robots import Placed
from cmr.experiments.team.plan import RobotPlan
from cmr.geometry.obstacles import Geofence
from cmr.geometry.places import Disc, Pose, Wall, distance_to
from cmr.parameters.file import ParameterFile, ParameterFileError
from cmr.parameters.file import load as load_parameters
from cmr.world.process_noise import STRAYED

LEADER = "leader"  # the setting of a behaviour that names another robot


def with_sources_of_parameters(placed: Sequence[Placed], shared: Path | None) -> list[Placed]:
    """Return the robots, each with a source of parameters: its own file, the scenario's, or another robot's.

    A virtual robot that names none uses the first real or emulated robot's, if there is one. Raises ScenarioError if
    there is no source, and for invalid files.
    """
    first = next((plan.robot_id for plan, _ in placed if plan.kind != "virtual"), None)
    sourced = [Placed(_with_source(robot, first, shared), robot.place) for robot in placed]
    own = {plan.robot_id for plan, _ in sourced if plan.parameters is not None}
    files: dict[Path, ParameterFile] = {}
    for plan, place in sourced:
        if plan.parameters is None and plan.parameters_of not in own:
            raise place.error(f"parameters_of names robot {plan.parameters_of}, which has no parameter file of its own")
        if plan.parameters is None:
            continue
        if plan.parameters not in files:
            files[plan.parameters] = _loaded(plan.parameters, place)
        if plan.kind == "real":
            _check_driver(plan, place, files[plan.parameters].has_velocity_controller)
    return sourced


def _loaded(path: Path, place: Place) -> ParameterFile:
    try:
        file = load_parameters(path)
        file.robot_parameters  # noqa: B018 - raises an error if parameters are missing
    except ParameterFileError as error:
        raise place.error(f"parameters: {error}") from error
    return file


def _check_driver(plan: RobotPlan, place: Place, has_velocity_controller: bool) -> None:
    """Raise ScenarioError unless a real robot that takes duties has a driver, and one that takes speeds has none."""
    if has_velocity_controller and plan.driver is not None:
        raise place.error(
            f"driver: {plan.parameters} describes a robot with a velocity controller, which cmr-driver does not drive. "
            "Leave out driver; for a robot that speaks ROS 2, give ros2, else start the robot's own bridge to the bus"
        )
    if not has_velocity_controller and plan.ros2 is not None:
        raise place.error(
            f"ros2: a robot that speaks ROS 2 takes speeds, and {plan.parameters} describes one that takes duties. "
            "It needs response_time and top_wheel_speed in place of k2_over_k3 and k1"
        )
    if not has_velocity_controller and plan.driver is None:
        raise place.error(
            "driver is missing: a real robot needs the port of its motor controller, driver: {port: /dev/ttyUSB0}. "
            "A robot that takes speeds, by ros2 or through a bridge of its own, has response_time and top_wheel_speed "
            f"in its parameters, in place of k2_over_k3 and k1; {plan.parameters} has not"
        )


def _with_source(robot: Placed, first: int | None, shared: Path | None) -> RobotPlan:
    plan = robot.plan
    if plan.parameters is not None or plan.parameters_of is not None:
        return plan
    if plan.kind == "virtual" and first is not None:
        return replace(plan, parameters_of=first)
    if shared is None:
        raise robot.place.error("has no parameters: name a file, here or for all robots at the top of the scenario")
    return replace(plan, parameters=shared)


def check_team(placed: Sequence[Placed]) -> None:
    """Raise ScenarioError unless every leader is there and no robot leads itself."""
    ids = {plan.robot_id for plan, _ in placed}
    for plan, place in placed:
        leader = plan.behaviour.settings.get(LEADER) if plan.behaviour else None
        if leader is None or leader.startswith("-"):
            continue  # no leader: a formation around its own centre
        if not leader.isdecimal() or int(leader) not in ids:
            raise place.error(f"behaviour: robot {plan.robot_id} has the leader {leader}, which is not there")
        if int(leader) == plan.robot_id:
            raise place.error(f"behaviour: robot {plan.robot_id} cannot be its own leader")


def check_noise(robots: Sequence[RobotPlan], noise: Item | None) -> None:
    """Raise ScenarioError if process noise is requested and a virtual robot's file does not specify it."""
    if noise is None or not noise.flag():
        return
    own = {robot.robot_id: robot.parameters for robot in robots}
    used = {own[robot.robot_id if robot.parameters_of is None else robot.parameters_of] for robot in _virtual(robots)}
    for path in sorted(path for path in used if path is not None):
        provenance = load_parameters(path).provenance
        if provenance.get("method") != "diagnosis" or STRAYED not in provenance:
            raise noise.place.error(
                f"{path} does not say how far robots deviate from their model. Use a file that cmr-diagnose wrote from "
                "a log with poses"
            )


def _virtual(robots: Sequence[RobotPlan]) -> list[RobotPlan]:
    return [robot for robot in robots if robot.kind == "virtual"]


def check_room(
    placed: Sequence[Placed], radius: float, discs: Sequence[Disc], walls: Sequence[Wall], fence: Geofence | None
) -> None:
    """Raise ScenarioError if robots of this radius [m] overlap each other or an obstacle at the start, or start outside
    the fence.

    Only real and emulated robots have to be within the fence.
    """
    standing = [(robot, robot.plan.start) for robot in placed if robot.plan.start is not None]
    _refuse_overlaps(standing, 2.0 * radius)
    for (plan, place), start in standing:
        who = f"start: robot {plan.robot_id} at ({start.x:g}, {start.y:g})"
        for disc in discs:
            if math.dist(start[:2], disc[:2]) < disc.radius + radius:
                raise place.error(f"{who} is in the obstacle at ({disc.x:g}, {disc.y:g})")
        for wall in walls:
            if distance_to(start, wall) < radius:
                raise place.error(f"{who} is in the wall from ({wall.x1:g}, {wall.y1:g})")
        if fence is not None and plan.kind != "virtual" and not fence.contains(start.x, start.y):
            raise place.error(f"{who} is outside the geofence")


def _refuse_overlaps(standing: Sequence[tuple[Placed, Pose]], nearest: float) -> None:
    """Raise ScenarioError if two robots are nearer to one another than `nearest` [m]."""
    cells: defaultdict[tuple[int, int], list[tuple[Placed, Pose]]] = defaultdict(list)
    for robot, start in standing:
        column, row = (math.floor(value / nearest) for value in start[:2])
        around = product((column - 1, column, column + 1), (row - 1, row, row + 1))
        for other, there in (entry for cell in around for entry in cells.get(cell, ())):
            distance = math.dist(start[:2], there[:2])
            if distance < nearest:
                raise _overlap(robot, other, distance, nearest)
        cells[column, row].append((robot, start))


def _overlap(robot: Placed, other: Placed, distance: float, nearest: float) -> DocumentError:
    return robot.place.error(
        f"start: robots {other.plan.robot_id} and {robot.plan.robot_id} are {distance:.3g} m apart, inside one "
        f"another; {nearest:g} m (twice robot_radius) is the least"
    )

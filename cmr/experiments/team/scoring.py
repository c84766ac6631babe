"""Score a team: determine its bonds and goals, and compute the metrics of all paths."""

from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping, Sequence
from inspect import signature

import numpy as np

from cmr.experiments.team import metrics
from cmr.experiments.team.metrics import UNITS, Bond, Floats, Way
from cmr.experiments.team.plan import BehaviourPlan, RobotPlan, Scenario
from cmr.world.behaviours import make_behaviour
from cmr.world.behaviours.formation import NO_LEADER, Formation, places_of


def scores(
    scenario: Scenario,
    robot_ids: Sequence[int],
    time: Floats,
    x: Floats,
    y: Floats,
    chosen: Sequence[str] = tuple(UNITS),
) -> dict[str, float]:
    """Return the metrics of a team by name, in the units of `UNITS`, NaN for undefined ones.

    `time` [s] is of shape (t,), `x` and `y` [m] of shape (t, n), with a column for each of `robot_ids`.
    """
    columns = {robot_id: column for column, robot_id in enumerate(robot_ids)}
    bonds = bonds_of(scenario, columns)
    measures: dict[str, Callable[[], float]] = {
        "formation_error": lambda: metrics.formation_error(x, y, bonds),
        "time_to_goal": lambda: metrics.time_to_goal(time, x, y, ways_of(scenario, columns)),
        "minimum_separation": lambda: metrics.minimum_separation(x, y),
        "path_spread": lambda: metrics.path_spread(x, y, [bond for bond in bonds if bond.follows]),
        "distance_driven": lambda: metrics.distance_driven(x, y),
    }
    return {name: measures[name]() for name in chosen}


def ways_of(scenario: Scenario, columns: Mapping[int, int]) -> dict[int, Way]:
    """Return the waypoints [m] of each robot that has some, by its column."""
    return {columns[robot.robot_id]: robot.waypoints for robot in scenario.robots if robot.waypoints}


def bonds_of(scenario: Scenario, columns: Mapping[int, int]) -> list[Bond]:
    """Return the distances to be kept between robots, by their columns.

    These come from behaviours with the settings `leader` and `gap`, and from places in a formation with a leader.
    """
    found: list[tuple[int, int, float, bool]] = []
    teams: defaultdict[tuple[object, ...], list[int]] = defaultdict(list)
    for robot in scenario.robots:
        plan = robot.behaviour
        if plan is not None:
            found += _following(robot, plan)
            teams[(plan.name, *sorted(plan.settings.items()))].append(robot.robot_id)
    plans = {robot.robot_id: robot.behaviour for robot in scenario.robots}
    for team in teams.values():
        found += _in_formation(sorted(team), plans[team[0]])
    return [
        Bond(columns[robot], columns[leader], distance, follows)
        for robot, leader, distance, follows in found
        if leader in columns and leader != robot
    ]


def _following(robot: RobotPlan, plan: BehaviourPlan) -> Iterator[tuple[int, int, float, bool]]:
    takes = signature(type(make_behaviour(plan.name, plan.settings))).parameters
    if "leader" in takes and "gap" in takes:
        leader, gap = (float(plan.settings.get(key, takes[key].default)) for key in ("leader", "gap"))
        yield robot.robot_id, int(leader), gap, True


def _in_formation(team: Sequence[int], plan: BehaviourPlan | None) -> Iterator[tuple[int, int, float, bool]]:
    """Yield the distance from the leader for the places of robots with one description."""
    made = make_behaviour(plan.name, plan.settings) if plan is not None else None
    if not isinstance(made, Formation) or made.leader == NO_LEADER:
        return
    members = made.members or tuple(team)
    places = places_of(made.shape, made.spacing, len(members), with_leader=True)
    for robot_id, place in zip(members, places, strict=True):
        if robot_id in team:
            yield robot_id, made.leader, float(np.hypot(*place)), False

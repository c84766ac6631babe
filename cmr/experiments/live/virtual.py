"""cmr-sim's part of a scenario: virtual robots, their waypoints, and range sensors."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from cmr.bus.messages import make, now_utime
from cmr.experiments.team.plan import Scenario
from cmr.experiments.team.population import drawn_from
from cmr.geometry.obstacles import Geofence, Obstacles
from cmr.geometry.places import Point
from cmr.model.parameters import RobotParameters
from cmr.msg import waypoints_t
from cmr.world.behaviours import make_behaviours
from cmr.world.world import VirtualRobot

COMMANDED = "commanded"  # the behaviour that does what MOTOR_COMMAND_N says


@dataclass(frozen=True)
class Cast:
    """cmr-sim's part of a scenario.

    Virtual robots and their waypoints; obstacles; their parameters drawn from a population, by robot id; parameter
    files by robot id; the ids of robots with a range sensor; the seed of process noise, None without noise; and the
    delay of virtual robots' decisions [s].
    """

    robots: tuple[VirtualRobot, ...] = ()
    waypoints: tuple[tuple[int, waypoints_t], ...] = ()
    obstacles: Obstacles = field(default_factory=Obstacles.none)
    geofence: Geofence | None = None
    own_parameters: Mapping[int, RobotParameters] = field(default_factory=dict)
    files: Mapping[int, Path] = field(default_factory=dict)
    range_sensors: frozenset[int] = frozenset()
    noise_seed: int | None = None
    reaction: float = 0.0

    def parameter_file(self, robot_id: int, folder: Path) -> Path:
        """Return the parameter file of a robot: the scenario's, otherwise robot_N.yaml in `folder`."""
        return self.files.get(robot_id, folder / f"robot_{robot_id}.yaml")


def cast_of(scenario: Scenario | None) -> Cast:
    """Return cmr-sim's part of a scenario; an empty one without a scenario."""
    if scenario is None:
        return Cast()
    ids = [plan.robot_id for plan in scenario.virtual]
    return Cast(
        tuple(virtual_robots(scenario)),
        tuple(
            (plan.robot_id, waypoints_message(plan.robot_id, plan.waypoints))
            for plan in scenario.virtual
            if plan.waypoints
        ),
        Obstacles(scenario.discs, scenario.walls),
        Geofence(scenario.geofence) if scenario.geofence is not None else None,
        drawn_from(scenario.population, ids, scenario.seed) if scenario.population else {},
        {plan.robot_id: plan.parameters for plan in scenario.robots if plan.parameters is not None},
        frozenset(plan.robot_id for plan in scenario.robots if plan.range_sensor),
        scenario.seed if scenario.process_noise else None,
        scenario.reaction,
    )


def virtual_robots(scenario: Scenario) -> list[VirtualRobot]:
    """Return the virtual robots; those without a behaviour follow MOTOR_COMMAND_N."""
    descriptions = {
        plan.robot_id: (plan.behaviour.name, plan.behaviour.settings) if plan.behaviour else (COMMANDED, {})
        for plan in scenario.virtual
    }
    behaviours = make_behaviours(descriptions)  # those with equal descriptions decide together
    return [
        VirtualRobot(
            plan.robot_id,
            behaviours[plan.robot_id],
            plan.robot_id if plan.parameters_of is None else plan.parameters_of,
            **(plan.start._asdict() if plan.start else {}),
        )
        for plan in scenario.virtual
    ]


def waypoints_message(robot_id: int, points: tuple[Point, ...]) -> waypoints_t:
    """Return the waypoints_t that sends a robot along these points."""
    x, y = ([point[axis] for point in points] for axis in (0, 1))
    return make(waypoints_t, utime=now_utime(), robot_id=robot_id, x=x, y=y)

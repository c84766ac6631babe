"""Make the world of a scenario: its virtual robots, its surroundings, and where robots are to drive."""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence

from cmr.bus.messages import make
from cmr.bus.streams import WAYPOINTS
from cmr.experiments.team.plan import RobotPlan, Scenario
from cmr.geometry.places import Point
from cmr.model.parameters import RobotParameters
from cmr.msg import waypoints_t
from cmr.parameters.following import ParameterFollower
from cmr.world.behaviours import make_behaviours
from cmr.world.process_noise import ProcessNoise
from cmr.world.world import VirtualRobot, World

COMMANDED = "commanded"  # the behaviour that does what MOTOR_COMMAND_N says


def world_of(
    scenario: Scenario,
    virtual: list[VirtualRobot],
    follow: Callable[[int], ParameterFollower],
    *,
    own_parameters: Mapping[int, RobotParameters],
    seed: int,
    ready: Callable[[RobotParameters], bool] = lambda _parameters: True,
    estimates: Callable[[int], bool] = lambda _robot_id: True,
) -> World:
    """Return the world of a scenario, with these virtual robots; the other arguments are those of World.

    `seed` is that of process noise. Raises ObstacleError for an invalid obstacle or geofence.
    """
    noise = ProcessNoise(seed) if scenario.process_noise else None
    world = World(virtual, follow, ready, estimates, own_parameters, scenario.obstacles, noise, scenario.reaction)
    world.view.geofence = scenario.fence
    return world


def virtual_robots(plans: Iterable[RobotPlan]) -> list[VirtualRobot]:
    """Return the virtual robots of these plans; those without a behaviour follow MOTOR_COMMAND_N.

    Raises BehaviourError for an invalid behaviour.
    """
    robots = list(plans)
    behaviours = make_behaviours(  # those with equal descriptions decide together
        {
            plan.robot_id: (plan.behaviour.name, plan.behaviour.settings) if plan.behaviour else (COMMANDED, {})
            for plan in robots
        }
    )
    return [
        VirtualRobot(
            plan.robot_id,
            behaviours[plan.robot_id],
            plan.robot_id if plan.parameters_of is None else plan.parameters_of,
            **(plan.start._asdict() if plan.start else {}),
        )
        for plan in robots
    ]


def waypoints_of(plans: Iterable[RobotPlan], utime: int) -> Iterator[tuple[str, waypoints_t]]:
    """Yield the messages, with their channels, that send robots along their waypoints; `utime` [us] is their stamp."""
    for plan in plans:
        if plan.waypoints:
            yield WAYPOINTS.channel(plan.robot_id), waypoints_message(utime, plan.robot_id, plan.waypoints)


def waypoints_message(utime: int, robot_id: int, points: Sequence[Point]) -> waypoints_t:
    """Return the waypoints_t, stamped `utime` [us], that sends a robot along these points."""
    x, y = zip(*points, strict=True)
    return make(waypoints_t, utime=utime, robot_id=robot_id, x=x, y=y)

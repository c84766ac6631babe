"""cmr-sim: the world. Estimates real robots, simulates virtual ones and twins, and publishes all."""

import argparse
import math
from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from cmr.bus.message import Message
from cmr.bus.messages import make, now_utime
from cmr.bus.preflight import check as check_bus
from cmr.bus.process import Outgoing, Process, Timer
from cmr.bus.streams import (
    COMMAND_CLAIM,
    COMMAND_OWNER,
    ESTOP,
    ESTOP_LATCH,
    GYRO,
    MOTOR_FEEDBACK,
    PARAMETERS,
    POSE,
    PROCESS_STATUS,
    RANGE_SCAN,
    ROBOT_STATE,
    WAYPOINTS,
    WORLD_STATE,
    Stream,
)
from cmr.cli.errors import CommandError
from cmr.commands.first_use import BEHAVIOURS, MODEL, WORLD, compile_first
from cmr.commands.robots import described_robots
from cmr.commands.sim_options import PACKET, command_parser, parse
from cmr.experiments.team.plan import RobotPlan, Scenario
from cmr.experiments.team.world import virtual_robots, waypoints_of, world_of
from cmr.geometry.obstacles import ObstacleError, Obstacles
from cmr.geometry.places import Disc, Wall
from cmr.model.parameters import RobotParameters
from cmr.msg import process_status_t, robot_state_t
from cmr.parameters.file import ParameterFileError
from cmr.parameters.file import load as load_parameters
from cmr.parameters.following import ParameterFollower
from cmr.recordings.arrivals import COMMANDS_OF
from cmr.world.beginning import Beginning
from cmr.world.lateness import Lateness
from cmr.world.loading import Loader
from cmr.world.owners import Owners
from cmr.world.refusals import refusals
from cmr.world.telling import Telling
from cmr.world.view import world_messages
from cmr.world.world import MOST_STRANGERS, VirtualRobot, World

__all__ = ["command_parser", "main"]

if TYPE_CHECKING:
    from cmr.world.scanning import Scanner

HEARD: tuple[Stream[Message], ...] = (
    MOTOR_FEEDBACK,
    GYRO,
    POSE,
    WAYPOINTS,
    PARAMETERS,
    ESTOP,
    ESTOP_LATCH,
    WORLD_STATE,
    COMMAND_CLAIM,
)
STEP_RATE = 100.0  # Hz
MOST_TOLD = 5  # robots named for the same problem
CROWDED = (
    f"More than {MOST_STRANGERS} robots are heard of, and no more are taken in. If some of them are none: --real names "
    "those that are."
)
DEFAULT_PARAMETERS = Path(__file__).parents[1] / "experiments" / "scenario" / "shipped" / "parameters" / "robot_0.yaml"


def main(arguments: list[str]) -> int:
    """Run cmr-sim."""
    options = parse(arguments)
    _require_folder(options.parameters)
    scenario = _scenario(options)
    world, loader, telling = _world(options, scenario)
    scanner = _scanner(options, scenario)
    check_bus(options.lcm_url)
    compile_first([MODEL, WORLD, BEHAVIOURS] if options.virtual or options.scenario else [MODEL, WORLD])
    loader.is_held = False
    publish = Timer(1.0 / options.rate)
    check = Timer(0.25)
    lateness = Lateness()
    reported, owners, beginning = 0, Owners(world.virtual_ids), Beginning(options.begin_with)

    def take(stamp: int, channel: str, message: Message, sender: int | None) -> None:
        beginning.handle(stamp, channel, message)
        if owners.takes(channel, message, sender):
            world.handle(stamp, channel, message)

    with Process("cmr-sim", options.lcm_url) as process:
        _listen(process, world, beginning)
        for utime in process.loop(rate_hz=STEP_RATE):
            world.turn(utime)
            process.dispatch_named(take)
            world.begun = beginning.begun
            world.advance(utime)
            process.overruns = world.late_steps
            # A turn shortly after a late one makes no step; each state is published once.
            if world.utime != reported and publish.due():
                reported = world.utime
                world.remote_robots.sent(reported)
                process.publish_all(_state_messages(world, PACKET if options.split else None))
                process.publish_all(telling.messages(reported))
            process.publish_all(_scans(world, scanner))
            process.publish_all((COMMAND_OWNER, report.robot_id, report) for report in owners.reports())
            if check.due():
                world.poll_parameters()
                _announce(world, loader, process, lateness, owners)
        return process.exit_code


def _require_folder(parameters: Path) -> None:
    if not parameters.is_dir():
        raise CommandError(f"{parameters} is no folder; --parameters names the folder of robot_<id>.yaml files.")


def _scans(world: World, scanner: "Scanner | None") -> list[Outgoing]:
    """Return the range scans that are due."""
    return [(RANGE_SCAN, scan.robot_id, scan) for scan in scanner.scans(world)] if scanner else []


def _listen(process: Process, world: World, beginning: Beginning) -> None:
    """Subscribe to the inputs of the world and its beginning, and report robots without parameters of their own."""
    if not beginning.begun:
        process.subscribe(PROCESS_STATUS, every=True)
    for stream in HEARD:
        process.subscribe(stream, every=True)
    for commands in COMMANDS_OF.values():
        process.subscribe(commands)
    for follower in world.parameters.values():
        if follower.by_default:
            process.news(f"Virtual robots use the shipped parameters. {_missing(follower)}")


def _scenario(options: argparse.Namespace) -> Scenario:
    """Return the scenario of --scenario, or an empty one, with the obstacles and the process noise of the command line.

    Raises CommandError for an invalid scenario or obstacle.
    """
    scenario = _read(options.scenario) if options.scenario else Scenario("cmr-sim", math.inf, ())
    try:
        Obstacles(options.obstacle, options.wall)
    except ObstacleError as error:
        raise CommandError(f"--obstacle, --wall: {error}") from error
    return replace(
        scenario,
        discs=(*(Disc(*numbers) for numbers in options.obstacle), *scenario.discs),
        walls=(*(Wall(*numbers) for numbers in options.wall), *scenario.walls),
        process_noise=scenario.process_noise or options.process_noise is not None,
    )


def _read(path: Path) -> Scenario:
    from cmr.commands.scenarios import load  # imports the code that reads scenarios, rarely needed
    from cmr.experiments.scenario import ScenarioError

    try:
        return load(path, starts_checked=False)
    except ScenarioError as error:
        raise CommandError(str(error)) from error


def _world(options: argparse.Namespace, scenario: Scenario) -> tuple[World, Loader, Telling]:
    """Return the world of the scenario and of --virtual, its model loader, and robots' messages."""
    files = {plan.robot_id: plan.parameters for plan in scenario.robots if plan.parameters is not None}
    population = _population(options)
    virtual = described_robots(options.virtual, _whose_parameters(options, population, files))
    virtual += virtual_robots(scenario.virtual)
    borrowed = {robot.parameters_of for robot in virtual} - files.keys()
    default = load_parameters(DEFAULT_PARAMETERS) if borrowed else None
    loader = Loader(robot.behaviour for robot in virtual)
    loader.is_held = True  # until it is known what is compiled first
    world = world_of(
        scenario,
        virtual,
        lambda robot_id: ParameterFollower(
            robot_id,
            files.get(robot_id, options.parameters / f"robot_{robot_id}.yaml"),
            default if robot_id in borrowed else None,
        ),
        own_parameters=_drawn(population, virtual, options.seed or 0)
        or _drawn(scenario.population, scenario.virtual, scenario.seed),
        seed=scenario.seed if options.process_noise is None else options.process_noise,
        ready=loader.ready,
        estimates=options.real,
    )
    for channel, message in waypoints_of(scenario.virtual, now_utime()):
        world.handle(message.utime, channel, message)
    return world, loader, Telling({robot.robot_id: robot.behaviour for robot in virtual})


def _population(options: argparse.Namespace) -> list[Path]:
    """Return the parameter files of --population; a number refers to a robot's file in --parameters."""
    names = [name.strip() for text in options.population for name in text.split(",")]
    return [options.parameters / f"robot_{name}.yaml" if name.isdecimal() else Path(name) for name in names]


def _whose_parameters(options: argparse.Namespace, population: list[Path], files: dict[int, Path]) -> int:
    """Return whose parameters virtual robots use: as requested, otherwise the first of a population, otherwise 0.

    The first one's file is added to `files`.
    """
    if options.parameters_of is not None or not population:
        return options.parameters_of or 0
    try:
        first = load_parameters(population[0]).robot_id
    except ParameterFileError as error:
        raise CommandError(f"--population: {error}") from error
    files.setdefault(first, population[0])
    return first


def _drawn(
    population: Sequence[Path], virtual: Sequence[VirtualRobot | RobotPlan], seed: int
) -> dict[int, RobotParameters]:
    """Return parameters for each virtual robot, drawn from a population; empty without one."""
    if not population:
        return {}
    from cmr.experiments.team.population import PopulationError, drawn_from

    try:
        return drawn_from(population, [robot.robot_id for robot in virtual], seed)
    except PopulationError as error:
        raise CommandError(f"--population: {error}") from error


def _scanner(options: argparse.Namespace, scenario: Scenario) -> "Scanner | None":
    """Return the range sensors from the command line and the scenario, None without any."""
    given, origins = options.range_sensor or ((), ())
    ids = [*given, *(plan.robot_id for plan in scenario.robots if plan.range_sensor)]
    if not (ids or origins):
        return None
    from cmr.world.scanning import Scanner  # imports Numba, which takes half a second

    return Scanner(ids, origins, options.range_sensor_rays)


def _state_messages(world: World, largest: int | None) -> list[Outgoing]:
    messages: list[Outgoing] = [
        (WORLD_STATE, None, message) for message in world_messages(world.utime, world.everybody(), largest)
    ]
    for robot in world.real():
        message = make(
            robot_state_t, utime=robot.utime, robot_id=robot.robot_id, origin=robot.origin, **robot.state._asdict()
        )
        messages.append((ROBOT_STATE, robot.robot_id, message))
    return messages


def _by_default(world: World, robot_id: int) -> str:
    """Return a sentence if a real robot has no parameters of its own; otherwise empty."""
    follower = world.parameters[robot_id]
    if not follower.by_default:
        return ""
    return f"Robot {robot_id} is simulated by shipped parameters. {_missing(follower)}"


def _missing(follower: ParameterFollower) -> str:
    where = follower.path.absolute() if follower.path else ""
    return f"There is no {where}; cmr init writes one."


def _first(sentences: Iterable[str]) -> list[str]:
    """Shorten a list of sentences about robots."""
    said = [sentence for sentence in sentences if sentence]
    more = len(said) - MOST_TOLD
    return [*said[:MOST_TOLD], f"So it is with {more} more robots."] if more > 1 else said


def _announce(world: World, loader: Loader, process: Process, lateness: Lateness, owners: Owners) -> None:
    """Repeat the parameters in use of all real robots, and report problems with them."""
    for robot_id in world.real_robots:
        announcement = world.parameters[robot_id].announcement()
        if announcement is not None:
            process.repeat(PARAMETERS, announcement, robot_id, period=1.0)
    for news in owners.news():
        process.news(news)
    followers = [world.parameters[robot_id] for robot_id in sorted(world.parameters)]
    process.parameters_sha256 = ",".join(follower.sha256 for follower in followers if follower.sha256)
    reported = [CROWDED] if world.crowded else []
    reported += [*_first(follower.message for follower in followers), loader.message]
    reported += refusals(world, world.gate.now)
    reported += [*world.remote_robots.problems(world.utime), owners.problem()]
    late = lateness.problem(world.utime, world.late_steps)
    reported += ["" if loader.is_starting else late, world.noise_problem]  # compiling makes steps late
    reported += _first(_by_default(world, robot_id) for robot_id in world.real_robots)
    problems = [message for message in reported if message]
    if loader.is_starting:
        process.state = process_status_t.STARTING
    else:
        process.state = process_status_t.DEGRADED if problems else process_status_t.RUNNING
    process.message = " ".join(problems)

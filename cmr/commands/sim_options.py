"""The command line of cmr-sim: robots, parameters, obstacles, and publishing."""

import argparse
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from cmr.cli.command_line import add_begin_with, parse_number, parse_robot_id, parser
from cmr.cli.configuration import parameters
from cmr.commands.robots import numbered
from cmr.world.behaviours.help_text import help_text
from cmr.world.view import REAL, VIRTUAL

if TYPE_CHECKING:
    from cmr.world.interaction.range_sensor import RangeSensor

PACKET = 1400  # bytes; larger packets are fragmented on a real network


def command_parser() -> argparse.ArgumentParser:
    """Return the command line of cmr-sim."""
    options = parser(
        "cmr-sim",
        "Keep the state of the whole world: estimate real robots from their sensors, simulate virtual robots and a "
        "twin of each real robot, and publish all on WORLD_STATE. Real robots are found by their messages.",
        "cmr-sim --virtual 10=figure_eight,x=0.5 --virtual 11=follow,leader=10,x=0.2 --parameters .\n"
        "  cmr-sim --virtual 10=figure_eight --obstacle 1,0.5,0.2 --wall=-2,2,2,2\n"
        "  cmr-sim --virtual 10=figure_eight 11=follow,leader=10,x=-1 --population 0,1,2 --seed 7\n\n"
        "x, y, theta set where a virtual robot starts.\n\n" + help_text(),
    )
    _add_robots(options)
    _add_room(options)
    _add_range_sensors(options)
    options.add_argument(
        "--rate", type=_rate, default=50.0, metavar="HZ", help="how often WORLD_STATE is sent, 20 to 100"
    )
    add_begin_with(options, "simulated robots stand")
    options.add_argument(
        "--split", action="store_true", help=f"split WORLD_STATE into messages of at most {PACKET} bytes"
    )
    return options


def parse(arguments: list[str]) -> argparse.Namespace:
    """Parse the command line."""
    options = command_parser()
    result = options.parse_args(arguments)
    if result.seed is not None and not result.population:
        options.error("--seed is that of --population, which is not given; process noise has its own")
    return result


def _add_robots(options: argparse.ArgumentParser) -> None:
    options.add_argument(
        "--virtual",
        type=numbered,
        nargs="+",
        action="extend",
        default=[],
        metavar="ID=BEHAVIOUR,...",
        help="virtual robots to simulate, each with its number, behaviour, and settings; see below",
    )
    options.add_argument(
        "--scenario", type=Path, metavar="FILE", help="simulate the virtual robots of this cmr-run scenario, too"
    )
    _add_parameters(options)
    options.add_argument(
        "--real",
        type=_real,
        default="all",
        metavar="all|none|ID,...",
        help="the real robots to estimate; of several simulators that share a world, each robot belongs to one",
    )
    options.add_argument(
        "--process-noise",
        type=_seed,
        metavar="SEED",
        help="virtual robots deviate randomly from their model, by as much as the real robot diagnosed by "
        "cmr-diagnose; SEED, a whole number, selects the random numbers",
    )


def _add_parameters(options: argparse.ArgumentParser) -> None:
    """Add the options on parameters of virtual robots."""
    options.add_argument(
        "--parameters", type=Path, default=parameters(), metavar="DIR", help="folder with the files robot_<id>.yaml"
    )
    options.add_argument(
        "--parameters-of",
        type=parse_robot_id,
        metavar="N",
        help="virtual robots use the parameters of this robot, robot_<N>.yaml (default: the first of --population, "
        "otherwise 0)",
    )
    options.add_argument(
        "--population",
        nargs="+",
        action="extend",
        default=[],
        metavar="ID,...|FILE",
        help="draw each virtual robot's parameters from the distribution of several calibrated robots, 0,1,2 or "
        "robot_*.yaml; or of one, from the standard deviations in its file",
    )
    options.add_argument("--seed", type=_seed, metavar="N", help="random seed of --population (default: 0)")


def _add_room(options: argparse.ArgumentParser) -> None:
    options.add_argument(
        "--obstacle",
        type=_numbers,
        action="append",
        default=[],
        metavar="X,Y,RADIUS",
        help="a disc [m] that virtual robots cannot drive through; may be repeated",
    )
    options.add_argument(
        "--wall",
        type=_numbers,
        action="append",
        default=[],
        metavar="X1,Y1,X2,Y2",
        help="a straight wall [m] that virtual robots cannot drive through; may be repeated",
    )


def _add_range_sensors(options: argparse.ArgumentParser) -> None:
    options.add_argument(
        "--range-sensor",
        type=_with_sensor,
        metavar="ID,...|virtual|all",
        help="robots that get a planar range sensor, published on RANGE_SCAN_N at 10 Hz; for a real robot it shows "
        "what its own laser cannot see: virtual robots and obstacles (default: no robot)",
    )
    options.add_argument(
        "--range-sensor-rays",
        type=_rays,
        metavar="FIRST,STEP,COUNT,REACH",
        help="its rays, as those of your robots' lasers: the first ray's angle [rad, 0 ahead], the angle between rays "
        "[rad], how many, how far [m] (default: 360 all around, 5 m)",
    )


def _real(text: str) -> Callable[[int], bool]:
    """Return a predicate for the real robots that this simulator estimates."""
    if text in ("all", "none"):
        return lambda _robot_id: text == "all"
    chosen = {parse_robot_id(number) for number in text.split(",")}
    return lambda robot_id: robot_id in chosen


def _with_sensor(text: str) -> tuple[Sequence[int], Sequence[int]]:
    """Parse the robot ids, and the origins, that get a range sensor."""
    if text in ("virtual", "all"):
        return (), ((VIRTUAL,) if text == "virtual" else (REAL, VIRTUAL))
    return [parse_robot_id(number) for number in text.split(",")], ()


def _rays(text: str) -> "RangeSensor":
    """Parse a range sensor: the first ray's angle, the step [rad], how many rays, their reach [m]."""
    from cmr.world.interaction.range_sensor import RangeSensor

    try:
        first, step, count, reach = text.split(",")
        return RangeSensor(int(count), float(first), float(step), float(reach))
    except ValueError as error:
        raise argparse.ArgumentTypeError(f"{text!r} is not FIRST,STEP,COUNT,REACH: {error}") from error


def _seed(text: str) -> int:
    if not (text.isascii() and text.isdecimal()):
        raise argparse.ArgumentTypeError(f"{text!r} is not a seed: a whole number of 0 or more")
    return int(text)


def _numbers(text: str) -> list[float]:
    """Parse a list of numbers for argparse; their count is checked later."""
    return [float(number) for number in text.split(",")]


def _rate(text: str) -> float:
    return parse_number(text, f"{text!r} is not a rate between 20 and 100 Hz", least=20.0, most=100.0)

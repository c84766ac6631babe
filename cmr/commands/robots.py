"""Descriptions of robots and behaviours on the command line: `10=figure_eight,x=0.5,speed=0.3`."""

import argparse
import sys
from dataclasses import dataclass

from cmr.commands.command_line import CommandError, parse_robot_id
from cmr.world.behaviours import Behaviour, BehaviourError, make_behaviour
from cmr.world.behaviours.behaviour import number_of
from cmr.world.world import VirtualRobot

POSE_KEYS = ("x", "y", "theta")


def behaviour_of(text: str) -> tuple[Behaviour, dict[str, float]]:
    """Return the behaviour that `name,key=value,...` describes, and the start pose among its keys.

    Raises CommandError saying what is wrong.
    """
    if "" not in sys.path:
        sys.path.append("")  # a user's own module:Class lies in the folder where the command is run
    name, *pairs = text.split(",")
    settings = {}
    for pair in pairs:
        key, equals, value = pair.partition("=")
        if not equals:
            raise CommandError(f"{text!r}: {pair!r} is not of the form key=value")
        settings[key.strip()] = value.strip()
    try:
        pose = {key: number_of(key, settings.pop(key)) for key in POSE_KEYS if key in settings}
        return make_behaviour(name.strip(), settings), pose
    except BehaviourError as error:
        raise CommandError(f"{text!r}: {error}") from error


@dataclass(frozen=True)
class _Numbered:
    robot_id: int
    description: str


def numbered(text: str) -> _Numbered:
    """Parse `ID=DESCRIPTION` for argparse."""
    number, equals, description = text.partition("=")
    if not equals:
        raise argparse.ArgumentTypeError(f"{text!r} is not of the form ID=BEHAVIOUR, for example 10=figure_eight")
    return _Numbered(parse_robot_id(number.strip()), description)


def virtual_robots(descriptions: list[_Numbered], parameters_of: int) -> list[VirtualRobot]:
    """Return the virtual robots described on the command line, all moving by the parameters of one robot.

    Raises CommandError for an id that is given twice or a behaviour that does not exist.
    """
    robots: dict[int, VirtualRobot] = {}
    for numbered_robot in descriptions:
        if numbered_robot.robot_id in robots:
            raise CommandError(f"robot {numbered_robot.robot_id} is described twice")
        behaviour, pose = behaviour_of(numbered_robot.description)
        robots[numbered_robot.robot_id] = VirtualRobot(numbered_robot.robot_id, behaviour, parameters_of, **pose)
    return list(robots.values())

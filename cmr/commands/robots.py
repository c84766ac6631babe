"""Descriptions of robots and behaviours on the command line: `10=figure_eight,x=0.5,speed=0.3`."""

import argparse
import sys
from collections.abc import Mapping
from dataclasses import dataclass

from cmr.cli.command_line import parse_robot_id
from cmr.cli.errors import CommandError
from cmr.world.behaviours import AnyBehaviour, BehaviourError, make_behaviours
from cmr.world.behaviours.making import number_of
from cmr.world.world import VirtualRobot

POSE_KEYS = ("x", "y", "theta")


def behaviour_of(text: str) -> tuple[AnyBehaviour, dict[str, float]]:
    """Return the behaviour that `name,key=value,...` describes, and the start pose among its keys.

    Raises CommandError saying what is wrong.
    """
    [(behaviour, pose)] = _behaviours_of({0: text}).values()
    return behaviour, pose


def _behaviours_of(texts: Mapping[int, str]) -> dict[int, tuple[AnyBehaviour, dict[str, float]]]:
    """Return behaviours and start poses by robot id; robots with equal descriptions share a team behaviour."""
    if "" not in sys.path:
        sys.path.append("")  # a user's own module:Class is searched in the working folder
    poses, descriptions = {}, {}
    for robot_id, text in texts.items():
        name, settings = _split(text)
        try:
            poses[robot_id] = {key: number_of(key, settings.pop(key)) for key in POSE_KEYS if key in settings}
            descriptions[robot_id] = (name, settings)
            make_behaviours({robot_id: (name, settings)})
        except BehaviourError as error:
            raise CommandError(f"{text!r}: {error}") from error
    behaviours = make_behaviours(descriptions)
    return {robot_id: (behaviours[robot_id], poses[robot_id]) for robot_id in texts}


def _split(text: str) -> tuple[str, dict[str, str]]:
    name, *pairs = text.split(",")
    settings = {}
    for pair in pairs:
        key, equals, value = pair.partition("=")
        if not equals:
            raise CommandError(f"{text!r}: {pair!r} is not of the form key=value")
        settings[key.strip()] = value.strip()
    return name.strip(), settings


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


def described_robots(descriptions: list[_Numbered], parameters_of: int) -> list[VirtualRobot]:
    """Return the virtual robots described on the command line, all moving by the parameters of one robot.

    Raises CommandError for an id that is given twice or a behaviour that does not exist.
    """
    texts: dict[int, str] = {}
    for numbered_robot in descriptions:
        if numbered_robot.robot_id in texts:
            raise CommandError(f"robot {numbered_robot.robot_id} is described twice")
        texts[numbered_robot.robot_id] = numbered_robot.description
    return [
        VirtualRobot(robot_id, behaviour, parameters_of, **pose)
        for robot_id, (behaviour, pose) in _behaviours_of(texts).items()
    ]

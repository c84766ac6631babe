"""cmr-pilot: drive a real robot by a behaviour, for example after a virtual leader."""

import argparse
from pathlib import Path

from cmr.cli.command_line import add_begin_with, add_robot, parser
from cmr.cli.configuration import parameter_file
from cmr.cli.errors import CommandError
from cmr.commands.first_use import BEHAVIOURS, WORLD, compile_first
from cmr.commands.robots import behaviour_of
from cmr.commands.steering.steer import add_fence, add_limits, steer
from cmr.parameters.following import ParameterFollower
from cmr.world.behaviours.help_text import help_text
from cmr.world.pilot import Pilot


def main(arguments: list[str]) -> int:
    """Run cmr-pilot."""
    options = command_parser().parse_args(arguments)
    behaviour, pose = behaviour_of(options.behaviour)
    if pose:
        raise CommandError("A real robot starts where it stands: x, y and theta are for virtual robots.")
    pilot = Pilot(
        options.robot,
        behaviour,
        ParameterFollower(options.robot, options.parameters or parameter_file(options.robot)),
        geofence=options.geofence,
        margin=options.margin,
        keep_clear=options.keep_clear,
        kind=options.command,
    )
    compile_first([WORLD, BEHAVIOURS])
    return steer(pilot, behaviour, options, begin_with=options.begin_with)


def command_parser() -> argparse.ArgumentParser:
    """Return the command line of cmr-pilot."""
    options = parser(
        "cmr-pilot",
        "Drive a real robot by a behaviour: it sees the world on WORLD_STATE and commands the motors on "
        "MOTOR_COMMAND_N, or (v, omega) on VELOCITY_COMMAND_N if the robot's parameters have a velocity controller. It "
        "stops whenever cmr-sim, the robot, its parameters or poses that came before are missing, and on ESTOP. It "
        "ends when a manoeuvre is over. A robot that left its geofence stands until it is put back inside and "
        "cmr-pilot is started again. Parameters that change duties by more than 30 % while it moves are used when "
        "it rests, or on SIGUSR1.",
        "cmr-pilot --robot 0 --behaviour follow,leader=10,gap=0.5\n"
        "  cmr-pilot --robot 0 --behaviour manoeuvre,name=steps,speed=0.8\n"
        "  cmr-pilot --robot 0 --geofence=-2,-1,2,-1,2,1,-2,1 --margin 0.3\n\n" + help_text(),
    )
    add_robot(options)
    options.add_argument("--behaviour", default="follow", metavar="NAME,KEY=VALUE,...", help="see below")
    options.add_argument(
        "--parameters", type=Path, default=None, metavar="FILE", help="parameter file; otherwise robot_N.yaml"
    )
    add_begin_with(options, "the robot stands")
    add_limits(options)
    add_fence(options)
    return options

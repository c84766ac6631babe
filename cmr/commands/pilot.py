"""cmr-pilot: drive a real robot by a behaviour, for example after a virtual leader."""

import argparse
from pathlib import Path

from cmr.bus.claiming import Claim
from cmr.bus.messages import now_utime
from cmr.bus.process import Process
from cmr.bus.streams import (
    COMMAND_CLAIM,
    COMMAND_OWNER,
    ESTOP,
    ESTOP_LATCH,
    MOTOR_FEEDBACK,
    PARAMETERS,
    POSE,
    WAYPOINTS,
    WORLD_STATE,
)
from cmr.cli.command_line import add_robot, parser
from cmr.cli.configuration import parameter_file
from cmr.cli.errors import CommandError
from cmr.commands.robots import behaviour_of
from cmr.geometry.obstacles import FURTHEST, Geofence
from cmr.model.command_kinds import KINDS
from cmr.msg import process_status_t
from cmr.parameters.following import ParameterFollower
from cmr.recordings.arrivals import COMMANDS_OF
from cmr.world.behaviours.help_text import help_text
from cmr.world.guarding import MARGIN
from cmr.world.pilot import Pilot

RATE = 50.0  # Hz


def main(arguments: list[str]) -> int:
    """Run cmr-pilot."""
    options = command_parser().parse_args(arguments)
    behaviour, pose = behaviour_of(options.behaviour)
    if pose:
        raise CommandError("A real robot starts where it stands: x, y and theta are for virtual robots.")
    path = options.parameters or parameter_file(options.robot)
    pilot = Pilot(
        options.robot,
        behaviour,
        ParameterFollower(options.robot, path),
        geofence=options.geofence,
        margin=options.margin,
        keep_clear=options.keep_clear,
        kind=options.command,
    )
    pilot.prepare()
    with Process("cmr-pilot", options.lcm_url) as process:
        process.subscribe(WORLD_STATE, every=True)
        process.subscribe(ESTOP, every=True)
        process.subscribe(ESTOP_LATCH, options.robot)
        process.subscribe(MOTOR_FEEDBACK, options.robot, every=True)
        process.subscribe(POSE, options.robot, every=True)
        process.subscribe(PARAMETERS, options.robot)
        process.subscribe(WAYPOINTS, options.robot)
        process.subscribe(COMMAND_OWNER, options.robot)
        claim = Claim("cmr-pilot", options.robot, lambda: process.bus.sender, options.take_over)
        for utime in process.loop(rate_hz=RATE):
            for received in process.received():
                for handle in (pilot.handle, claim.handle):
                    handle(received.message.utime, received.channel, received.message)
            pilot.parameters.poll()
            process.parameters_sha256 = pilot.parameters.sha256
            if claim.lost_to:
                raise CommandError(f"{claim.lost_to} took over robot {options.robot}.")
            _command(process, pilot, claim, utime)
            if behaviour.finished:
                break
        if not claim.others(now_utime()):
            process.publish(COMMANDS_OF[pilot.kind], pilot.stop(), options.robot)
            process.publish(COMMAND_CLAIM, claim.end(now_utime()), options.robot)
        if behaviour.problem:
            raise CommandError(behaviour.problem)
        return process.exit_code


def _command(process: Process, pilot: Pilot, claim: Claim, utime: int) -> None:
    """Command the robot, unless somebody else does, and have the next PROCESS_STATUS say how it is."""
    claimed = claim.message(utime)
    if claimed is not None:
        process.publish(COMMAND_CLAIM, claimed, pilot.robot_id)
    if others := claim.others(utime):
        waiting_for = f"the end of {others}, which commands robot {pilot.robot_id}; --take-over does not wait"
    else:
        process.publish(COMMANDS_OF[pilot.kind], pilot.command(utime), pilot.robot_id)
        waiting_for = pilot.waiting_for
    process.state = process_status_t.DEGRADED if waiting_for else process_status_t.RUNNING
    process.message = pilot.left_fence or (f"Waiting for {waiting_for}." if waiting_for else pilot.parameters.message)


def command_parser() -> argparse.ArgumentParser:
    """Return the command line of cmr-pilot."""
    options = parser(
        "cmr-pilot",
        "Drive a real robot by a behaviour: it sees the world on WORLD_STATE and commands the motors on "
        "MOTOR_COMMAND_N, or (v, omega) on VELOCITY_COMMAND_N if the robot's parameters have a velocity controller. It "
        "stops whenever cmr-sim, the robot, its parameters or poses that came before are missing, and on ESTOP. It "
        "ends when a manoeuvre is over. A robot that left its geofence stands until it is put back inside and "
        "cmr-pilot is started again.",
        "cmr-pilot --robot 0 --behaviour follow,leader=10,gap=0.5\n"
        "  cmr-pilot --robot 0 --behaviour manoeuvre,name=steps,speed=0.8\n"
        "  cmr-pilot --robot 0 --geofence=-2,-1,2,-1,2,1,-2,1 --margin 0.3\n\n" + help_text(),
    )
    add_robot(options)
    options.add_argument("--behaviour", default="follow", metavar="NAME,KEY=VALUE,...", help="see below")
    options.add_argument(
        "--parameters", type=Path, default=None, metavar="FILE", help="parameter file; otherwise robot_N.yaml"
    )
    options.add_argument(
        "--command",
        choices=KINDS,
        default=None,
        help="what to send: duties on MOTOR_COMMAND_N, wheel speeds on WHEEL_SPEED_COMMAND_N, or velocities on "
        "VELOCITY_COMMAND_N; by default what the robot's parameters ask for",
    )
    options.add_argument(
        "--take-over",
        action="store_true",
        help="command the robot although another process does, which then ends; otherwise wait until it does",
    )
    options.add_argument(
        "--geofence",
        type=_geofence,
        default=None,
        metavar="X1,Y1,X2,Y2,...",
        help="corners [m; world frame] of the polygon that the robot must not leave; needs poses (POSE_N)",
    )
    options.add_argument("--margin", type=_margin, default=MARGIN, metavar="M", help="from its border, in m")
    options.add_argument(
        "--no-keep-clear",
        dest="keep_clear",
        action="store_false",
        help="do not stop before robots in the way, real and virtual ones",
    )
    return options


def _geofence(text: str) -> Geofence:
    try:
        numbers = [float(number) for number in text.split(",")]
        if len(numbers) % 2:
            raise ValueError("it has an x without a y")
        return Geofence(zip(numbers[::2], numbers[1::2], strict=True))
    except ValueError as error:
        raise argparse.ArgumentTypeError(
            f"{text!r} is no geofence: {error}. An example: --geofence=-2,-1,2,-1,2,1,-2,1"
        ) from error


def _margin(text: str) -> float:
    try:
        margin = float(text)
    except ValueError:
        margin = -1.0
    if not 0.0 <= margin <= FURTHEST:
        raise argparse.ArgumentTypeError(f"{text!r} is not a distance of 0 m or more")
    return margin

"""Steer a real robot by a behaviour, as a process on the bus; used by cmr-pilot and cmr-investigate."""

import argparse
import os
import signal
from collections.abc import Callable
from threading import Event

from cmr.bus.claiming import Claim
from cmr.bus.message import Message
from cmr.bus.messages import Received, now_utime
from cmr.bus.process import Process
from cmr.bus.streams import (
    COMMAND_CLAIM,
    COMMAND_OWNER,
    ESTOP,
    ESTOP_LATCH,
    GYRO,
    INVESTIGATION_STATUS,
    MOTOR_FEEDBACK,
    PARAMETERS,
    POSE,
    PROCESS_STATUS,
    WAYPOINTS,
    WORLD_STATE,
)
from cmr.cli.command_line import parse_number
from cmr.cli.errors import CommandError
from cmr.geometry.obstacles import FURTHEST, Geofence
from cmr.model.command_kinds import KINDS
from cmr.msg import process_status_t
from cmr.recordings.arrivals import COMMANDS_OF
from cmr.world.beginning import Beginning
from cmr.world.behaviours import AnyBehaviour
from cmr.world.guarding import MARGIN
from cmr.world.pilot import Pilot

RATE = 50.0  # Hz
CONFIRMING = "To use them at once, on this computer: kill -USR1 {pid}"


def steer(
    pilot: Pilot,
    behaviour: AnyBehaviour,
    options: argparse.Namespace,
    *,
    program: str = "cmr-pilot",
    begin_with: str = "",
    hear: Callable[[Received], None] = lambda _received: None,
    tell: Callable[[], str] = lambda: "",
) -> int:
    """Steer a robot until its behaviour is finished; return the exit code of the process, named `program`.

    `options` are those of `add_limits` and of a bus. With `begin_with` the robot stands until that program is ready.
    Received messages also go to `hear`, and the text from `tell` is the status if there is no other. Raises
    CommandError if another process took over, or the behaviour ended with a problem.
    """
    pilot.prepare()
    confirmed = Event()
    signal.signal(signal.SIGUSR1, lambda _number, _frame: confirmed.set())
    with Process(program, options.lcm_url) as process:
        claim = Claim(program, pilot.robot_id, lambda: process.bus.sender, options.take_over)
        beginning = Beginning(begin_with)
        _listen(process, pilot.robot_id, beginning)
        for utime in process.loop(rate_hz=RATE):
            pilot.turn(utime)
            for received in process.received():
                hear(received)
                _hand_over(received, pilot.handle, claim.handle, beginning.handle)
            pilot.begun = beginning.begun
            pilot.parameters.poll()
            _confirm(pilot, confirmed)
            waiting_for = _command(process, pilot, claim, utime)
            process.publish_all((stream, pilot.robot_id, message) for stream, message in pilot.tell(utime))
            _report(process, pilot, waiting_for, tell())
            if behaviour.finished:
                break
        _end(process, pilot, claim)
        if behaviour.problem:
            raise CommandError(behaviour.problem)
        return process.exit_code


def _hand_over(received: Received, *handlers: Callable[[int, str, Message], object]) -> None:
    """Pass a message to all its handlers."""
    for handle in handlers:
        handle(received.message.utime, received.channel, received.message)


def _listen(process: Process, robot: int, beginning: Beginning) -> None:
    """Subscribe to the inputs of the pilot, its claim, and its beginning."""
    if not beginning.begun:
        process.subscribe(PROCESS_STATUS, every=True)
    process.subscribe(WORLD_STATE, every=True)
    process.subscribe(ESTOP, every=True)
    process.subscribe(ESTOP_LATCH, robot)
    process.subscribe(MOTOR_FEEDBACK, robot, every=True)
    process.subscribe(GYRO, robot, every=True)
    process.subscribe(POSE, robot, every=True)
    process.subscribe(PARAMETERS, robot)
    process.subscribe(WAYPOINTS, robot)
    process.subscribe(COMMAND_OWNER, robot)
    process.subscribe(INVESTIGATION_STATUS, robot, every=True)  # its own, for recorders of received messages


def _confirm(pilot: Pilot, confirmed: Event) -> None:
    """Use the waiting parameters, once a person has confirmed them."""
    if confirmed.is_set():
        confirmed.clear()
        pilot.confirm_parameters()


def _end(process: Process, pilot: Pilot, claim: Claim) -> None:
    """Stop and release the robot, unless another process commands it."""
    if not claim.others(now_utime()):
        process.publish(COMMANDS_OF[pilot.kind], pilot.stop(), pilot.robot_id)
        process.publish(COMMAND_CLAIM, claim.end(now_utime()), pilot.robot_id)


def _command(process: Process, pilot: Pilot, claim: Claim, utime: int) -> str:
    """Command the robot, unless another process does; return what it waits for.

    Raises CommandError if another process took over.
    """
    if claim.lost_to:
        raise CommandError(f"{claim.lost_to} took over robot {pilot.robot_id}.")
    claimed = claim.message(utime)
    if claimed is not None:
        process.publish(COMMAND_CLAIM, claimed, pilot.robot_id)
    if others := claim.others(utime):
        return f"the end of {others}, which commands robot {pilot.robot_id}; --take-over does not wait"
    process.publish(COMMANDS_OF[pilot.kind], pilot.command(utime), pilot.robot_id)
    return pilot.waiting_for


def _report(process: Process, pilot: Pilot, waiting_for: str, told: str) -> None:
    """Report the parameters in use, what the robot waits for, refusals, waiting parameters, and `told`."""
    process.parameters_sha256 = pilot.parameters_sha256
    new = f"{pilot.new_parameters} {CONFIRMING.format(pid=os.getpid())}" if pilot.new_parameters else ""
    waiting = f"Waiting for {waiting_for}." if waiting_for else pilot.parameters.message
    sentences = [pilot.left_fence or waiting, pilot.gate.problem(), new]
    is_in_doubt = waiting_for or any(sentences[1:])
    process.state = process_status_t.DEGRADED if is_in_doubt else process_status_t.RUNNING
    process.message = " ".join(filter(None, [*sentences, told]))


def add_fence(options: argparse.ArgumentParser) -> None:
    """Add the polygon that the robot must not leave."""
    options.add_argument(
        "--geofence",
        type=geofence,
        default=None,
        metavar="X1,Y1,X2,Y2,...",
        help="corners [m; world frame] of the polygon that the robot must not leave; needs poses (POSE_N)",
    )
    options.add_argument(
        "--margin", type=margin, default=MARGIN, metavar="M", help="distance to keep from its border, in m"
    )


def add_limits(options: argparse.ArgumentParser) -> None:
    """Add options on the kind of command, the claim, and collision avoidance."""
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
        help="take the robot over from another process that commands it, which then ends; otherwise wait for it to end",
    )
    options.add_argument(
        "--no-keep-clear",
        dest="keep_clear",
        action="store_false",
        help="do not stop before other robots, real or virtual",
    )


def geofence(text: str) -> Geofence:
    """Parse a geofence.

    Raises argparse.ArgumentTypeError if it is invalid.
    """
    try:
        numbers = [float(number) for number in text.split(",")]
        if len(numbers) % 2:
            raise ValueError("it has an x without a y")
        return Geofence(zip(numbers[::2], numbers[1::2], strict=True))
    except ValueError as error:
        raise argparse.ArgumentTypeError(
            f"{text!r} is no geofence: {error}. An example: --geofence=-2,-1,2,-1,2,1,-2,1"
        ) from error


def margin(text: str) -> float:
    """Parse a distance [m].

    Raises argparse.ArgumentTypeError if it is invalid.
    """
    return parse_number(text, f"{text!r} is not a distance of 0 m or more", least=0.0, most=FURTHEST)

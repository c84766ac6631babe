"""cmr-teleop: drive a real or a virtual robot by keyboard, by gamepad, or from a page of cmr-view."""

import argparse
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

from cmr.bus.claiming import Claim
from cmr.bus.message import Message
from cmr.bus.messages import now_utime
from cmr.bus.preflight import check as check_bus
from cmr.bus.process import Process
from cmr.bus.streams import (
    COMMAND_OWNER,
    ESTOP,
    ESTOP_LATCH,
    MOTOR_FEEDBACK,
    PARAMETERS,
    POSE,
    WORLD_STATE,
    Stream,
)
from cmr.cli.command_line import add_robot, parse_number, parse_robot_id, parser
from cmr.cli.configuration import parameter_file
from cmr.cli.errors import CommandError
from cmr.commands.first_use import BEHAVIOURS, WORLD, compile_first
from cmr.commands.steering.steer import add_fence, add_limits
from cmr.msg import process_status_t
from cmr.parameters.file import ParameterFileError, load
from cmr.parameters.following import ParameterFollower
from cmr.teleop.by_hand import SPEED, TURN_RATE, ByHand
from cmr.teleop.drive import Drive
from cmr.teleop.gamepad import Gamepad
from cmr.teleop.hands import END
from cmr.teleop.pads import PadFile
from cmr.teleop.recorder import Recorder
from cmr.teleop.scripted import Scripted, Step, steps
from cmr.teleop.seats import BareSeat, PageSeat, Seat, TerminalSeat, has_terminal
from cmr.teleop.terminal import Terminal
from cmr.world.pilot import Pilot

RATE = 50.0  # Hz
NAME = "cmr-teleop"
ANY = "any"  # the first gamepad found
FASTEST, FASTEST_TURN = 5.0, 20.0  # m/s, rad/s
HEARD: tuple[Stream[Message], ...] = (ESTOP_LATCH, MOTOR_FEEDBACK, POSE, COMMAND_OWNER)


def main(arguments: list[str]) -> int:
    """Run cmr-teleop."""
    options = command_parser().parse_args(arguments)
    check_bus(options.lcm_url)
    if not (options.page or options.script or options.gamepad or has_terminal()):
        Terminal()  # which reports what is missing
    drive = _drive(options)
    compile_first([WORLD, BEHAVIOURS])
    drive.pilot.prepare()
    with Process(NAME, options.lcm_url) as process:
        drive.claim = Claim(NAME, options.robot, lambda: process.bus.sender, options.take_over)
        _subscribe(process, options)
        with _seat(options) as seat:
            try:
                _run(process, drive, seat, options.seconds)
            finally:
                process.publish_all(drive.end(now_utime()))
        if drive.recorder is not None:
            print(_recorded(drive, drive.recorder), flush=True)
        return process.exit_code


def _run(process: Process, drive: Drive, seat: Seat, seconds: float | None) -> None:
    """Drive until the person, a signal, the time or another process ends it."""
    began = time.monotonic()
    for utime in process.loop(rate_hz=RATE):
        drive.pilot.turn(utime)
        for received in process.received():
            drive.handle(received.message.utime, received.channel, received.message)
        drive.pilot.parameters.poll()
        now = time.monotonic()
        seat.look(now, not drive.waiting_for)
        requests = seat.requests()
        for request in requests:
            drive.request(utime, request)
        process.publish_all(drive.turn(utime, seat.hands(now), seat.problem(now)))
        seat.show(drive, utime, now)
        _report(process, drive)
        if drive.claim.lost_to:
            raise CommandError(f"{drive.claim.lost_to} took over robot {drive.pilot.robot_id}.")
        if END in requests or seat.is_over(now) or (seconds is not None and now - began >= seconds):
            return


def _subscribe(process: Process, options: argparse.Namespace) -> None:
    process.subscribe(WORLD_STATE, every=True)
    process.subscribe(ESTOP, every=True)
    for stream in HEARD:
        process.subscribe(stream, options.robot)
    process.subscribe(PARAMETERS, _whose(options))


@contextmanager
def _seat(options: argparse.Namespace) -> Iterator[Seat]:
    """Return the input device; at the end the terminal is restored."""
    with ExitStack() as stack:
        pad = None
        if options.gamepad:
            file = PadFile(None if options.gamepad == ANY else Path(options.gamepad))
            stack.callback(file.close)
            pad = Gamepad(file)
        if options.page:
            yield PageSeat()
        elif options.script:
            yield BareSeat(Scripted(options.script))
        elif pad is not None and not has_terminal():
            yield BareSeat(pad)
        else:
            yield TerminalSeat(stack.enter_context(Terminal()), pad)


def _drive(options: argparse.Namespace) -> Drive:
    """Return the requested drive; its claim has no process name yet."""
    hand = ByHand(options.speed, options.turn_rate)
    whose = _whose(options)
    pilot = Pilot(
        options.robot,
        hand,
        ParameterFollower(whose, options.parameters or parameter_file(whose)),
        geofence=options.geofence,
        margin=options.margin,
        keep_clear=options.keep_clear,
        kind=options.command,
        program=NAME,
    )
    recorder = Recorder(options.record) if options.record else None
    return Drive(pilot, hand, Claim(NAME, options.robot, lambda: 0), recorder, _of_virtual)


def _of_virtual() -> ParameterFollower:
    """Return the parameters that cmr-sim uses for virtual robots by default."""
    from cmr.commands.sim import DEFAULT_PARAMETERS  # imports the simulator, which is rarely needed

    return ParameterFollower(0, parameter_file(0), load(DEFAULT_PARAMETERS))


def _whose(options: argparse.Namespace) -> int:
    """Return the parameters to use for the robot."""
    if options.parameters_of is not None:
        return int(options.parameters_of)
    if options.parameters is None:
        return int(options.robot)
    try:
        return load(options.parameters).robot_id
    except ParameterFileError as error:
        raise CommandError(str(error)) from error


def _recorded(drive: Drive, recorder: Recorder) -> str:
    try:
        return recorder.finish(drive.pilot.robot_id, drive.pilot.model)
    except OSError as error:
        raise CommandError(f"{recorder.path}: cannot be written: {error.strerror}") from error


def _report(process: Process, drive: Drive) -> None:
    """Report what the robot waits for, and refused messages; resting hands are no problem."""
    pilot = drive.pilot
    waiting = pilot.waiting_for and f"Waiting for {pilot.waiting_for}."
    sentences = [pilot.left_fence or waiting or pilot.parameters.message, pilot.gate.problem()]
    process.parameters_sha256 = pilot.parameters_sha256
    process.state = process_status_t.DEGRADED if waiting or any(sentences) else process_status_t.RUNNING
    process.message = " ".join(filter(None, sentences))


def command_parser() -> argparse.ArgumentParser:
    """Return the command line of cmr-teleop."""
    options = parser(
        NAME,
        "Drive a real or a virtual robot by hand: with the keys of this terminal, also over ssh, or with a gamepad "
        "(--gamepad). A page of cmr-view has a joystick for phones. A virtual robot needs the behaviour commanded. "
        "If a key is released, or the device or page is disconnected or silent, the robot is commanded zero within "
        "0.2 s. Space or Esc engages the emergency stop. It goes through the same limits as cmr-pilot, which then "
        "waits.",
        "cmr-teleop --robot 0\n"
        "  cmr-teleop --robot 0 --gamepad --geofence=-2,-1,2,-1,2,1,-2,1\n"
        "  cmr-teleop --robot 10 --parameters robot_0.yaml --record drive.yaml\n"
        "  cmr-pilot --robot 0 --behaviour manoeuvre,name=drive.yaml",
    )
    add_robot(options)
    _add_leading(options)
    options.add_argument(
        "--parameters", type=Path, default=None, metavar="FILE", help="parameter file; otherwise robot_N.yaml"
    )
    options.add_argument(
        "--parameters-of", type=parse_robot_id, metavar="N", help="use the parameters of this robot; otherwise its own"
    )
    add_limits(options)
    add_fence(options)
    return options


def _add_leading(options: argparse.ArgumentParser) -> None:
    """Add options on the input device, speed and duration."""
    options.add_argument(
        "--gamepad",
        nargs="?",
        const=ANY,
        default=None,
        metavar="DEVICE",
        help="drive with a gamepad: the first that is found, or that of this event device",
    )
    options.add_argument("--speed", type=_up_to(FASTEST), default=SPEED, metavar="M/S", help="with a key held")
    options.add_argument(
        "--turn-rate", type=_up_to(FASTEST_TURN), default=TURN_RATE, metavar="RAD/S", help="with a key held"
    )
    options.add_argument("--record", type=Path, metavar="FILE", help="write the drive as a manoeuvre (.yaml)")
    options.add_argument("--seconds", type=_up_to(1e6), metavar="S", help="end after this time [s]")
    options.add_argument(
        "--script",
        type=_script,
        metavar="STEPS",
        help="drive without a person, in steps as 'ahead 3, left 1, rest 1' (words: ahead, back, left, right, "
        "ahead-left, ahead-right, rest; s), then end",
    )
    options.add_argument("--page", action="store_true", help="for cmr-view: a joystick on standard input, as JSON")


def _up_to(most: float) -> Callable[[str], float]:
    """Return a parser for numbers above 0 up to `most`."""

    def read(text: str) -> float:
        return parse_number(text, f"{text!r} is not a number above 0, {most:g} at most", above=0.0, most=most)

    return read


def _script(text: str) -> list[Step]:
    try:
        return steps(text)
    except ValueError as error:
        raise argparse.ArgumentTypeError(str(error)) from error

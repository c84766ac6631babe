"""cmr-driver: the process that connects one real robot to the bus."""

import argparse
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from cmr.bus.process import Process
from cmr.bus.streams import ESTOP, MOTOR_COMMAND, PARAMETERS
from cmr.commands.command_line import CommandError, add_robot, parser
from cmr.msg import process_status_t
from robot_driver.battery import Thresholds
from robot_driver.controllers import CONTROLLERS
from robot_driver.driver import BOARD, Driver, Settings
from robot_driver.encoders import Wiring
from robot_driver.gyros import GYROS
from robot_driver.listing import Rates, describe
from robot_driver.ramp import Limits
from robot_driver.serial_port import PortLost, available_ports

SLOWEST_RATE = 5.0  # Hz; slower, one lost packet is silence enough for the watchdog of 0.5 s in a controller
LOOP_RATE = 200.0  # Hz; a measurement waits 5 ms at most before it is published, and is stamped when it was made

DESCRIPTION = """Drive a real robot: MOTOR_COMMAND_N in; MOTOR_FEEDBACK_N and GYRO_N out.

The motors stop when no command has come for 0.5 s, when ESTOP is engaged, and when this process ends. If this
computer fails, the motor controller stops them by itself after 0.5 s, an MBot board after 1 s."""
EXAMPLE = "cmr-driver --port /dev/serial/by-id/usb-Basicmicro_RoboClaw-if00 --gyro-port /dev/ttyUSB0 --robot 0"


def main(arguments: list[str]) -> int:
    """Run cmr-driver; return its exit code.

    Raises CommandError when a port cannot be opened, BusError when there is no bus.
    """
    options = _options(arguments)
    if options.list_devices:
        paths = [path for path in (options.port, options.gyro_port) if path]
        return _list_devices(paths, Rates(options.baud, options.gyro_baud))
    try:
        with Process("cmr-driver", options.lcm_url) as process, _said(process, _settings(options)) as driver:
            if driver.warnings:
                print(f"cmr-driver: {driver.warnings}", file=sys.stderr, flush=True)
            process.subscribe(MOTOR_COMMAND, options.robot, every=True)
            process.subscribe(ESTOP, every=True)
            process.subscribe(PARAMETERS, options.robot)
            for _ in process.loop(LOOP_RATE):
                driver.turn()
                process.dispatch(driver.handle)
                process.publish_all(list(driver.outgoing()))
                for news in driver.news():
                    process.news(news)
                _report(process, driver)
            return process.exit_code
    except PortLost as lost:
        raise CommandError(str(lost)) from lost


@contextmanager
def _said(process: Process, settings: Settings) -> Iterator[Driver]:
    """Have the process say at its end what became of the motors."""
    driver = Driver(settings)
    with driver:
        yield driver
    process.farewell = driver.farewell


def _list_devices(paths: list[str], rates: Rates) -> int:
    """Print what answers at these ports, or at all there are; return 1 if one that was named was not asked."""
    ports = paths or available_ports()
    exit_code = 0
    for port in ports:
        try:
            print(describe(port, rates), flush=True)
        except PortLost as lost:
            print(f"{port}\n    not asked: {lost}", flush=True)
            exit_code = 1 if paths else 0
    if not ports:
        print("There are no serial ports. Plug the devices in; on a laptop, install the driver of the USB adapter.")
    return exit_code


def _report(process: Process, driver: Driver) -> None:
    """Have the next PROCESS_STATUS say how the driver is; when something was lost or came back, at once."""
    problems = driver.problems()
    before, process.state = process.state, process_status_t.DEGRADED if problems else process_status_t.RUNNING
    process.problem = problems
    process.message = " ".join(text for text in (problems, driver.remarks()) if text)
    process.parameters_sha256 = driver.follower.sha256
    if process.state != before:
        process.publish_status()


def _settings(options: argparse.Namespace) -> Settings:
    return Settings(
        port=options.port,
        gyro_port=options.gyro_port,
        robot=options.robot,
        controller=options.controller,
        gyro=options.gyro,
        baud=options.baud,
        gyro_baud=options.gyro_baud,
        rate=options.rate,
        ticks_per_turn=options.ticks_per_turn,
        wiring=Wiring(options.swap, options.invert_left, options.invert_right),
        limits=options.limits,
        thresholds=options.thresholds,
        invert_gyro=options.invert_gyro,
        parameters=options.parameters,
    )


def command_parser() -> argparse.ArgumentParser:
    """Return the command line of cmr-driver."""
    result = parser("cmr-driver", DESCRIPTION, EXAMPLE)
    add = result.add_argument
    add(
        "--list-devices",
        action="store_true",
        help="show serial ports and what answers there, at --baud or the rates usual for each kind; nothing moves; "
        "takes at most 10 s a port",
    )
    add("--port", metavar="DEVICE", help="serial port of the motor controller")
    add("--gyro-port", metavar="DEVICE", help="serial port of the gyro, if it has one of its own")
    add_robot(result)
    add("--controller", choices=sorted(CONTROLLERS), default="roboclaw", help="kind of motor controller")
    add("--gyro", choices=[BOARD, *sorted(GYROS)], help=f"kind; else {BOARD}, or dsp3000 if it has a port of its own")
    add("--baud", type=_positive, metavar="RATE", help="of the motor controller, if not what its kind has by default")
    add(
        "--gyro-baud",
        type=_positive,
        metavar="RATE",
        help="of the gyro's own port, if not what its kind has by default",
    )
    add("--rate", type=_positive_number, default=100.0, metavar="HZ", help="how often the motors are served")
    add("--acceleration", type=_positive_number, default=10.0, metavar="DUTY/S", help="how fast duty may grow")
    add("--deceleration", type=_positive_number, metavar="DUTY/S", help="how fast it may shrink; else twice that")
    add("--battery-warn", type=_positive_number, default=0.0, metavar="VOLT", help="warn when the battery is below")
    add("--battery-stop", type=_positive_number, default=0.0, metavar="VOLT", help="below, stop until restarted")
    add("--ticks-per-turn", type=_positive, default=2048, metavar="TICKS", help="encoder counts per turn of a wheel")
    add("--swap", action="store_true", help="the controller's first channel is the right side, not the left")
    add("--invert-left", action="store_true", help="motor and encoder of the left side are mounted backwards")
    add("--invert-right", action="store_true", help="motor and encoder of the right side are mounted backwards")
    add("--invert-gyro", action="store_true", help="the gyro is mounted upside down")
    add("--parameters", type=Path, metavar="FILE", help="parameter file of the robot; followed while it changes")
    return result


def _options(arguments: list[str]) -> argparse.Namespace:
    result = command_parser()
    options = result.parse_args(arguments)
    if options.port is None and not options.list_devices:
        result.error("--port is needed: --list-devices shows which there are")
    if options.rate < SLOWEST_RATE:
        result.error(
            f"--rate {options.rate:g} is too slow: the controller stops the motors when it hears nothing for 0.5 s. "
            f"Choose {SLOWEST_RATE:g} Hz or more."
        )
    if options.gyro_baud and options.gyro_port is None:
        result.error("--gyro-baud is for a gyro on a port of its own: --gyro-port")
    if options.gyro == BOARD and (options.gyro_port or CONTROLLERS[options.controller].gyro is None):
        result.error(f"--gyro {BOARD} is for a controller with a gyro on its board, on the port of the controller")
    try:
        options.limits = Limits(options.acceleration, options.deceleration or 2.0 * options.acceleration)
        options.thresholds = Thresholds(options.battery_warn, options.battery_stop)
    except ValueError as error:
        result.error(str(error))
    return options


def _positive(text: str) -> int:
    value = int(text)
    if value <= 0:
        raise argparse.ArgumentTypeError(f"{value} must be greater than 0")
    return value


def _positive_number(text: str) -> float:
    value = float(text)
    if not 0.0 < value < float("inf"):
        raise argparse.ArgumentTypeError(f"{value} must be greater than 0")
    return value

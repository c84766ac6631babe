"""cmr-driver: the process that connects one real robot to the bus."""

import argparse
import sys
from collections.abc import Iterator
from contextlib import contextmanager

from cmr.bus.process import Process
from cmr.bus.streams import COMMAND_CLAIM, COMMAND_OWNER, ESTOP, ESTOP_LATCH, MOTOR_COMMAND, PARAMETERS
from cmr.cli.command_line import add_robot, parser
from cmr.cli.errors import CommandError
from cmr.cli.options import add_options, made_of
from cmr.msg import process_status_t
from robot_driver.driver import Driver
from robot_driver.listing import Rates, describe
from robot_driver.serial_port import PortLost, available_ports
from robot_driver.settings import Settings, add_settings, parsed_with_settings
from robot_driver.stop_file import StopFile, state_folder

LOOP_RATE = 200.0  # Hz; a measurement is published within 5 ms, with the time at which it was made

DESCRIPTION = """Drive a real robot: MOTOR_COMMAND_N in; MOTOR_FEEDBACK_N and GYRO_N out.

The motors stop when no command has come for 0.5 s, when ESTOP is engaged, and when this process ends, hangs or is
killed: a second, small process that it starts, the last gate, alone writes to their port. If this
computer fails, the motor controller stops them by itself after 0.5 s, an MBot board after 1 s.

ESTOP holds over restarts, also of the computer, until it is released (cmr estop release). It is kept in the folder
--state: by default that of systemd's StateDirectory=, otherwise ~/.local/state/cmr."""
EXAMPLE = "cmr-driver --port /dev/serial/by-id/usb-Basicmicro_RoboClaw-if00 --gyro-port /dev/ttyUSB0 --robot 0"


def main(arguments: list[str]) -> int:
    """Run cmr-driver; return its exit code.

    Raises CommandError if a port cannot be opened, BusError if there is no bus.
    """
    options, settings = _options(arguments)
    if settings is None:
        paths = [path for path in (options.port, options.gyro_port) if path]
        return _list_devices(paths, Rates(options.baud, options.gyro_baud))
    try:
        with Process("cmr-driver", options.lcm_url) as process, _said(process, settings) as driver:
            if driver.warnings:
                print(f"cmr-driver: {driver.warnings}", file=sys.stderr, flush=True)
            process.subscribe(MOTOR_COMMAND, options.robot, every=True)
            process.subscribe(COMMAND_CLAIM, options.robot, every=True)
            process.subscribe(ESTOP, every=True)
            process.subscribe(PARAMETERS, options.robot)
            process.remarks = driver.remarks
            for _ in process.loop(LOOP_RATE):
                driver.turn()
                process.dispatch_named(driver.handle)
                process.publish_all(list(driver.outgoing()))
                process.publish_all((COMMAND_OWNER, options.robot, report) for report in driver.owner_reports())
                process.publish_all((ESTOP_LATCH, options.robot, report) for report in driver.stop_reports())
                for news in driver.news():
                    process.news(news)
                _report(process, driver)
            return process.exit_code
    except PortLost as lost:
        raise CommandError(str(lost)) from lost


@contextmanager
def _said(process: Process, settings: Settings) -> Iterator[Driver]:
    """Make the process report at its end what became of the motors."""
    stop_file = StopFile(settings.state or state_folder(), settings.robot, process.bus.url)
    driver = Driver(settings, stop_file=stop_file)
    with driver:
        yield driver
    process.farewell = driver.farewell


def _list_devices(paths: list[str], rates: Rates) -> int:
    """Print the devices at these ports, or at all; return 1 if a named one could not be checked."""
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
    """Update the next PROCESS_STATUS with the driver's state; publish at once when something was lost or came back."""
    problems = driver.problems()
    before, process.state = process.state, process_status_t.DEGRADED if problems else process_status_t.RUNNING
    process.message = problems
    process.parameters_sha256 = driver.follower.sha256
    if process.state != before:
        process.publish_status()


def command_parser() -> argparse.ArgumentParser:
    """Return the command line of cmr-driver."""
    result = parser("cmr-driver", DESCRIPTION, EXAMPLE)
    result.add_argument(
        "--list-devices",
        action="store_true",
        help="show serial ports and what answers there, at --baud or the rates usual for each kind; nothing moves; "
        "takes at most 10 s a port",
    )
    add_settings(result)
    add_robot(result)
    add_options(result, Settings)
    return result


def _options(arguments: list[str]) -> tuple[argparse.Namespace, Settings | None]:
    """Return the parsed options and the robot's settings, None if devices are to be listed."""
    result = command_parser()
    options = parsed_with_settings(result, arguments)
    if options.list_devices:
        return options, None
    if options.port is None:
        result.error("--port is needed: --list-devices shows which there are")
    try:
        return options, made_of(Settings, options)
    except ValueError as error:
        result.error(str(error))

"""cmr bringup: the process of the procedure, with its terminal and bus."""

import argparse
from contextlib import AbstractContextManager, nullcontext
from pathlib import Path

from cmr.bus.process import EXIT_INTERRUPTED, Outgoing, Process
from cmr.bus.streams import ESTOP, POSE, identify
from cmr.cli.command_line import add_robot, parser
from cmr.cli.errors import CommandError
from cmr.msg import estop_t, pose_xyt_t
from robot_driver.bringup.bench import Drivable, World
from robot_driver.bringup.known import load
from robot_driver.bringup.procedure import STEPS, Place, Procedure
from robot_driver.driver import Driver
from robot_driver.guided import Front, Kind, Left, Remote, Step, Terminal
from robot_driver.host import THIS_COMPUTER
from robot_driver.serial_port import available_ports
from robot_driver.settings import Settings
from robot_driver.stop_file import StopFile, state_folder

RATE = 200.0  # Hz
DESCRIPTION = """Bring up a new robot, step by step: find its devices, see which motor turns which wheel, have wheels
and robot turned by hand, and drive 0.75 m on the floor to compare the poses with the wheels.

Before the floor, no motor gets more than 10 % of full drive, for 1 s; where nothing turns, up to 20 % after your yes.
Each motion is announced, and any key ends it, as do an emergency stop (cmr estop stop) and whatever stops a driver.
Stop cmr-driver first: it holds the ports.

Steps: devices, motors, ticks, stop, battery, gyro, floor; by default all of them, in this order. What cannot be decided
is asked, or left open with the reason; nothing is guessed. Run one step again by its name.

It writes robot_N_driver.yaml, for cmr-driver --settings, and after the floor robot_N.yaml, the parameter file."""
EXAMPLE = "cmr bringup --ports /dev/serial/by-id/*\n  cmr bringup gyro\n  cmr driver --settings robot_0_driver.yaml"


class Interrupted(Exception):  # noqa: N818 - somebody wants it
    """A signal was received."""


class QuietProcess(Process):
    """A process that leaves the terminal to the procedure."""

    def news(self, text: str) -> None:
        """Print nothing."""


class BusWorld(World):
    """The bus around the driver: it forwards emergency stops, measurements, and the poses of all robots."""

    def __init__(self, process: Process) -> None:
        super().__init__()
        self._process = process
        self._turns = process.loop(RATE)
        process.subscribe(ESTOP, every=True)
        process.subscribe(POSE, every=True)

    def turn(self, driver: Drivable | None) -> None:
        """Wait for the next cycle, and process messages. Raises Interrupted."""
        if next(self._turns, None) is None:
            raise Interrupted
        for received in self._process.received():
            message = received.message
            if isinstance(message, estop_t) and driver is not None:
                driver.handle(message.utime, received.channel, message, received.sender)
            elif isinstance(message, pose_xyt_t):
                known = identify(received.channel)
                self.see(known[1] or 0 if known else 0, (message.utime, message.x, message.y, message.theta))

    def publish(self, message: Outgoing) -> None:
        """Publish a measurement of the driver."""
        stream, robot_id, content = message
        self._process.publish(stream, content, robot_id)


def main(arguments: list[str]) -> int:
    """Run cmr bringup; return its exit code: 1 if a step is left open.

    Raises CommandError if a file cannot be used, BusError if there is no bus.
    """
    options = _options(arguments)
    settings = options.folder / f"robot_{options.robot}_driver.yaml"
    parameters = options.folder / f"robot_{options.robot}.yaml"
    known = load(settings)
    if not options.folder.is_dir():
        raise CommandError(f"There is no folder {options.folder}.")
    try:
        with QuietProcess("cmr-bringup", options.lcm_url) as process, _front(options.page) as front:
            world = BusWorld(process)
            stop_file = StopFile(state_folder(), options.robot, process.bus.url)
            ports = options.ports or available_ports()

            def driver(settings: Settings) -> Driver:
                return Driver(settings, stop_file=stop_file)

            place = Place(THIS_COMPUTER, world, lambda: ports, driver)
            procedure = Procedure(front, place, options.robot, known, settings, parameters)
            results = procedure.run(options.steps or STEPS)
            open_steps = [result.step for result in results if not result.decided]
            front.show(Step("end", Kind.NOTE, _closing(options.robot, settings, parameters, open_steps)))
    except Interrupted:
        return EXIT_INTERRUPTED
    except Left as left:
        raise CommandError(str(left)) from left
    return 1 if open_steps else 0


def _front(is_page: bool) -> AbstractContextManager[Front]:
    return nullcontext(Remote()) if is_page else Terminal()


def _closing(robot: int, settings: Path, parameters: Path, open_steps: list[str]) -> str:
    """Return the names of the written files, and the next step."""
    written = f"Written: {settings}" + (f" and {parameters}" if parameters.exists() else "")
    if open_steps:
        return f"{written}\nLeft open: {', '.join(open_steps)}. Run again: cmr bringup {' '.join(open_steps)}"
    return f"{written}\nNext: cmr driver --robot {robot} --settings {settings} --parameters {parameters}"


def command_parser() -> argparse.ArgumentParser:
    """Return the command line of cmr bringup."""
    result = parser("cmr bringup", DESCRIPTION, EXAMPLE)
    result.add_argument("steps", nargs="*", metavar="STEP", help=f"one of {', '.join(STEPS)}")
    add_robot(result)
    result.add_argument("--ports", nargs="+", metavar="DEVICE", help="only these serial ports (default: all)")
    result.add_argument(
        "--page", action="store_true", help="ask on the page of cmr-view, which starts bring-up with this option"
    )
    result.add_argument(
        "--folder",
        type=Path,
        default=Path(),
        metavar="DIR",
        help="where the files are written (default: here)",
    )
    return result


def _options(arguments: list[str]) -> argparse.Namespace:
    parser = command_parser()
    options = parser.parse_args(arguments)
    unknown = [step for step in options.steps if step not in STEPS]
    if unknown:
        parser.error(f"there is no step {unknown[0]!r}; there are {', '.join(STEPS)}")
    options.steps = [step for step in STEPS if step in options.steps]
    return options

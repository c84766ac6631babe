"""cmr accept: prove the driver's promises on your own hardware, and write a report that can be attached to a paper."""

import argparse
import tempfile
import time
from importlib import import_module
from pathlib import Path
from typing import Protocol

from cmr.cli.command_line import add_robot, check_writable, parse_number, parser
from cmr.cli.errors import CommandError
from cmr.cli.options import add_options, made_of
from cmr.distribution import has_module
from robot_driver.acceptance.bench import Setup
from robot_driver.acceptance.findings import PROMISES
from robot_driver.acceptance.protocol import run_protocol
from robot_driver.acceptance.report import Report
from robot_driver.acceptance.running import LONG, SHORT
from robot_driver.guided import Guide, Terminal, no_or_yes
from robot_driver.serial_port import PortLost
from robot_driver.settings import Connection, Settings, add_settings, parsed_with_settings

LARGEST_DUTY = 0.2
PAGE = "robot_driver.acceptance.page"  # not in the driver's package for robots
DESCRIPTION = """Prove what cmr-driver promises on your own hardware: half an hour, or two minutes with --short.

Lift the wheels off the floor. The program starts the driver on your ports through a filter, degrades the line, kills
processes, and asks you to pull the USB cable and to switch the battery off. The wheels turn at 10 % duty. Any key ends
everything, and so does ESTOP.

The report says for each promise whether it held, with figures: DIR/acceptance.json, and DIR/acceptance.html where CMR
is installed with pages."""
EXAMPLE = (
    "cmr accept --settings robot_0_driver.yaml\n"
    "  cmr accept --port /dev/serial/by-id/usb-Basicmicro_RoboClaw-if00 --out acceptance\n"
    "  cmr accept --port /dev/ttyACM0 --short --promise 6 --promise 18"
)
LIFTED = (
    "The wheels will turn repeatedly, both ways, and go on turning for a second in tests of the device's own stop. "
    "Are they off the floor, and is nothing in their way? Keep a hand at the robot's switch."
)


class _Page(Protocol):
    def page(self, report: Report) -> str: ...


def main(arguments: list[str]) -> int:
    """Run the protocol; return 0 if all tested promises held, else 1.

    Raises CommandError if it is ended, or a port cannot be used.
    """
    options, settings = _options(arguments)
    check_writable(options.out)
    with tempfile.TemporaryDirectory(prefix="cmr-accept-") as folder, Terminal() as terminal:
        setup = Setup(settings, Path(folder), options.lcm_url, options.duty)
        asked = Guide(terminal, time.sleep)
        if asked.ask("lifted", LIFTED, no_or_yes("yes, begin", "no, end here")) != "yes":
            raise CommandError("Nothing was tested. Lift the robot so that its wheels turn freely, then begin again.")
        try:
            report = run_protocol(
                setup,
                lambda wait: Guide(terminal, wait),
                pace=SHORT if options.short else LONG,
                wanted=options.promise or tuple(PROMISES),
                hands=not options.no_hands,
            )
        except PortLost as lost:
            raise CommandError(str(lost)) from lost
    print("\n".join(report.lines()))
    for path in write(report, options.out):
        print(f"written: {path}")
    if report.failed:
        raise CommandError(f"Promises that did not hold: {', '.join(map(str, report.failed))}. The report says why.")
    return 0


def write(report: Report, folder: Path) -> list[Path]:
    """Write the report into a folder; return its files."""
    folder.mkdir(parents=True, exist_ok=True)
    written = folder / "acceptance.json"
    written.write_text(report.to_json(), encoding="utf-8")
    if not has_module(PAGE):
        return [written]
    maker: _Page = import_module(PAGE)
    html = folder / "acceptance.html"
    html.write_text(maker.page(report), encoding="utf-8")
    return [written, html]


def command_parser() -> argparse.ArgumentParser:
    """Return the command line of cmr accept."""
    result = parser("cmr accept", DESCRIPTION, EXAMPLE)
    add_settings(result)
    add_robot(result)
    add_options(result, Connection)
    result.add_argument("--out", type=Path, default=Path("acceptance"), metavar="DIR", help="folder for the report")
    result.add_argument("--short", action="store_true", help="two minutes instead of half an hour; it shows less")
    result.add_argument(
        "--promise",
        type=_promise,
        action="append",
        metavar="N",
        help="test only this promise, by its number; may be repeated",
    )
    result.add_argument(
        "--duty",
        type=_duty,
        default=0.1,
        metavar="DUTY",
        help=f"with which the wheels turn, {LARGEST_DUTY:g} at most; more than the default where they do not turn",
    )
    result.add_argument("--no-hands", action="store_true", help="skip tests that need a person's hands")
    return result


def _promise(text: str) -> int:
    if not text.isdecimal() or int(text) not in PROMISES:
        raise argparse.ArgumentTypeError(f"a promise is a number of 1 to {len(PROMISES)}, not {text!r}")
    return int(text)


def _duty(text: str) -> float:
    otherwise = f"a duty is a number of 0.01 to {LARGEST_DUTY:g}, not {text!r}"
    return parse_number(text, otherwise, least=0.01, most=LARGEST_DUTY)


def _options(arguments: list[str]) -> tuple[argparse.Namespace, Settings]:
    """Return the parsed options, and the robot's settings."""
    result = command_parser()
    options = parsed_with_settings(result, arguments)
    if options.port is None:
        result.error("--port is needed (or --settings, which has it): cmr-driver --list-devices shows which there are")
    try:
        connection = made_of(Connection, options)
    except ValueError as error:
        result.error(str(error))
    return options, Settings(**vars(connection), robot=options.robot)

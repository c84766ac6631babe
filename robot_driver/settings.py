"""Hardware of a robot and its ports: the options of cmr-driver, and `driver:` in a scenario."""

import argparse
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Annotated, Any, NamedTuple

from cmr.cli.errors import CommandError
from cmr.documents.bounds import Bounds
from cmr.documents.declared import Between, Option, Word
from cmr.documents.document import DocumentError, Item, read_file
from cmr.model.duty_ramp import Limits
from robot_driver.battery import Thresholds
from robot_driver.controllers import CONTROLLERS
from robot_driver.encoders import Wiring
from robot_driver.gyros import GYROS

BOARD = "board"  # name of the gyro that some controllers have on their board, and say on their port
SLOWEST_RATE = 5.0  # Hz; slower, a single lost packet triggers a controller's watchdog of 0.5 s
LARGEST = 1e4  # Hz, duty per second, V; beyond the range of any device
GYRO_HELP = f"gyro type (default: dsp3000 with --gyro-port, otherwise the one on the controller {BOARD})"
LARGEST_FILE = 65_536  # bytes
BY_DEFAULT = "if not what its kind has by default"

Count = Annotated[int, Between(1, 10_000_000)]
Acceleration = Annotated[float, Between(1e-3, LARGEST)]
Rate = Annotated[float, Between(SLOWEST_RATE, LARGEST)]
Voltage = Annotated[float, Between(0.0, LARGEST)]
ControllerName = Annotated[str, Word(lambda: sorted(CONTROLLERS))]
GyroName = Annotated[str, Word(lambda: [BOARD, *sorted(GYROS)])]


@dataclass(frozen=True)
class Connection:
    """Connections of a robot.

    Raises ValueError for contradictory options, named as on the command line.
    """

    port: Annotated[str, Option("serial port of the motor controller", "DEVICE")]
    gyro_port: Annotated[str | None, Option("serial port of the gyro, if it has one of its own", "DEVICE")] = None
    controller: Annotated[ControllerName, Option("kind of motor controller")] = "roboclaw"
    gyro: Annotated[GyroName | None, Option(GYRO_HELP)] = None
    baud: Annotated[Count | None, Option(f"of the motor controller, {BY_DEFAULT}", "RATE")] = None
    gyro_baud: Annotated[Count | None, Option(f"of the gyro's own port, {BY_DEFAULT}", "RATE")] = None
    rate: Annotated[Rate, Option("how often the motors are served", "HZ")] = 100.0
    acceleration: Annotated[Acceleration, Option("how fast duty may grow", "DUTY/S")] = 10.0
    deceleration: Annotated[Acceleration | None, Option("how fast it may shrink; else twice that", "DUTY/S")] = None
    battery_warn: Annotated[Voltage, Option("warn below this voltage (default: off)", "VOLT")] = 0.0
    battery_stop: Annotated[Voltage, Option("below this voltage, stop until restarted (default: off)", "VOLT")] = 0.0
    ticks_per_turn: Annotated[Count, Option("encoder counts per turn of a wheel", "TICKS")] = 2048
    swap: Annotated[bool, Option("the controller's first channel is the right side, not the left")] = False
    invert_left: Annotated[bool, Option("motor and encoder of the left side are mounted backwards")] = False
    invert_right: Annotated[bool, Option("motor and encoder of the right side are mounted backwards")] = False
    swap_encoders: Annotated[bool, Option("each channel counts the wheel that the other one drives")] = False
    invert_left_encoder: Annotated[bool, Option("the left encoder counts against its motor")] = False
    invert_right_encoder: Annotated[bool, Option("the right encoder counts against its motor")] = False
    invert_gyro: Annotated[bool, Option("the gyro is mounted upside down")] = False

    def __post_init__(self) -> None:
        if self.rate < SLOWEST_RATE:
            raise ValueError(
                f"--rate {self.rate:g} is too slow: the controller stops the motors when it hears nothing for 0.5 s. "
                f"Choose {SLOWEST_RATE:g} Hz or more."
            )
        if self.gyro_baud and self.gyro_port is None:
            raise ValueError("--gyro-baud is for a gyro on a port of its own: --gyro-port")
        if self.gyro == BOARD and (self.gyro_port or CONTROLLERS[self.controller].gyro is None):
            raise ValueError(
                f"--gyro {BOARD} is for a controller with a gyro on its board, on the port of the controller"
            )
        self.limits  # noqa: B018 - raises ValueError if invalid
        self.thresholds  # noqa: B018

    @property
    def wiring(self) -> Wiring:
        """How motors and encoders are mounted."""
        encoders = self.swap_encoders, self.invert_left_encoder, self.invert_right_encoder
        return Wiring(self.swap, self.invert_left, self.invert_right, *encoders)

    @property
    def limits(self) -> Limits:
        """Ramps of the duty."""
        return Limits(self.acceleration, self.deceleration or 2.0 * self.acceleration)

    @property
    def thresholds(self) -> Thresholds:
        """The voltages of the battery below which to warn and to stop."""
        return Thresholds(self.battery_warn, self.battery_stop)


@dataclass(frozen=True)
class Settings(Connection):
    """Connections of a robot, its id, its parameter file, and the folder of its emergency stop."""

    robot: int = 0
    parameters: Annotated[Path | None, Option("parameter file of the robot; followed while it changes", "FILE")] = None
    state: Annotated[Path | None, Option("folder in which an engaged emergency stop is kept", "DIR")] = None


class SettingsFileError(DocumentError):
    """A settings file cannot be used; the text names file, line and key."""

    not_yaml = "cannot be read"
    empty = "is empty; cmr bringup writes it"
    bounds = Bounds(size=LARGEST_FILE)


class Content(NamedTuple):
    """The content of a settings file: options of cmr-driver and findings of cmr bringup by name, undecided steps."""

    driver: dict[str, Any]
    undecided: list[str]
    found: dict[str, Any]


def content_of(path: Path) -> Content:
    """Return the content of a settings file written by cmr bringup.

    Raises CommandError naming file, line and key.
    """
    try:
        return _content_of(read_file(path, SettingsFileError))
    except SettingsFileError as error:
        if isinstance(error.__cause__, FileNotFoundError):
            raise CommandError(f"There is no {path}. cmr bringup writes it.") from None
        raise CommandError(str(error)) from error


def _content_of(document: Item) -> Content:
    parts = dict(document.entries())
    for part in Content._fields:
        if part not in parts:
            raise document.place.error(f"{part} is missing; a file of cmr bringup has {', '.join(Content._fields)}")
    driver = dict(parts["driver"].entries())
    known = {field.name for field in fields(Connection)}
    for name, item in driver.items():
        if name not in known:
            raise item.place.error(f"the driver has no setting {name!r}")
    return Content(
        {name: item.value for name, item in driver.items()},
        [step.text() for step in parts["undecided"].items()],
        {name: item.value for name, item in parts["found"].entries()},
    )


def add_settings(parser: argparse.ArgumentParser) -> None:
    """Add an option to read the options of cmr-driver from a file."""
    parser.add_argument(
        "--settings",
        type=Path,
        metavar="FILE",
        help="options as cmr bringup has written them; others given here count instead",
    )


def parsed_with_settings(parser: argparse.ArgumentParser, arguments: list[str]) -> argparse.Namespace:
    """Parse arguments, with the options of the settings file if one is named. Raises CommandError."""
    options = parser.parse_args(arguments)
    return options if options.settings is None else parser.parse_args([*options_in(options.settings), *arguments])


def options_in(path: Path) -> list[str]:
    """Return the options of cmr-driver in a settings file.

    Raises CommandError, also for a file that bring-up has not completed, as defaults may be wrong for the rest.
    """
    driver, undecided, _ = content_of(path)
    if undecided:
        raise CommandError(f"{path} is not complete: cmr bringup has still to decide {', '.join(undecided)}.")
    options = []
    for name, value in driver.items():
        option = f"--{name.replace('_', '-')}"
        if value is True:
            options.append(option)
        elif value is not None and value is not False:
            options += [option, str(value)]
    return options

"""cmr init: ask five questions about a robot, and write the files it needs to run."""

import argparse
import sys
from dataclasses import dataclass
from pathlib import Path
from textwrap import dedent

from cmr.cli.command_line import add_robot, parse_number, parse_robot_id, parser
from cmr.cli.errors import CommandError
from cmr.cli.system_files import USB_IDS, command_line, driver_unit, udev_rule, unit
from cmr.files import write_atomically
from cmr.parameters.file import ParameterFile, ParameterFileError, Value
from cmr.processes.children import our_command
from robot_driver.controllers import CONTROLLERS
from robot_driver.gyros import GYROS
from robot_driver.serial_port import available_ports

NO_GYRO = "none"
GYRO_CHOICES = (NO_GYRO, *sorted(GYROS))
FIRST_GUESS = {"k2_over_k3": 80.0, "k1": 0.065}  # until cmr-calibrate has estimated the robot's own


@dataclass(frozen=True)
class Answers:
    """The answers about a robot: id, connection, wheel radius and base width [m]."""

    robot: int
    controller: str
    gyro: str
    wheel_radius: float
    base_width: float

    @property
    def port(self) -> str:
        """The name that the udev rule gives to the motor controller's port."""
        return f"/dev/cmr-motor-{self.robot}"

    @property
    def gyro_port(self) -> str:
        """The name that the udev rule gives to the gyro's port."""
        return f"/dev/cmr-gyro-{self.robot}"


def main(arguments: list[str]) -> int:
    """Run cmr init."""
    options = command_parser().parse_args(arguments)
    answers = _answers(options, asking=sys.stdin.isatty() and not options.yes)
    try:
        files = contents(answers, options.out.absolute())
    except ParameterFileError as error:
        raise CommandError(str(error)) from error
    _refuse_to_replace(options, list(files))
    try:
        for name, text in files.items():
            write_atomically(text, options.out / name)
    except OSError as error:
        raise CommandError(f"{options.out}: cannot be written: {error.strerror}. Choose another with --out.") from error
    print("\n".join(f"written: {options.out / name}" for name in files))
    print(_next_steps(answers, options.out))
    return 0


def command_parser() -> argparse.ArgumentParser:
    """Return the command line of cmr init."""
    options = parser(
        "cmr init",
        "Ask five questions about a robot, each with a default, and write its parameter file, a udev rule that gives "
        "its ports names of their own, systemd units and a scenario for cmr-run. Questions answered by options are "
        "skipped; without a terminal nothing is asked.",
        "cmr init\n  cmr init --robot 2 --controller roboteq --wheel-radius 0.05 --yes --out robots",
        bus="not used: this command needs no bus",
    )
    add_robot(options)
    options.set_defaults(robot=None)
    options.add_argument(
        "--controller", choices=sorted(CONTROLLERS), help="kind of motor controller (default: roboclaw)"
    )
    options.add_argument("--gyro", choices=GYRO_CHOICES, help=f"gyro on a port of its own (default: {NO_GYRO})")
    options.add_argument("--wheel-radius", type=_metres, metavar="M", help="in m; must be right (default: 0.04)")
    options.add_argument("--base-width", type=_metres, metavar="M", help="in m; a first guess (default: 0.2)")
    options.add_argument(
        "--yes", action="store_true", help="ask nothing: use defaults for everything not given as an option"
    )
    options.add_argument("--force", action="store_true", help="replace existing files")
    options.add_argument("--out", type=Path, default=Path(), metavar="DIR", help="folder for the files")
    return options


def contents(answers: Answers, folder: Path) -> dict[str, str]:
    """Return the text of each file by name; units and scenario refer to `folder`."""
    parameters = {"wheel_radius": answers.wheel_radius, "base_width": answers.base_width, **FIRST_GUESS}
    file = ParameterFile(answers.robot, {name: Value(value) for name, value in parameters.items()})
    number = answers.robot
    return {
        f"robot_{number}.yaml": file.to_yaml(),
        "60-cmr.rules": _udev_rules(answers),
        f"cmr-driver-{number}.service": driver_unit(str(number), command_line(_driver_command(answers, folder))),
        "cmr-sim.service": unit(
            "simulator", command_line([our_command("cmr-sim"), "--parameters", str(folder)]), "LimitRTPRIO=1"
        ),
        f"robot_{number}_scenario.yaml": _scenario(answers),
    }


def _udev_rules(answers: Answers) -> str:
    rules = [f"# Ports of robot {answers.robot}. To find the ids of others: udevadm info -a /dev/ttyACM0"]
    rules.append(udev_rule(f"cmr-motor-{answers.robot}", USB_IDS.get(answers.controller)))
    if answers.gyro != NO_GYRO:
        rules.append(udev_rule(f"cmr-gyro-{answers.robot}", None))
    return "\n".join(rules) + "\n"


def _driver_command(answers: Answers, folder: Path) -> list[str]:
    command = [our_command("cmr-driver"), "--robot", str(answers.robot), "--controller", answers.controller]
    command += ["--port", answers.port]
    if answers.gyro != NO_GYRO:
        command += ["--gyro", answers.gyro, "--gyro-port", answers.gyro_port]
    return [*command, "--parameters", str(folder / f"robot_{answers.robot}.yaml")]


def _scenario(answers: Answers) -> str:
    number = answers.robot
    leader, follower = (10, 11) if number not in (10, 11) else (20, 21)
    gyro = "" if answers.gyro == NO_GYRO else f", gyro: {answers.gyro}, gyro_port: {answers.gyro_port}"
    return dedent(f"""\
        # Robot {number} follows a virtual leader through figure-eights, and a virtual robot follows it.
        # To try it without the robot: kind: emulated, and no driver.
        about: Robot {number} between a virtual leader and a virtual follower
        duration: 60 # s
        parameters: robot_{number}.yaml

        robots:
          - id: {leader}
            kind: virtual
            behaviour: figure_eight,laps=0,speed=0.3
            start: [0.5, 0.0]
            waypoints: [[0.5, 0.0], [1.5, 0.0], [1.8, 0.5], [1.5, 1.0], [0.5, 1.0], [0.0, 0.5], [0.5, 0.0]]
          - id: {number}
            kind: real
            driver: {{port: {answers.port}, controller: {answers.controller}{gyro}}}
            start: [0.0, 0.0]
            behaviour: follow,leader={leader},gap=0.5
          - id: {follower}
            kind: virtual
            start: [-0.5, 0.0]
            behaviour: follow,leader={number},gap=0.5
        """)


def _answers(options: argparse.Namespace, asking: bool) -> Answers:
    """Return the answers from options and, if allowed, from the user."""
    found = ", ".join(available_ports())
    if asking:
        print(f"Serial ports: {found or 'none are plugged in'}. Press Enter for the default in brackets.")

    def answer(name: str, question: str, default: str, parse: object) -> str:
        given = getattr(options, name)
        if given is not None:
            return str(given)
        return _ask(question, default, parse) if asking else default

    return Answers(
        int(answer("robot", "Number of the robot", "0", parse_robot_id)),
        answer("controller", f"Motor controller: {', '.join(sorted(CONTROLLERS))}", "roboclaw", CONTROLLERS),
        answer("gyro", f"Gyro on a port of its own: {', '.join(GYRO_CHOICES)}", NO_GYRO, GYRO_CHOICES),
        float(answer("wheel_radius", "Wheel radius in m, which must be right", "0.04", _metres)),
        float(answer("base_width", "Base width in m, a first guess", "0.2", _metres)),
    )


def _ask(question: str, default: str, parse: object) -> str:
    """Ask until the answer is valid; `parse` is a function that raises, or the allowed choices."""
    while True:
        try:
            text = input(f"{question} [{default}]: ").strip() or default
        except EOFError:
            raise CommandError("The questions were not answered. Without a terminal, use --yes.") from None
        try:
            if callable(parse):
                parse(text)
            elif text not in parse:  # type: ignore[operator]
                raise argparse.ArgumentTypeError(f"{text!r} is not among them")
            return text
        except argparse.ArgumentTypeError as error:
            print(f"{error}.")


def _metres(text: str) -> float:
    return parse_number(text, f"{text!r} is not a length of 0.001 to 10 m", least=0.001, most=10.0)


def _refuse_to_replace(options: argparse.Namespace, names: list[str]) -> None:
    there = [str(options.out / name) for name in names if (options.out / name).exists()]
    if there and not options.force:
        raise CommandError(f"{', '.join(there)} is there already. Choose another --out, or replace it with --force.")


def _next_steps(answers: Answers, folder: Path) -> str:
    return dedent(f"""\
        next:
          sudo cp {folder}/60-cmr.rules /etc/udev/rules.d/ && sudo udevadm control --reload && sudo udevadm trigger
          cmr doctor
          cmr run {folder}/robot_{answers.robot}_scenario.yaml
        To start driver and simulator with the computer:
          sudo cp {folder}/cmr-*.service /etc/systemd/system/
          sudo systemctl enable --now cmr-driver-{answers.robot} cmr-sim""")

"""cmr demo --investigate: an emulated robot with a hidden effect, and the processes that diagnose it."""

import argparse
import webbrowser
from pathlib import Path

import yaml

from cmr.bus.process import Process
from cmr.cli.errors import CommandError
from cmr.experiments.live.investigating import ROBOT, Investigating, scenario_text
from cmr.files import write_atomically
from cmr.plant.parameters import TYPICAL
from cmr.processes.children import Children
from robot_driver.emulator.settings import load_settings

HIDDEN = "wheel_radius_asymmetry"
HIDING, BELIEVED = "hidden.yaml", "believed.yaml"


def add_investigate(options: argparse.ArgumentParser) -> None:
    """Add the options of cmr demo --investigate."""
    options.add_argument(
        "--investigate",
        action="store_true",
        help="let an emulated robot diagnose its own hidden effects, and show it on a page",
    )
    options.add_argument(
        "--hide",
        nargs="+",
        default=[HIDDEN],
        choices=sorted(TYPICAL),
        metavar="EFFECT",
        help=f"with --investigate: what is hidden, at its usual size (default: {HIDDEN})",
    )


def demonstrate(options: argparse.Namespace, folder: Path, url: str) -> int:
    """Investigate a robot with all processes in real time, and print what was hidden in it."""
    from cmr.commands.investigating.command import PAGE  # not needed for --help
    from cmr.commands.scenarios import parse

    parameters, settings = _write_robot(options, folder)
    scenario = parse(scenario_text(parameters, settings, is_ideal=options.ideal or options.settings is None))
    longest = ["--longest", f"{options.seconds:g}"] if options.seconds is not None else []
    with Process("cmr-demo", url, lives_now=True) as process, Children(folder) as children:
        found = Investigating(process, children, scenario).run(longest)
        if found is None:
            return process.exit_code
    print(f"Hidden in the robot: {_hidden(options)}.")
    print(f"Look at {found / PAGE}; the parameters found are in {found / f'robot_{ROBOT}.yaml'}.", flush=True)
    webbrowser.open((found / PAGE).absolute().as_uri())
    return 0


def _write_robot(options: argparse.Namespace, folder: Path) -> tuple[Path, Path]:
    """Write the believed parameters of the robot, and the emulator's settings; return both paths."""
    from cmr.commands.investigating.emulated import believed

    parameters, settings = folder / BELIEVED, (options.settings or folder / HIDING).absolute()
    try:
        folder.mkdir(parents=True, exist_ok=True)
        believed(load_settings(options.settings), ROBOT).save(parameters)
        if options.settings is None:
            hidden = {name: value for effect in options.hide for name, value in TYPICAL[effect].items()}
            write_atomically(yaml.safe_dump({"effects": hidden}), settings)
    except OSError as error:
        raise CommandError(f"{folder}: cannot be written: {error.strerror}. Choose another with --out.") from error
    return parameters.absolute(), settings


def _hidden(options: argparse.Namespace) -> str:
    return f"what {options.settings} says" if options.settings else ", ".join(options.hide)

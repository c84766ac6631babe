"""cmr demo --lead: a person leads a virtual robot, and emulated real robots follow it."""

import argparse
from pathlib import Path

from cmr.bus.process import Process
from cmr.processes.children import Children


def add_lead(options: argparse.ArgumentParser) -> None:
    """Add the options of cmr demo --lead."""
    options.add_argument(
        "--lead",
        action="store_true",
        help="lead a virtual robot by hand, with the keys of this terminal or a joystick on the page that opens, while "
        "two emulated real robots follow it",
    )
    options.add_argument(
        "--seconds",
        type=float,
        default=None,
        metavar="S",
        help="with --lead, --investigate: end after this time of driving [s]",
    )
    options.add_argument(
        "--script",
        default="",
        metavar="STEPS",
        help="with --lead: drive these steps without a person, as in cmr-teleop",
    )


def lead(options: argparse.Namespace, folder: Path, url: str) -> int:
    """Let a person lead a virtual robot, followed by real ones."""
    from cmr.commands.scenarios import parse  # not needed for --help
    from cmr.experiments.live.leading import SCENARIO, Leading

    hands = ["--script", options.script] if options.script else []
    with Process("cmr-demo", url, lives_now=True) as process, Children(folder) as children:
        leading = Leading(process, children, parse(SCENARIO))
        print(leading.run(options.view or not hands, hands, options.seconds), flush=True)
        return process.exit_code

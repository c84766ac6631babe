"""cmr-fidelity: how well a team with one real robot represents a real one, and the effect of calibration."""

import argparse
import hashlib
import os
import time
from pathlib import Path

from cmr.cli.command_line import add_json, parse_count, parse_number, parse_robot_id, parser
from cmr.cli.errors import CommandError
from cmr.cli.progress import Progress
from cmr.cli.stopping import end_on_signals
from cmr.commands.first_use import PARTS, compile_first
from cmr.commands.scenarios import load as load_scenario
from cmr.experiments.fidelity.study import (
    PREPARATIONS,
    UNCALIBRATED,
    Scores,
    Study,
    Task,
    gathered,
    perform_all,
    tasks_of,
)
from cmr.experiments.scenario.ending import why_only_live
from cmr.experiments.scenario.reading import ScenarioError, path_of
from cmr.experiments.sweep.experiment import files_of, sources_digest
from cmr.experiments.sweep.journal import Journal, JournalError, Result
from cmr.experiments.team.experiment import ExperimentError
from cmr.experiments.team.plan import Scenario
from cmr.parameters.file import ParameterFile, ParameterFileError, load

FEWEST = 4  # seeds; fewer do not determine a distribution
JOURNAL = "experiments.jsonl"  # finished experiments, to resume an interrupted study


def main(arguments: list[str]) -> int:
    """Run cmr-fidelity."""
    options = command_parser().parse_args(arguments)
    end_on_signals("cmr-fidelity")
    scenario, study = _study(options)
    compile_first(PARTS)  # otherwise all workers would wait for one of them
    began = time.monotonic()
    try:
        with Journal(options.out / JOURNAL) as journal:
            scores = _performed(scenario, study, options, journal)
    except JournalError as error:
        raise CommandError(str(error)) from error
    except OSError as error:
        raise CommandError(f"{options.out}: cannot be written: {error.strerror}. Choose another with --out.") from error
    from cmr.experiments.fidelity.findings import conclusions, findings_of, table  # SciPy, which is slow to import
    from cmr.experiments.fidelity.writing import DOCUMENT, write

    findings = findings_of(scores)
    about = {
        "scenario": options.scenario,
        "seeds": options.seeds,
        "real_robot": study.real,
        "imperfections": study.size,
        "believed": {name: value.value for name, value in study.believed.values.items()},
    }
    try:
        files = write(options.out, scores, findings, about)
    except OSError as error:
        raise CommandError(f"{options.out}: cannot be written: {error.strerror}. Choose another with --out.") from error
    if options.json:
        print((options.out / DOCUMENT).read_text(encoding="utf-8"), end="")
        return 0
    print(table(findings))
    print("\n".join(["", *conclusions(scores, findings)]))
    print(f"\n{time.monotonic() - began:.0f} s; written to {options.out}: {', '.join(path.name for path in files)}")
    return 0


def command_parser() -> argparse.ArgumentParser:
    """Return the command line of cmr-fidelity."""
    options = parser(
        "cmr-fidelity",
        "Run a scenario many times with all robots real, and as often with one real robot and the rest virtual: not "
        "calibrated, calibrated, calibrated with diagnosed effects, and drawn from a population of three calibrated "
        "robots. Real robots are plants with hidden imperfections that differ from robot to robot. Says for each "
        "metric how far the teams with one real robot are from real teams, and by how much calibration closes the "
        "gap, or that it does not.\n\nNo hardware and no bus are needed. The same command resumes an interrupted "
        "study.",
        "cmr-fidelity line --seeds 20 --out fidelity",
        bus="not used: this command needs no bus",
    )
    add = options.add_argument
    add("scenario", metavar="SCENARIO", help="scenario file, or the name of a shipped one, as for cmr-run")
    add("--seeds", type=_seeds, default=20, metavar="N", help=f"experiments of each kind, {FEWEST} or more")
    add("--out", type=Path, required=True, metavar="DIR", help="folder for the results")
    _add_robots(options)
    add_json(options)
    add("--jobs", type=parse_count, default=len(os.sched_getaffinity(0)), metavar="N", help="processes side by side")
    return options


def _add_robots(options: argparse.ArgumentParser) -> None:
    """Add options on the real robot, the believed parameters, and their errors."""
    add = options.add_argument
    add(
        *("--robot", "--real"),
        type=parse_robot_id,
        default=None,
        metavar="N",
        help="id of the real robot; by default that of the scenario",
    )
    add(
        "--parameters",
        type=Path,
        default=None,
        metavar="FILE",
        help="what is believed of all robots; otherwise the parameter file of the real one",
    )
    add(
        "--imperfections",
        type=_size,
        default=1.0,
        metavar="SIZE",
        help="how far real robots are from what is believed and from one another; 0: not at all",
    )
    add(
        "--prepared",
        nargs="+",
        choices=PREPARATIONS,
        default=[],
        metavar="HOW",
        help=f"some of {', '.join(PREPARATIONS)} (default: all)",
    )


def _seeds(text: str) -> int:
    if not (text.isascii() and text.isdecimal() and FEWEST <= int(text) <= 100_000):
        raise argparse.ArgumentTypeError(f"{text!r} is not a whole number of {FEWEST} or more")
    return int(text)


def _size(text: str) -> float:
    return parse_number(text, f"{text!r} is not a number of 0 to 2", least=0.0, most=2.0)


def _study(options: argparse.Namespace) -> tuple[Scenario, Study]:
    """Return the scenario, and the study to make.

    Raises CommandError where the scenario or the parameters cannot be used.
    """
    try:
        scenario = load_scenario(path_of(options.scenario))
        real = _real_robot(scenario, options.robot)
        believed = _believed(scenario, real, options.parameters)
    except (ScenarioError, ParameterFileError) as error:
        raise CommandError(str(error)) from error
    only_live = why_only_live(scenario.ends_when)
    if only_live:
        raise CommandError(f"{scenario.name}: {only_live}.")
    return scenario, Study(scenario=scenario, believed=believed, real=real, size=options.imperfections)


def _real_robot(scenario: Scenario, chosen: int | None) -> int:
    if chosen is not None:
        if scenario.robot(chosen) is None:
            raise CommandError(f"--robot {chosen}: the scenario has no such robot.")
        return chosen
    if len(scenario.with_driver) != 1:
        raise CommandError("Say by --robot N which robot is real: the scenario has not just one that is.")
    return scenario.with_driver[0].robot_id


def _believed(scenario: Scenario, real: int, given: Path | None) -> ParameterFile:
    """Return the believed parameters of all robots, which must be complete."""
    robot = scenario.robot(real)
    if robot is not None and robot.parameters is None and robot.parameters_of is not None:
        robot = scenario.robot(robot.parameters_of)
    path = given or (robot.parameters if robot else None)
    if path is None:
        raise CommandError(f"Robot {real} has no parameter file in the scenario; name one by --parameters.")
    believed = load(path)
    believed.robot_parameters  # noqa: B018 - raises what is missing
    return believed


def _performed(
    scenario: Scenario, study: Study, options: argparse.Namespace, journal: Journal
) -> dict[str, list[Scores]]:
    """Run the experiments missing in the journal, with a progress bar; return the scores of all."""
    depends_on = (sources_digest(), [path.read_bytes() for path in sorted(files_of(scenario))], study)
    preparations = [name for name in PREPARATIONS if name in (UNCALIBRATED, *(options.prepared or PREPARATIONS))]
    keys = {task: _key(depends_on, task) for task in tasks_of(range(options.seeds), preparations)}
    left = [task for task, key in keys.items() if key not in journal.results]
    progress = Progress(len(left), "experiments", lines=True)
    if len(left) < len(keys):
        progress.say(f"{len(keys) - len(left)} of {len(keys)} experiments are there already.")
    try:
        with progress:
            for task, scores in perform_all(study, left, options.jobs):
                journal.add(keys[task], scores)
                progress.advance()
    except ExperimentError as error:
        raise CommandError(str(error)) from error
    return gathered({task: _scores(journal.results[key]) for task, key in keys.items()})


def _scores(result: Result) -> Scores:
    return {name: value for name, value in result.items() if isinstance(value, (int, float))}


def _key(depends_on: tuple[object, ...], task: Task) -> str:
    """Return the key of an experiment: it changes with all that the result depends on."""
    return hashlib.sha256(repr((*depends_on, task)).encode()).hexdigest()[:32]

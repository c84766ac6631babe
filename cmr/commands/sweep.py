"""cmr-sweep: many runs of one scenario, on all cores or on many computers."""

import argparse
import time
from collections.abc import Callable
from contextlib import nullcontext
from pathlib import Path
from typing import TYPE_CHECKING

from cmr.cli.command_line import check_writable, parser
from cmr.cli.configuration import results
from cmr.cli.errors import CommandError
from cmr.cli.progress import Progress
from cmr.cli.stopping import end_on_signals
from cmr.commands.first_use import BEHAVIOURS, EMULATOR, MODEL, WORLD, compile_first
from cmr.distribution import how_to_install

if TYPE_CHECKING:
    from cmr.experiments.sweep.journal import Journal, Result
    from cmr.experiments.sweep.planning import PlannedRun
    from cmr.experiments.sweep.settings import Setting, Value

MOST_SEEDS = 1_000_000
MOST_WORKERS = 4096


def main(arguments: list[str]) -> int:
    """Run cmr-sweep."""
    options = command_parser().parse_args(arguments)
    end_on_signals("cmr-sweep")
    settings, runs = _planned(options)
    try:
        from cmr.experiments.sweep.cluster import ClusterError
        from cmr.experiments.sweep.journal import Journal, JournalError
        from cmr.experiments.sweep.table import write_tables
    except ModuleNotFoundError as error:
        raise CommandError(
            f"{error.name} is missing, which sweeps need. To install it: {how_to_install('sweep')}"
        ) from error
    name = Path(options.scenario).stem
    out = options.out or results() / f"{name}_sweep"
    check_writable(out)
    compile_first([MODEL, WORLD, BEHAVIOURS, EMULATOR])  # otherwise all workers would wait for one of them
    try:
        with Journal(out / "runs.jsonl") as journal:
            failed = _perform(runs, journal, options)
            rows = [_row(run, journal.results[run.key]) for run in runs if run.key in journal.results]
        if rows:
            paths = [setting.path for setting in settings]
            print("\n".join(write_tables(rows, paths, runs[0].experiment.scenario.metrics, out, name)))
    except (ClusterError, JournalError) as error:
        raise CommandError(str(error)) from error
    except OSError as error:
        raise CommandError(
            f"{out}: cannot be written: {error.strerror or error}. Choose another with --out."
        ) from error
    if failed:
        raise CommandError(f"{failed[0]} {len(failed)} of {len(runs)} runs failed; the same command tries them again.")
    return 0


def _planned(options: argparse.Namespace) -> "tuple[list[Setting], list[PlannedRun]]":
    """Return the requested settings and runs."""
    from cmr.commands.scenarios import HARDWARE
    from cmr.experiments.scenario.reading import ScenarioError, path_of
    from cmr.experiments.sweep.experiment import ExperimentError
    from cmr.experiments.sweep.planning import plan
    from cmr.experiments.sweep.settings import SettingError, setting_of

    try:
        settings = [setting_of(text) for text in options.set]
        return settings, plan(path_of(options.scenario), settings, options.seeds, HARDWARE)
    except SettingError as error:
        raise CommandError(f"--set {error}") from error
    except (ScenarioError, ExperimentError) as error:
        raise CommandError(str(error)) from error


def _perform(runs: "list[PlannedRun]", journal: "Journal", options: argparse.Namespace) -> list[str]:
    """Do the runs missing in the journal; return a sentence for each that failed."""
    from cmr.experiments.sweep.cluster import lookout, perform, worker_command, workers
    from cmr.experiments.sweep.experiment import perform as work

    missing = {run.key: run for run in runs if run.key not in journal.results}
    progress = Progress(len(missing), "runs", lines=True)
    if len(missing) < len(runs):
        progress.say(f"{len(runs) - len(missing)} of {len(runs)} runs are there already.")
    if not missing:
        return []
    failed = []
    hint = f"To start some: {worker_command(options.scheduler)}"
    with (
        workers(options.scheduler, options.workers) as client,
        lookout(client, lambda: progress.warn(f"Waiting for workers: there are none. {hint}"))
        if options.scheduler
        else nullcontext(),
        progress,
    ):
        if any(count > 1 for count in client.nthreads().values()):
            progress.say(f"Workers with threads do one run at a time. {hint}")
        began = time.monotonic()
        jobs = {run.key: (run.experiment, run.seed) for run in missing.values()}
        for done, (key, result) in enumerate(perform(client, work, jobs), start=1):
            if isinstance(result, BaseException):
                failed.append(_failure(missing[key], result))
            else:
                journal.add(key, result)
            progress.show(_pace(done, time.monotonic() - began), done)
    progress.say(f"{len(missing)} runs in {_pace(len(missing), time.monotonic() - began)}.")
    return failed


def _pace(done: int, seconds: float) -> str:
    return f"{seconds:.0f} s, {done / max(seconds, 1e-9):.3g} a second"


def _failure(run: "PlannedRun", error: BaseException) -> str:
    values = "".join(f" {key}={value}" for key, value in run.values.items())
    return f"Seed {run.seed}{values}: {type(error).__name__}: {error}".rstrip(".") + "."


def _row(run: "PlannedRun", result: "Result") -> "dict[str, Value]":
    return {"seed": run.seed, **run.values, **result}


def command_parser() -> argparse.ArgumentParser:
    """Return the command line of cmr-sweep."""
    options = parser(
        "cmr-sweep",
        "Run a scenario many times without hardware, faster than real time: with every seed and every combination of "
        "settings. Real and emulated robots are moved by a plant that differs from seed to seed.\n\nResults land in "
        "the folder of --out: runs.parquet has a row for each run (identical for the same seed, to the last bit), "
        "summary.png plots them, and an interrupted sweep resumes from runs.jsonl.",
        "cmr-sweep line --seeds 100 --set robots.11.behaviour.gap=0.3,0.5,0.7",
        bus="not used: a sweep needs no bus",
    )
    options.add_argument(
        "scenario", metavar="SCENARIO", help="scenario file, or the name of a shipped one, as for cmr-run"
    )
    options.add_argument(
        "--seeds", type=_number(MOST_SEEDS), default=20, metavar="N", help="runs of each combination, one a seed"
    )
    options.add_argument(
        "--set",
        action="append",
        default=[],
        metavar="KEY=A,B,C",
        help="run the scenario with each of these values of a key, named by its dotted path, robots by their ids; "
        "several --set: every combination of their values",
    )
    options.add_argument(
        "--out", type=Path, default=None, metavar="DIR", help="folder for the results; otherwise SCENARIO_sweep"
    )
    _add_workers(options)
    return options


def _add_workers(options: argparse.ArgumentParser) -> None:
    """Add options on where the runs are done: local processes, or workers of a Dask scheduler."""
    where = options.add_mutually_exclusive_group()
    where.add_argument(
        "--scheduler",
        default=None,
        metavar="tcp://HOST:8786",
        help="let the workers of this Dask scheduler do the runs, on other computers; otherwise processes here",
    )
    where.add_argument(
        "--jobs",
        "--workers",
        dest="workers",
        type=_number(MOST_WORKERS),
        default=None,
        metavar="N",
        help="how many processes here; otherwise one a core",
    )


def _number(largest: int) -> Callable[[str], int]:
    def parse(text: str) -> int:
        if not text.isascii() or not text.isdecimal() or not 1 <= int(text) <= largest:
            raise argparse.ArgumentTypeError(f"{text!r} is not a whole number of 1 to {largest}")
        return int(text)

    return parse

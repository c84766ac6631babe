"""cmr-run: one command for a whole team experiment, from a scenario to its report."""

import argparse
import shlex
import time
from pathlib import Path

from cmr.bus.preflight import check as check_bus
from cmr.bus.preflight import parse_udpm, resolve_url
from cmr.bus.process import Process
from cmr.bus.streams import PROCESS_STATUS
from cmr.cli.command_line import check_writable, parser
from cmr.cli.configuration import results
from cmr.cli.errors import CommandError
from cmr.cli.progress import Progress
from cmr.commands import first_use
from cmr.commands.scenarios import load
from cmr.experiments.live.jobs import STATE, jobs_of
from cmr.experiments.live.live_run import LiveRun, Outcome
from cmr.experiments.live.preparing import prepare
from cmr.experiments.live.recorder import logs_in
from cmr.experiments.live.report import metrics_in_words, write_report
from cmr.experiments.scenario import Scenario, ScenarioError
from cmr.experiments.scenario.reading import SHIPPED, path_of, shipped
from cmr.experiments.team.metrics import UNITS
from cmr.files import gone_before_and_after
from cmr.msg import process_status_t
from cmr.processes.children import Children
from cmr.processes.job import CALIBRATOR, DIAGNOSER, EMULATOR, PILOT, SIM, Job
from cmr.processes.requests import AGENT, is_this_host, short_name

NAME = "cmr-run"
HEARING_AGENTS, HEARING_RATE = 1.5, 20.0  # s, Hz
# The parts that must be compiled for processes, by role.
TAKES = {
    SIM: (first_use.MODEL, first_use.WORLD, first_use.BEHAVIOURS),
    PILOT: (first_use.WORLD, first_use.BEHAVIOURS),
    EMULATOR: (first_use.EMULATOR,),
    CALIBRATOR: (first_use.ESTIMATOR,),
    DIAGNOSER: (first_use.ESTIMATOR,),
}


def main(arguments: list[str]) -> int:
    """Run cmr-run."""
    options = _options(arguments)
    if options.list:
        return _list_shipped()
    scenario = _load(options.scenario)
    folder: Path = options.out or results() / f"{scenario.name}-{time.strftime('%Y%m%d-%H%M%S')}"
    if logs_in(folder):
        raise CommandError(
            f"{folder} holds a run already. Choose another with --out; without, a new one gets the date."
        )
    url = options.lcm_url or scenario.lcm_url
    check_writable(folder)
    check_bus(url)
    _check_reach(scenario, resolve_url(url))
    first_use.compile_first(parts_to_compile(scenario, folder))
    with Process(NAME, url, lives_now=True) as process:
        try:
            prepared = prepare(scenario, folder)
        except OSError as error:
            raise CommandError(f"{folder}: cannot be written: {error.strerror}. Choose another with --out.") from error
        ours, others = _by_host(jobs_of(prepared, folder, process.bus.url, begin_with=NAME))
        _tell_others(_without_agents(process, others), folder)
        robots_end = gone_before_and_after(folder / STATE)
        with robots_end, Children(folder) as children, Progress(lines=True) as progress:
            run = LiveRun(prepared, folder, process, ours, children, progress, others)
            began = time.time()
            outcome = run.run()
            run.say(f"Stopping: {outcome.ended_by}.")
            run.stop()
        _report(run, outcome, began, folder, progress)
        return _exit_code(outcome, folder)


def _report(run: LiveRun, outcome: Outcome, began: float, folder: Path, progress: Progress) -> None:
    """Write the report, and print the results, what must be ended by hand, and where the files are.

    Raises CommandError if it cannot be written.
    """
    try:
        document = write_report(run, outcome, began, folder)
    except OSError as error:
        ended = f"The run ended: {outcome.ended_by}. Its report cannot be written"
        raise CommandError(f"{ended}: {folder}: {error.strerror or error}.") from error
    if document["metrics"]:
        print(f"Measured: {metrics_in_words(document)}.")
    if document["unreliable"]:
        progress.warn(document["unreliable"])
    if by_hand := run.elsewhere.by_hand():
        print(f"End what was started on {_hosts(by_hand)} there.")
    logs = where_logs_are(logs_in(folder))
    print(f"Look at {folder}/report.html; {logs}the output of each process is beside it.")


def command_parser() -> argparse.ArgumentParser:
    """Return the command line of cmr-run."""
    options = parser(
        NAME,
        "Run a team experiment: start what its scenario names (drivers or emulators, cmr-sim, pilots, calibrator), "
        "start again what dies, record the log, show how it goes, and write a report. "
        "Processes are stopped in order, those that command motors first.\n\n"
        "A run ends when its duration is over, or before by ends_when in the scenario: waypoints_reached, or "
        "{metric: formation_error, above: 0.5}, also with below. With after: 10 the metric counts from 10 s on; with "
        f"over: 5 the formation error is that of the last 5 s, not of the whole run. Metrics: {_metrics()}.",
        "cmr-run line\n  cmr-run my_scenario.yaml --out results\n  cmr-run --list",
    )
    options.add_argument("scenario", nargs="?", help="YAML file, or the name of a shipped scenario")
    options.add_argument("--list", action="store_true", help="show the shipped scenarios")
    options.add_argument("--out", type=Path, metavar="DIR", help="folder for the results; otherwise NAME-DATE-TIME")
    return options


def _options(arguments: list[str]) -> argparse.Namespace:
    options = command_parser()
    result = options.parse_args(arguments)
    if result.scenario is None and not result.list:
        options.error("name a scenario; --list shows the shipped ones")
    return result


def _metrics() -> str:
    return ", ".join(f"{name} [{unit}]" for name, unit in UNITS.items())


def _list_shipped() -> int:
    for name, path in shipped().items():
        print(f"{name:10s} {load(path).about}")
    print(f"To change one, copy it from {SHIPPED}.")
    return 0


def _load(name: str) -> Scenario:
    """Load a scenario from a file, or a shipped one.

    Raises CommandError saying what is wrong, and where.
    """
    try:
        return load(path_of(name))
    except ScenarioError as error:
        raise CommandError(str(error)) from error


def parts_to_compile(scenario: Scenario, folder: Path) -> set[str]:
    """Return the parts of `first_use` needed by the processes started here."""
    ours, _ = _by_host(jobs_of(scenario, folder, ""))
    return {part for job in ours for part in TAKES.get(job.role, ())}


def _by_host(jobs: list[Job]) -> tuple[list[Job], list[Job]]:
    """Return the processes to start here, and those that belong to other machines."""
    ours = [job for job in jobs if job.host in (None, "localhost") or is_this_host(job.host)]
    return ours, [job for job in jobs if job not in ours]


def where_logs_are(logs: list[Path]) -> str:
    """Return a clause on the log of a run, or its logs if the recorder was restarted."""
    if not logs:
        return ""  # it is on another machine
    return f"the {'logs are' if len(logs) > 1 else 'log is'} {', '.join(map(str, logs))}, "


def _hosts(jobs: list[Job]) -> str:
    return ", ".join(dict.fromkeys(job.host or "" for job in jobs))


def _check_reach(scenario: Scenario, url: str) -> None:
    """Raise CommandError if the bus does not reach the other machines of a scenario."""
    _, others = _by_host(jobs_of(scenario, Path(), url))
    if others and url.startswith("udpm") and parse_udpm(url).ttl == 0:
        raise CommandError(
            f"{others[0].name} runs on {others[0].host}, but the bus {url!r} does not leave this machine. "
            "Use an LCM URL with ttl=1, for example with lcm_url in the scenario."
        )


def _without_agents(process: Process, others: list[Job]) -> list[Job]:
    """Return the processes of other machines without an agent; agents report every second."""
    if not others:
        return []
    heard: set[str] = set()
    until = time.monotonic() + HEARING_AGENTS
    process.subscribe(PROCESS_STATUS, every=True)
    for _ in process.loop(HEARING_RATE):
        process.state = process_status_t.STARTING
        messages = [received.message_of(PROCESS_STATUS) for received in process.received()]
        heard |= {short_name(status.host) for status in messages if status is not None and status.process == AGENT}
        if time.monotonic() > until:
            break
    return [job for job in others if short_name(job.host or "") not in heard]


def _tell_others(others: list[Job], folder: Path) -> None:
    """Print what to start on other machines."""
    for job in others:
        command = [Path(job.command[0]).name, *job.command[1:]]
        print(f"Start on {job.host}: {shlex.join(command)}", flush=True)
    if others:
        print(f"These read files of the folder {folder}: first copy it to {_hosts(others)}.", flush=True)


def _exit_code(outcome: Outcome, folder: Path) -> int:
    if outcome.failed:
        more = " See the files *.txt beside the report." if any(folder.glob("*.txt")) else ""
        raise CommandError(f"{outcome.ended_by}.{more}")
    return 130 if outcome.interrupted else 0

"""cmr-diagnose: show what the simulation gets wrong, name the cause, extend the model and measure the gain."""

import argparse
import os
import signal
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from datetime import datetime, timezone
from pathlib import Path
from types import FrameType

from cmr.bus.message import Message
from cmr.bus.preflight import check as check_bus
from cmr.bus.process import Process
from cmr.bus.streams import GYRO, MOTOR_FEEDBACK, PARAMETERS, POSE, Stream
from cmr.cli.command_line import (
    add_json,
    add_logs,
    add_nominal,
    check_writable,
    logs_of,
    parse_count,
    parse_robot_id,
    parser,
)
from cmr.cli.errors import CommandError
from cmr.cli.progress import Progress
from cmr.commands.first_use import ESTIMATOR, announce_compiling, compile_first
from cmr.diagnosis.job import DOCUMENT, Job, JobError, Outcome, attempt, perform, robots_in
from cmr.diagnosis.many import Pool, jobs_of
from cmr.diagnosis.result import Against
from cmr.model.catalogue import LAWS, learn
from cmr.model.laws.law import LawError
from cmr.msg import process_status_t
from cmr.parameters.file import ParameterFile, ParameterFileError, load, sha256_of
from cmr.parameters.following import ParameterFollower
from cmr.parameters.laws import LawFileError, laws_beside, read_law
from cmr.recordings.arrivals import COMMANDS_OF
from cmr.recordings.recording import RecordingError, choose_robot

WATCHED: tuple[Stream[Message], ...] = (*COMMANDS_OF.values(), MOTOR_FEEDBACK, GYRO, POSE, PARAMETERS)
WATCH_RATE = 20.0  # Hz
LIVE = "live.txt"


def main(arguments: list[str]) -> int:
    """Run cmr-diagnose."""
    options = _options(arguments)
    _learn(options.laws, options.parameters)
    nominal, against = _nominal(options.parameters), None
    if options.against is not None:
        nominal, against = _baseline(options.against)
    if options.out is not None:
        check_writable(options.out)
    if options.live:
        check_bus(options.lcm_url)  # report errors before anything takes time
        compile_first([ESTIMATOR])
        return _live(options, nominal)
    pattern = Job(
        logs=(),
        robot_id=options.robot,
        folder=options.out,
        nominal=nominal,
        against=against,
        held_out=tuple(options.held_out),
        report=not options.no_report,
        laws=tuple(LAWS.values()),
    )
    try:
        jobs = jobs_of(options.logs, pattern, each=options.each)
    except RecordingError as error:
        raise CommandError(str(error)) from error
    _check_robot(jobs)
    compile_first([ESTIMATOR])
    announce_compiling()
    return _one(jobs[0], options.why, options.json) if len(jobs) == 1 else _many(jobs, options.jobs, options.why)


def _check_robot(jobs: Sequence[Job]) -> None:
    """Raise CommandError where the robot of a single diagnosis is not in its logs; with many, the table says so."""
    for log in (*jobs[0].logs, *jobs[0].held_out) if len(jobs) == 1 else ():
        try:
            choose_robot(dict.fromkeys(robots_in(log), 1), jobs[0].robot_id, str(log))
        except RecordingError as error:
            raise CommandError(str(error)) from error


def command_parser() -> argparse.ArgumentParser:
    """Return the command line of cmr-diagnose."""
    options = parser(
        "cmr-diagnose",
        "Show what the simulation of a robot gets wrong, name the physical cause, extend the model and measure the "
        "gain. The logs of one robot are diagnosed together: different manoeuvres distinguish effects. Writes "
        "diagnosis.json, report.html and the extended parameters robot_N.yaml.\n\nLogs of several robots, or --each, "
        "make several diagnoses, which run side by side, each with a folder of its own below DIR. With --live a "
        "drive is monitored while it happens: changes are reported on PROCESS_STATUS.",
        "cmr-diagnose circles.lcm squares.lcm --held-out eight.lcm --out diagnosis\n"
        "  cmr-diagnose runs/*.lcm --each --out diagnoses\n"
        "  cmr-diagnose --live --robot 0 --parameters robot_0.yaml",
        bus="LCM bus of --live; otherwise LCM_DEFAULT_URL from the environment, otherwise this host only",
    )
    add_logs(options, "event logs to diagnose")
    add_json(options)
    _add_robot(options)
    _add_run(options)
    return options


def _options(arguments: list[str]) -> argparse.Namespace:
    options = command_parser()
    chosen = options.parse_intermixed_args(arguments)
    chosen.logs = logs_of(chosen)
    wrong = _contradiction(chosen)
    if wrong:
        options.error(wrong)
    return chosen


def _add_robot(options: argparse.ArgumentParser) -> None:
    """Add options on the robot and its known parameters."""
    options.add_argument("--robot", type=parse_robot_id, default=None, metavar="N", help="robot id (default: all)")
    add_nominal(options)
    options.add_argument(
        "--against",
        type=Path,
        default=None,
        metavar="FILE",
        help="report only differences from the robot of this parameter file, including its effects",
    )
    options.add_argument(
        "--laws",
        type=Path,
        nargs="+",
        action="extend",
        default=[],
        metavar="PATH",
        help="files law_*.yaml, or folders of them, to test by name; those beside the file of --parameters always are",
    )


def _add_run(options: argparse.ArgumentParser) -> None:
    """Add options on the computation and the output."""
    options.add_argument(
        "--held-out",
        type=Path,
        nargs="+",
        action="extend",
        default=[],
        metavar="RUN.lcm",
        help="logs on which the gain is measured and nothing is fitted; best another manoeuvre",
    )
    options.add_argument("--out", type=Path, default=None, metavar="DIR", help="folder for the results")
    options.add_argument("--each", action="store_true", help="diagnose every log for itself")
    options.add_argument("--why", action="store_true", help="print each decision of the search, and its reason")
    options.add_argument("--no-report", action="store_true", help="leave out report.html")
    options.add_argument(
        "--jobs", type=parse_count, default=_cores(), metavar="N", help="how many diagnoses run side by side"
    )
    options.add_argument("--live", action="store_true", help="monitor a drive; with --out findings are stored there")


def _contradiction(chosen: argparse.Namespace) -> str:
    """Return the contradiction between options; empty if there is none."""
    if chosen.against is not None and (chosen.live or chosen.parameters is not None):
        return "--against gives all of a robot's parameters; it goes neither with --parameters nor with --live"
    if chosen.live:
        if chosen.logs or chosen.held_out:
            return "--live listens to the bus; it takes no logs"
        return "--why explains the search of logs; --live searches none" if chosen.why else ""
    if chosen.json and chosen.each:
        return "--json is for one diagnosis; with --each, diagnosis.json is in every folder"
    if not chosen.logs:
        return "name at least one event log, or --live"
    if chosen.out is None:
        return "--out DIR is missing: the folder for the results"
    places = [log.resolve() for log in chosen.logs]
    twice = next((log for log in chosen.logs if places.count(log.resolve()) > 1), None)
    if twice:
        return f"{twice} is named twice"
    both = next((log for log in chosen.held_out if log.resolve() in places), None)
    return f"{both} cannot be fitted and held out at once" if both else ""


def _cores() -> int:
    """Return the number of cores available to this process."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def _learn(paths: Sequence[Path], parameters: Path | None) -> None:
    """Add laws to the catalogue: from files, from folders, and beside the parameters."""
    files = [file for path in paths for file in (laws_beside(path) if path.is_dir() else [path])]
    files += laws_beside(parameters) if parameters else []
    for file in dict.fromkeys(file.resolve() for file in files):
        try:
            entry = read_law(file)
            learn(entry.law, {name: one.value for name, one in entry.coefficients.items()})
        except (LawFileError, LawError) as error:
            raise CommandError(str(error) if isinstance(error, LawFileError) else f"{file}: {error}") from error


def _nominal(path: Path | None) -> ParameterFile | None:
    try:
        return load(path) if path else None
    except ParameterFileError as error:
        raise CommandError(str(error)) from error


def _baseline(path: Path) -> tuple[ParameterFile, Against]:
    """Return the robot to compare with, and its file.

    Raises CommandError where the file is missing, wrong, or lacks a parameter that a simulation needs.
    """
    try:
        file = load(path)
        file.robot_parameters  # noqa: B018 - says what is missing
    except ParameterFileError as error:
        raise CommandError(str(error)) from error
    return file, Against(source=str(path), sha256=sha256_of(path.read_text(encoding="utf-8")))


def _one(job: Job, tell_why: bool, as_json: bool) -> int:
    """Do a job in this process."""
    try:
        with Progress() as progress:
            diagnosis, files = perform(job, progress.show)
    except JobError as error:
        raise CommandError(str(error)) from error
    if as_json:
        print((job.folder / DOCUMENT).read_text(encoding="utf-8"), end="")
        return 0
    from cmr.diagnosis.summary import summary
    from cmr.diagnosis.why import why

    print(summary(diagnosis))
    if tell_why:
        print(f"\n{why(diagnosis.decisions)}")
    print(f"\nwritten to {job.folder}: {', '.join(path.name for path in files)}")
    return 0


def _many(jobs: Sequence[Job], count: int, tell_why: bool) -> int:
    """Do jobs side by side, and print a table of their outcomes."""
    from cmr.diagnosis.summary import outcome_line, outcome_table
    from cmr.diagnosis.why import why

    outcomes: list[Outcome] = []
    with (
        _interrupts_raised(),
        Progress(len(jobs), "diagnoses") as progress,
        Pool(min(count, len(jobs)), attempt) as pool,
    ):
        progress.show("Starting.")
        for outcome in pool.perform(jobs, progress.show):
            outcomes.append(outcome)
            if not progress.visible:
                progress.say(f"[{len(outcomes)}/{len(jobs)}] {outcome_line(outcome)}")
            progress.advance()
    place = {job.folder: number for number, job in enumerate(jobs)}
    outcomes.sort(key=lambda outcome: place[outcome.folder])
    print(outcome_table(outcomes))
    for outcome in outcomes if tell_why else ():
        if not outcome.failure:
            print(f"\n{outcome.folder.name}\n{why(outcome.decisions)}")
    failed = sum(bool(outcome.failure) for outcome in outcomes)
    if failed < len(jobs):
        print(f"written to the folders of these names below {jobs[0].folder.parent}")
    if failed:
        raise CommandError(f"{failed} of {len(jobs)} diagnoses failed; the table says why.")
    return 0


def _live(options: argparse.Namespace, nominal: ParameterFile | None) -> int:
    """Monitor robots on the bus; changes are reported on PROCESS_STATUS and on the terminal."""
    # The monitor's libraries take a while to load.
    from cmr.diagnosis.live import Watcher
    from cmr.world.loading import Loader

    owner = options.robot if options.robot is not None or nominal is None else nominal.robot_id
    loader = Loader()
    watcher = Watcher(
        lambda robot_id: ParameterFollower(robot_id, options.parameters if robot_id == owner else None),
        options.robot,
        loader.ready,
    )
    with Process("cmr-diagnose", options.lcm_url) as process:
        for stream in WATCHED:
            process.subscribe(stream, options.robot, every=True)
        watching = "Watching. Changes are reported here, and the messages received on PROCESS_STATUS."
        print(f"{process.name}: {watching}", file=sys.stderr, flush=True)
        for utime in process.loop(rate_hz=WATCH_RATE):
            process.dispatch(watcher.handle)
            news = watcher.advance(utime)
            problem = watcher.problem or loader.message
            process.state = process_status_t.DEGRADED if problem else process_status_t.RUNNING
            process.message = f"{problem} {watcher.alarms}".strip() if problem else watcher.status()
            process.parameters_sha256 = watcher.parameters_sha256
            if news:
                process.publish_status()
                _tell(utime, news, options.out)
        return process.exit_code


def _tell(utime: int, sentences: Sequence[str], folder: Path | None) -> None:
    """Print sentences with the time, and add them to live.txt in the folder."""
    clock = datetime.fromtimestamp(utime * 1e-6, timezone.utc).strftime("%Y-%m-%dT%H:%M:%SZ")
    lines = [f"{clock} {sentence}" for sentence in sentences]
    print("\n".join(lines), flush=True)
    if folder is None:
        return
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with (folder / LIVE).open("a", encoding="utf-8") as stream:
            stream.write("\n".join(lines) + "\n")
    except OSError as error:
        raise CommandError(f"{folder}: cannot be written: {error.strerror}. Choose another with --out.") from error


@contextmanager
def _interrupts_raised() -> Iterator[None]:
    """Let signals raise KeyboardInterrupt, so that the processes of a pool are ended before this one ends."""

    def interrupt(_number: int, _frame: FrameType | None) -> None:
        raise KeyboardInterrupt

    numbers = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
    before = {number: signal.signal(number, interrupt) for number in numbers}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)

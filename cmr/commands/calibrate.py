"""cmr-calibrate: find the parameters of a real robot from a figure-eight drive, live or from a log."""

import argparse
import hashlib
import sys
import threading
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TextIO

from cmr.bus.messages import now_utime
from cmr.bus.process import Process, Timer
from cmr.bus.streams import CALIBRATION_STATUS, PARAMETERS
from cmr.calibration.calibrate import AVERAGE, METHODS, PAPER, calibrate
from cmr.calibration.calibrator import HEARD, Calibrator
from cmr.calibration.result import CalibrationResult
from cmr.cli.command_line import (
    add_json,
    add_logs,
    add_nominal,
    check_writable,
    logs_of,
    parse_robot_id,
    parser,
    print_json,
)
from cmr.cli.configuration import parameter_file
from cmr.cli.configuration import robot as default_robot
from cmr.cli.errors import CommandError
from cmr.cli.progress import Progress
from cmr.commands.first_use import ESTIMATOR, compile_first
from cmr.estimation.estimates import Estimate, EstimationError
from cmr.msg import calibration_status_t, process_status_t
from cmr.parameters.file import ParameterFile, ParameterFileError, load
from cmr.priority import give_way
from cmr.recordings.recording import Recording, RecordingError, read_messages
from cmr.recordings.signal import Signal

STATUS_PERIOD = 0.25  # s
LOOK_PERIOD = 0.5  # s; the estimates so far are updated this often, if the computer is fast enough
FINISHED = (calibration_status_t.DONE, calibration_status_t.FAILED)
LEAST_OF_DRIVE = 0.5  # share of a drive in which poses are expected
FURTHER = 5.0  # s; a log that continues for longer after a drive may contain another one
ANNOUNCING = 3.0  # s for which a new file is announced before the command ends; cmr-sim continues announcing it


def main(arguments: list[str]) -> int:
    """Run cmr-calibrate."""
    options = _options(arguments)
    nominal = _nominal(options.parameters)
    if options.out:
        check_writable(options.out.parent)
    if options.picture and not options.picture.parent.is_dir():
        raise CommandError(f"{options.picture.parent} is not a folder. Choose another place with --picture.")
    if options.log:
        return _from_logs(options, nominal)
    return _live(options, nominal)


def command_parser() -> argparse.ArgumentParser:
    """Return the command line of cmr-calibrate."""
    options = parser(
        "cmr-calibrate",
        "Find k2_over_k3, k1 and base_width of a real robot while it drives a figure-eight (both lobes, best at two "
        "speeds), and write them to its parameter file, with the effects that the drive shows. Also works on an LCM "
        "event log.",
        "cmr-calibrate --robot 0 --out robot_0.yaml\n  cmr-calibrate run.lcm --out robot_0.yaml",
    )
    add_logs(options, "event logs of one robot, fitted together; else live")
    options.add_argument(
        "--robot",
        type=parse_robot_id,
        default=None,
        metavar="N",
        help="robot id; else 0 live, the only one of a log",
    )
    add_json(options)
    add_nominal(options)
    options.add_argument(
        "--whole-log",
        action="store_true",
        help="use all of each log, as cmr-diagnose does; otherwise the first drive, as a live calibration does",
    )
    _add_results(options)
    return options


def _add_results(options: argparse.ArgumentParser) -> None:
    """Add options on the method and the output."""
    options.add_argument(
        "--out", type=Path, default=None, metavar="FILE", help="file to write; live: robot_N.yaml, log: only print"
    )
    options.add_argument(
        "--paper-only",
        action="store_true",
        help="write the three values that predict best by themselves, and no effects",
    )
    options.add_argument(
        "--method",
        choices=METHODS,
        default=AVERAGE,
        help="average: over the effects that the drive shows or may hide (default); paper: a grid search over the "
        "whole path, as in the paper, with its error surface in the picture",
    )
    options.add_argument(
        "--picture",
        type=Path,
        default=None,
        metavar="FILE",
        help="draw path, residuals and error surface, as .png, .svg or .pdf",
    )


def _options(arguments: list[str]) -> argparse.Namespace:
    options = command_parser()
    given = options.parse_intermixed_args(arguments)
    given.log = logs_of(given)
    if given.method == PAPER and given.paper_only:
        options.error(
            "--paper-only chooses among what --method average finds; --method paper knows the three parameters only"
        )
    if given.whole_log and not given.log:
        options.error("--whole-log needs a log")
    return given


def _nominal(path: Path | None) -> ParameterFile | None:
    try:
        return load(path) if path else None
    except ParameterFileError as error:
        raise CommandError(str(error)) from error


def _from_logs(options: argparse.Namespace, nominal: ParameterFile | None) -> int:
    try:
        recordings = [_recording(path, options, nominal) for path in options.log]
        compile_first([ESTIMATOR])  # live, it listens meanwhile
        with Progress() as progress:
            progress.show(f"Calibrating robot {recordings[0].robot_id}.")
            result = calibrate(recordings, nominal, method=options.method, paper_only=options.paper_only)
    except (RecordingError, EstimationError) as error:
        raise CommandError(str(error)) from error
    if options.json:
        print_json(result.to_dict())
    else:
        print(result.summary())
    _draw(result, options.picture, _notes(options))
    if options.out:
        if result.why_no_file:
            raise CommandError(result.why_no_file)
        digest = hashlib.sha256()
        for path in options.log:
            digest.update(path.read_bytes())
        source = {"log": " ".join(str(path) for path in options.log), "sha256": digest.hexdigest()}
        _save(result.parameter_file(source), options.out)
        print(f"written to {options.out}", file=_notes(options))
    return 0


def _recording(path: Path, options: argparse.Namespace, nominal: ParameterFile | None) -> Recording:
    """Return the first drive of a log, or all of it if requested."""
    messages = read_messages(path, options.robot)
    if options.whole_log:
        return Recording.of(messages)
    calibrator = Calibrator.of(messages, nominal)
    if calibrator.missing:
        print(
            f"{path}: not a whole figure-eight (missing: {calibrator.missing}); all of it is used.",
            file=_notes(options),
        )
    first, whole = calibrator.recording(), Recording.of(messages)
    if _span(first.poses) < LEAST_OF_DRIVE * min(_span(first.wheels), _span(whole.poses)):
        # A clock that was set wrong, which the estimation corrects.
        print(f"{path}: few poses are stamped within its first drive; all of it is used.", file=_notes(options))
        return whole
    if calibrator.left_out > FURTHER:
        print(
            f"{path}: the first drive is used, as in a live calibration. {calibrator.left_out:.0f} s follow after it; "
            "--whole-log uses them, too, as cmr-diagnose does.",
            file=_notes(options),
        )
    return first


def _span(signal: Signal) -> float:
    """Return the time from the first to the last sample [s]."""
    return float(signal.seconds[-1]) if len(signal) else 0.0


def _notes(options: argparse.Namespace) -> TextIO:
    """Return where remarks are printed: not on stdout together with JSON."""
    return sys.stderr if options.json else sys.stdout


def _live(options: argparse.Namespace, nominal: ParameterFile | None) -> int:
    robot_id = options.robot if options.robot is not None else default_robot()
    path = options.out or parameter_file(robot_id)
    calibrator = Calibrator(robot_id, nominal, method=options.method, paper_only=options.paper_only)
    work = Work()
    calibrator.loading = True
    work.begin(calibrator.load)
    report, look = Timer(STATUS_PERIOD), Timer(LOOK_PERIOD)
    finished_at: float | None = None
    said = ""
    with Process("cmr-calibrate", options.lcm_url) as process:
        for stream in HEARD:
            process.subscribe(stream, robot_id, every=True)
        for _utime in process.loop(rate_hz=50.0):
            process.dispatch(calibrator.handle)
            if calibrator.loading or process.state == process_status_t.STARTING:
                process.state = process_status_t.STARTING if calibrator.loading else process_status_t.RUNNING
            if work.idle and calibrator.complete and calibrator.state == calibration_status_t.FITTING:
                work.begin(calibrator.fit)
            elif work.idle and calibrator.tells_something and look.due():
                work.begin(calibrator.look, calibrator.recording(), while_driving=True)
            if calibrator.state in FINISHED and finished_at is None:
                finished_at = time.monotonic()
                _publish_result(calibrator, path, process)
            if report.due():
                status = calibrator.status()
                process.publish(CALIBRATION_STATUS, status, robot_id)
                said = _say(robot_id, status, calibrator.so_far, calibrator.averages, said)
            if finished_at is not None and time.monotonic() > finished_at + ANNOUNCING:
                break
    if calibrator.result is not None:
        _draw(calibrator.result, options.picture)
    if calibrator.state == calibration_status_t.FAILED:
        raise CommandError(calibrator.failure)
    return process.exit_code


class Work:
    """One task at a time in a separate thread, so that the loop continues and a signal ends the process."""

    def __init__(self) -> None:
        self._thread: threading.Thread | None = None

    @property
    def idle(self) -> bool:
        """Whether there is no current task."""
        return self._thread is None or not self._thread.is_alive()

    def begin(self, work: Callable[..., object], *arguments: object, while_driving: bool = False) -> None:
        """Start a task; one that runs while a robot is driven gets low priority."""

        def run() -> None:
            if while_driving:  # otherwise a drive would wait for it, on a busy computer for minutes
                give_way()
            work(*arguments)

        self._thread = threading.Thread(target=run, daemon=True)
        self._thread.start()


def _publish_result(calibrator: Calibrator, path: Path, process: Process) -> None:
    """Write and announce the parameters; without any, report why."""
    if calibrator.result is not None:
        print(calibrator.result.summary())
    if calibrator.result is None or calibrator.failure:
        process.state, process.message = process_status_t.DEGRADED, calibrator.failure
        return
    parameters = calibrator.result.parameter_file({"log": "live"})
    _save(parameters, path)
    print(f"written to {path}", flush=True)
    announcement = parameters.announcement(sequence=now_utime())
    process.parameters_sha256 = announcement.sha256
    process.repeat(PARAMETERS, announcement, calibrator.robot_id, period=1.0)


def _draw(result: CalibrationResult, path: Path | None, notes: TextIO | None = None) -> None:
    if path is None:
        return
    try:
        result.plot().savefig(path)
    except (OSError, ValueError) as error:
        raise CommandError(f"{path}: cannot be drawn: {error}. Choose another place with --picture.") from error
    print(f"drawn in {path}", file=notes)


def _save(parameters: ParameterFile, path: Path) -> None:
    try:
        parameters.save(path)
    except OSError as error:
        raise CommandError(f"{path}: cannot be written: {error.strerror}. Choose another place with --out.") from error


def _say(robot_id: int, status: calibration_status_t, so_far: Mapping[str, Estimate], averages: int, said: str) -> str:
    """Print the status for each new state, tenth of coverage, and average; return what was printed."""
    kind = status.message if status.state == calibration_status_t.WAITING else ""
    saying = f"{status.state} {int(status.progress * 10)} {averages} {kind}"
    if saying != said:
        values_so_far = _so_far(so_far) if status.state == calibration_status_t.COLLECTING else ""
        print(f"robot {robot_id}: {100 * status.progress:3.0f} %  {status.message}{values_so_far}", flush=True)
    return saying


def _so_far(estimates: Mapping[str, Estimate]) -> str:
    """Return the estimates of an ongoing drive; empty without any."""
    values_so_far = [f"{name} {one.value:.4g} +- {one.std:.1g}" for name, one in estimates.items()]
    return f" So far: {', '.join(values_so_far)}." if values_so_far else ""

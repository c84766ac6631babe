"""cmr-investigate: a robot diagnoses the errors of its own simulation, on a small floor."""

import argparse
import json
import math
from collections.abc import Callable
from pathlib import Path

import lcm

from cmr.bus.messages import Received
from cmr.bus.preflight import check as check_bus
from cmr.cli.command_line import add_robot, check_writable, parser
from cmr.cli.configuration import parameter_file
from cmr.cli.errors import CommandError
from cmr.commands.first_use import BEHAVIOURS, ESTIMATOR, PARTS, WORLD, compile_first
from cmr.commands.investigating.emulated import add_emulated, drive_emulated
from cmr.commands.steering.steer import add_limits, geofence, margin, steer
from cmr.diagnosis.job import Job, JobError, perform
from cmr.diagnosis.result import Diagnosis
from cmr.files import write_atomically
from cmr.investigation.behaviour import CALIBRATION, DIAGNOSIS, Investigate
from cmr.investigation.driving import AtOnce, Driving, InThread, Planner
from cmr.investigation.engine import LONGEST
from cmr.investigation.floor import MARGIN
from cmr.investigation.telling import calibrated, document, line, sentences, story_page
from cmr.parameters.following import ParameterFollower
from cmr.world.pilot import Pilot

LOG, STORY, PAGE = "run.lcm", "investigation.json", "investigation.html"
NOT_DRIVEN = "Nothing was decided: the robot did not drive for long enough. {why}"
FLOOR = "-1,-1,1,-1,1,1,-1,1"
Say = Callable[[str], None]


def main(arguments: list[str]) -> int:
    """Run cmr-investigate.

    Raises CommandError where the robot cannot be investigated.
    """
    options = command_parser().parse_args(arguments)
    folder = options.out
    check_writable(folder)
    if (folder / LOG).exists():
        raise CommandError(f"{folder} holds a run already. Choose another folder with --out.")
    if not options.emulated and (options.settings or options.hide or options.ideal):
        raise CommandError("--settings, --ideal and --hide are for --emulated: a real robot is as it is.")
    if options.emulated and options.no_tracker:
        raise CommandError("--no-tracker is for a robot on the bus: an emulated one is always seen.")
    if not options.emulated:
        check_bus(options.lcm_url)  # report errors before anything takes time
    compile_first(PARTS if options.emulated else [WORLD, BEHAVIOURS, ESTIMATOR])
    folder.mkdir(parents=True, exist_ok=True)
    behaviour = _behaviour(options, AtOnce() if options.emulated else InThread())
    failure, code = "", 0
    try:
        if options.emulated:
            drive_emulated(options, behaviour, folder / LOG, _Lines(behaviour, _say).newest)
        else:
            code = _live(options, behaviour)
    except CommandError as error:
        failure = str(error)
    driving = behaviour.driving
    if driving is not None:
        driving.end()
    if driving is not None and driving.decision is not None:
        _write(driving, options, is_whole=not code)
    else:
        (folder / LOG).unlink(missing_ok=True)
        failure = failure or ("" if code else NOT_DRIVEN.format(why=behaviour.problem))
    if failure:
        raise CommandError(failure)
    return code


def _behaviour(options: argparse.Namespace, planner: Planner) -> Investigate:
    x, y = options.floor.outline
    floor = "/".join(f"{a:.9g}:{b:.9g}" for a, b in zip(x, y, strict=True))
    goal = CALIBRATION if options.calibrate else DIAGNOSIS
    return Investigate(floor, options.margin, options.longest, options.seed, goal, planner)


class _Lines:
    """Prints each new decision of an investigation, once."""

    def __init__(self, behaviour: Investigate, say: Say) -> None:
        self._behaviour, self._say, self._said = behaviour, say, 0

    def newest(self) -> str:
        """Return the newest decision in a line; print it, if it is new."""
        driving = self._behaviour.driving
        if driving is None:
            return ""
        text = line(driving)
        if len(driving.investigation.story) > self._said:
            self._said = len(driving.investigation.story)
            self._say(text)
        return driving.note or text


def _live(options: argparse.Namespace, behaviour: Investigate) -> int:
    """Investigate the robot on the bus."""
    pilot = Pilot(
        options.robot,
        behaviour,
        ParameterFollower(options.robot, options.parameters or parameter_file(options.robot)),
        geofence=None if options.no_tracker else options.floor,
        margin=0.5 * options.margin,
        keep_clear=options.keep_clear,
        kind=options.command,
        program="cmr-investigate",
    )
    lines = _Lines(behaviour, _say)
    log = lcm.EventLog(str(options.out / LOG), "w", overwrite=True)

    def hear(received: Received) -> None:
        log.write_event(received.message.utime, received.channel, received.message.encode())

    try:
        return steer(pilot, behaviour, options, program="cmr-investigate", hear=hear, tell=lines.newest)
    finally:
        log.close()


def _write(driving: Driving, options: argparse.Namespace, *, is_whole: bool) -> None:
    """Write the story, then the diagnosis of the drive if it is complete: parameters, document and report."""
    folder = options.out
    for sentence in sentences(driving):
        _say(sentence)
    _write_story(driving, options, None)
    if options.calibrate:
        path = folder / f"robot_{options.robot}.yaml"
        calibrated(driving, options.robot).save(path)
        _say(f"written: {path}")
        return
    if options.no_diagnosis or not is_whole:
        return
    nominal = driving.investigation.nominal
    job = Job(logs=(folder / LOG,), robot_id=options.robot, folder=folder, nominal=nominal)
    try:
        diagnosis, files = perform(job, lambda _sentence: None)
    except JobError as error:
        raise CommandError(f"The drive was not diagnosed: {error}") from error
    _say(f"The diagnosis of the whole drive: {diagnosis.sentence}")
    _write_story(driving, options, diagnosis)
    _say(f"written: {', '.join(map(str, files))}")


def _write_story(driving: Driving, options: argparse.Namespace, diagnosis: Diagnosis | None) -> None:
    """Write the story, with the diagnosis of the whole drive once that is made."""
    beyond = None if diagnosis is None else {
        "verdict": diagnosis.verdict,
        "sentence": diagnosis.sentence,
        "effects": [effect.name for effect in diagnosis.effects],
        "laws": [found.law.name for found in diagnosis.laws.found],
        "unexplained": diagnosis.unexplained.present,
    }  # fmt: skip
    story, page = options.out / STORY, options.out / PAGE
    write_atomically(json.dumps(_finite({**document(driving), "diagnosis": beyond}), indent=1) + "\n", story)
    write_atomically(story_page(driving, options.robot, diagnosis.sentence if diagnosis else ""), page)
    if diagnosis is None:
        _say(f"written: {story}, {page}")


def _finite(value: object) -> object:
    """Convert to JSON values: non-finite numbers become null."""
    if isinstance(value, dict):
        return {name: _finite(one) for name, one in value.items()}
    if isinstance(value, list):
        return [_finite(one) for one in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def _say(text: str) -> None:
    print(text, flush=True)


def command_parser() -> argparse.ArgumentParser:
    """Return the command line of cmr-investigate."""
    options = parser(
        "cmr-investigate",
        "Let a robot diagnose the errors of its simulation by itself. It drives short movements on a floor and "
        "chooses each one to answer what the data so far leave open, until every effect of the catalogue is named, "
        "excluded, or out of reach here. Writes investigation.json and investigation.html, the story of the "
        "experiment, then diagnosis.json, report.html and robot_N.yaml of the whole drive, and its log run.lcm. The "
        "robot's centre keeps inside the floor by a margin; it stops on ESTOP, at the border, and while poses are "
        "missing, as with cmr-pilot. Needs cmr-sim and cmr-driver; --emulated needs neither, and no hardware.",
        "cmr-investigate --robot 0 --floor=-1,-1,1,-1,1,1,-1,1 --out found\n"
        "  cmr-investigate --emulated --ideal --hide gyro_scale --out found",
    )
    add_robot(options)
    options.add_argument("--out", type=Path, required=True, metavar="DIR", help="folder for the results")
    _add_floor(options)
    options.add_argument(
        "--longest", type=float, default=LONGEST, metavar="S", help="end after this time of driving [s] (default: 60)"
    )
    options.add_argument("--seed", type=int, default=0, metavar="N", help="the same seed draws the same movements")
    options.add_argument("--parameters", type=Path, metavar="FILE", help="parameter file; otherwise robot_N.yaml")
    options.add_argument(
        "--calibrate",
        action="store_true",
        help="end when k1 and base_width are known within 1 %%, k2_over_k3 within 3 %%",
    )
    options.add_argument("--no-diagnosis", action="store_true", help="leave out the diagnosis of the whole drive")
    add_emulated(options)
    add_limits(options)
    return options


def _add_floor(options: argparse.ArgumentParser) -> None:
    """Add the options on the floor, and whether there are poses."""
    options.add_argument(
        "--floor",
        type=geofence,
        default=geofence(FLOOR),
        metavar="X1,Y1,X2,Y2,...",
        help=f"corners [m; world frame] of the polygon that the robot must not leave (default: {FLOOR})",
    )
    options.add_argument(
        "--margin", type=margin, default=MARGIN, metavar="M", help=f"distance from its border (default: {MARGIN:g} m)"
    )
    options.add_argument(
        "--no-tracker",
        action="store_true",
        help="nothing reports poses: put the robot down at the world's origin, facing along x; it drives by dead "
        "reckoning, and stays on the floor in spite of the uncertainty of its position. Without this option, it "
        "waits for poses",
    )

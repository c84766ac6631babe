"""cmr-tracker: poses of real robots from a motion capture system, as POSE_N."""

import argparse
import contextlib
import gc
import time
from pathlib import Path

from cmr.bus.messages import make
from cmr.bus.process import Process
from cmr.bus.streams import GYRO, MOTOR_FEEDBACK, POSE
from cmr.cli.command_line import parse_number, parser
from cmr.cli.errors import CommandError
from cmr.files import write_atomically
from cmr.msg import pose_xyt_t, process_status_t
from cmr.tracker.elsewhere import Elsewhere
from cmr.tracker.opening import open_source
from cmr.tracker.overheard import Overheard
from cmr.tracker.profile import EXAMPLE, Profile, ProfileError
from cmr.tracker.source import SourceError
from cmr.tracker.tracking import Placed, Tracking

NAME = "cmr-tracker"
RATE = 20.0  # Hz of everything but samples, which are processed at once
REPORT_PERIOD = 1.0  # s between two summaries
DEFAULT_PROFILE = Path("tracker.yaml")


def main(arguments: list[str]) -> int:
    """Run cmr-tracker."""
    options = command_parser().parse_args(arguments)
    if options.write_profile is not None:
        return _write_profile(options.write_profile)
    if not options.profile.exists():
        raise CommandError(
            f"There is no {options.profile}. 'cmr-tracker --write-profile {options.profile}' writes one to fill in."
        )
    try:
        profile = Profile.load(options.profile)
        source = open_source(profile.tracker)
    except (ProfileError, SourceError) as error:
        raise CommandError(str(error)) from error
    try:
        with Process(NAME, options.lcm_url) as process:
            with contextlib.closing(Overheard(process.bus)) as overheard:
                elsewhere = Elsewhere(overheard.robots, profile.robots)
                _run(process, _Publisher(process, Tracking(profile, source), elsewhere), options.seconds)
            return process.exit_code
    except SourceError as error:
        raise CommandError(str(error)) from error
    finally:
        source.close()


def command_parser() -> argparse.ArgumentParser:
    """Return the command line of cmr-tracker."""
    options = parser(
        NAME,
        "Publish poses of real robots from a motion capture system as POSE_N: OptiTrack (Motive 2 and 3), Qualisys, "
        "VRPN, and the systems that the package motioncapture reads, such as Vicon. A profile says where the tracker "
        "is and which body is which robot. Each pose has the time of its exposure. Poses of bodies that are lost, "
        "frozen, confused or have jumped are withheld; the status says which, why and for how long.",
        "cmr-tracker --write-profile tracker.yaml\n  cmr-tracker\n  cmr-tracker --profile hall.yaml",
    )
    options.add_argument(
        "--profile", type=Path, default=DEFAULT_PROFILE, metavar="FILE", help="profile (default: tracker.yaml)"
    )
    options.add_argument(
        "--write-profile", type=Path, metavar="FILE", help="write an example of a profile to fill in, and end"
    )
    options.add_argument("--seconds", type=_seconds, metavar="S", help="end after this time [s]")
    return options


def _seconds(text: str) -> float:
    return parse_number(text, f"{text!r} is not a number of seconds above 0", above=0.0, most=1e6)


def _write_profile(path: Path) -> int:
    if path.exists():
        raise CommandError(f"{path} is there already; it is not written over.")
    try:
        write_atomically(EXAMPLE, path)
    except OSError as error:
        raise CommandError(f"{path}: cannot be written: {error.strerror}") from error
    print(f"Wrote {path}. Fill in type, server, axes and robots, then run: {NAME} --profile {path}")
    return 0


def _run(process: Process, publisher: "_Publisher", seconds: float | None) -> None:
    """Publish what the tracker sees until a signal arrives or the time is over."""
    gc.collect()
    gc.freeze()  # else each full collection scans all imported modules, which delays poses by 20 ms
    began = time.monotonic()
    process.state = process_status_t.DEGRADED  # until the tracker sends
    for _utime in process.loop(RATE, publisher.wait):
        publisher.turn(time.monotonic())
        if seconds is not None and time.monotonic() - began >= seconds:
            return


class _Publisher:
    """Publishes poses as soon as a sample comes, and reports problems at once."""

    def __init__(self, process: Process, tracking: Tracking, elsewhere: Elsewhere) -> None:
        self._process, self._tracking, self._elsewhere = process, tracking, elsewhere
        self._summary = ""
        self._reported = time.monotonic()
        self._heard: set[int] = set()  # robots whose wheels and gyros are subscribed to
        self._troubled: frozenset[str] = frozenset()
        self._message = make(pose_xyt_t, utime=0, robot_id=0, x=0.0, y=0.0, theta=0.0)

    def wait(self, seconds: float) -> None:
        """Wait for a sample and publish its poses."""
        if not self._tracking.wait(seconds):
            return
        placed = self._tracking.read()
        for pose in placed if self._elsewhere.is_decided else []:
            if pose.robot_id not in self._elsewhere.yielded:
                self._publish(pose)
        if placed:
            self._tracking.note_latency()

    def turn(self, now: float) -> None:
        """Do everything else: subscribe to wheels, detect other programs' poses, and report."""
        self._process.dispatch(self._tracking.supervisor.handle)
        self._listen_to_wheels()
        self._elsewhere.look(now)
        if now - self._reported >= REPORT_PERIOD:
            self._summary = self._tracking.summary(now - self._reported)
            self._reported = now
        self._report(now)

    def _listen_to_wheels(self) -> None:
        """Subscribe to the wheels of robots that may have been confused; listening to all would take much of a core."""
        for robot_id in self._tracking.supervisor.in_doubt() - self._heard:
            self._heard.add(robot_id)
            self._process.subscribe(GYRO, robot_id, every=True)
            self._process.subscribe(MOTOR_FEEDBACK, robot_id, every=True)

    def _report(self, now: float) -> None:
        """Report problems in the status; a change is published at once."""
        process, elsewhere = self._process, self._elsewhere.problem()
        problem = f"{elsewhere} {self._tracking.problem(now)}".strip()
        process.state = process_status_t.DEGRADED if problem else process_status_t.RUNNING
        process.problem = f"{elsewhere} {self._tracking.headline()}".strip()
        process.message = f"{problem} {self._summary}".strip()
        if (troubled := self._tracking.troubled() | {elsewhere}) != self._troubled:
            self._troubled = troubled
            process.publish_status()

    def _publish(self, pose: Placed) -> None:
        message = self._message
        message.utime, message.robot_id = pose.utime, pose.robot_id
        message.x, message.y, message.theta = pose.x, pose.y, pose.theta
        self._process.publish(POSE, message, pose.robot_id)

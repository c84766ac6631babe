"""The parts of scripts/study_tracker in simulated time; each prints a table, and returns 1 if a limit is exceeded."""

import contextlib
import math
from collections.abc import Callable, Iterator, Sequence

import numpy as np

from cmr.bus.bus import Bus
from cmr.bus.messages import make
from cmr.bus.streams import POSE
from cmr.calibration import calibrate
from cmr.calibration.calibrate import PAPER
from cmr.estimation.estimates import INTERVAL
from cmr.msg import pose_xyt_t
from cmr.recordings.lags import lags_of
from cmr.recordings.recording import Recording
from cmr.tracker.tracking import Placed
from tests.reference_plant import NEUTRAL
from tests.support.private_bus import private_url
from tests.support.trackers.bench import KINDS, RATE, Bench, Score
from tests.support.trackers.drives import figure_eights, tracked
from tests.support.trackers.motion import Fault, faults

__all__ = ["KINDS", "drives", "misbehaviour"]
BODIES, FEW = 50, 10
NAMES = ("k2_over_k3", "k1", "base_width")
LATEST_RECOVERY, LATEST_REPORT, LARGEST_STAMP_ERROR = 1.0, 0.5, 0.001  # s
MOST_WITHHELD = 0.01  # share of good poses
MOST_OF_A_CORE = {BODIES: 0.5, FEW: 0.2}  # by number of robots
LATENESS = 0.002  # s


def misbehaviour(kinds: Sequence[str], seconds: float) -> int:
    """Run each misbehaviour with all bodies being robots, and a good tracker with all and with few robots."""
    print(
        "| tracker | misbehaviour | poses published | wrong | good withheld | all robots back after | silence reported "
        "after | largest timestamp error | share of a core | CPU time of a frame, 99 % |\n"
        f"{'|---' * 10}|",
        flush=True,
    )
    is_bad = False
    for kind in kinds:
        runs: list[tuple[Fault | None, int]] = [(fault, BODIES) for fault in faults()]
        for fault, robots in [(None, BODIES), (None, FEW), *runs]:
            with _bench(kind, robots) as bench:
                score = bench.run(seconds, fault)
            is_bad |= _row(kind, fault, robots, score, bench.spent)
    return int(is_bad)


@contextlib.contextmanager
def _bench(kind: str, robots: int) -> Iterator[Bench]:
    """Yield a tracker whose poses are published on a private bus."""
    bus = Bus(private_url())
    bench = Bench(kind, bodies=BODIES, robots=robots)
    bench.publish = _publisher(bus)
    try:
        bench.connect()
        yield bench
    finally:
        bench.close()


def _publisher(bus: Bus) -> Callable[[Placed], None]:
    message = make(pose_xyt_t, utime=0, robot_id=0, x=0.0, y=0.0, theta=0.0)

    def publish(placed: Placed) -> None:
        message.utime, message.robot_id = placed.utime, placed.robot_id
        message.x, message.y, message.theta = placed.x, placed.y, placed.theta
        bus.publish(POSE, message, placed.robot_id)

    return publish


def _row(kind: str, fault: Fault | None, robots: int, score: Score, spent: list[float]) -> bool:
    """Print a row; return whether it exceeds a limit."""
    stamp = max(map(abs, score.stamp_errors), default=math.inf)
    share = float(np.mean(spent)) * RATE
    name = fault.name if fault is not None else f"none, {robots} of {BODIES} are robots"
    back = f"{score.recovery:.2f} s" if fault is not None else ""
    reported = "" if score.reported_after is None else f"{score.reported_after:.2f} s"
    print(
        f"| {kind} | {name} | {score.published} | {score.wrong} | {100.0 * score.share_withheld:.2f} % | {back} | "
        f"{reported} | {stamp * 1e3:.2f} ms | {100.0 * share:.0f} % | {np.quantile(spent, 0.99) * 1e3:.2f} ms |",
        flush=True,
    )
    is_late = fault is not None and score.recovery > LATEST_RECOVERY
    is_unreported = score.reported_after is not None and score.reported_after > LATEST_REPORT
    is_slow = share > MOST_OF_A_CORE[robots]
    too_few = score.share_withheld > MOST_WITHHELD
    return score.wrong > 0 or too_few or is_late or is_unreported or stamp > LARGEST_STAMP_ERROR or is_slow


def drives(kinds: Sequence[str], robots: int) -> int:
    """Calibrate figure-eights of tracked robots; print how many intervals contain the true values."""
    print(
        "| tracker | robots | 95 % intervals that contain the true value | largest timestamp error | largest lateness "
        "estimated from the recordings |\n|---|---|---|---|---|"
    )
    is_bad = False
    driven = figure_eights(robots)
    for kind in kinds:
        recordings, stamp = tracked(kind, driven)
        covered = [_covers_truth(recording) for recording in recordings]
        late = [_lateness(recording) for recording in recordings]
        share = float(np.mean(covered))
        print(
            f"| {kind} | {robots} | {100.0 * share:.1f} % of {3 * robots} | {stamp * 1e3:.2f} ms | "
            f"{max(map(abs, late)) * 1e3:.2f} ms |",
            flush=True,
        )
        is_bad |= share < 0.92 or max(map(abs, late)) > LATENESS
    return int(is_bad)


def _covers_truth(recording: Recording) -> list[bool]:
    """Return whether the interval of each parameter contains the true value."""
    estimates = calibrate(recording, method=PAPER).estimates
    return [
        abs(estimates[name].value - float(getattr(NEUTRAL, name))) < INTERVAL * estimates[name].std for name in NAMES
    ]


def _lateness(recording: Recording) -> float:
    """Return the lateness of the poses as estimated from a recording [s]."""
    return next(lag.seconds for lag in lags_of(recording) if lag.sensor == "poses")

"""Figure-eights of the reference plant, all at once, recorded with the poses that cmr.tracker makes of a tracker's."""

from dataclasses import replace

import numpy as np

from cmr.recordings.recording import Recording
from cmr.recordings.signal import Floats, Signal
from tests.reference_plant import REALISTIC, Drive, drive, packets
from tests.reference_plant.drives import START_UTIME
from tests.reference_plant.manoeuvres import figure_eight
from tests.support.trackers.bench import DAY, Bench
from tests.support.trackers.frame import Body

SECONDS, LAPS = 40.0, 1
SPEEDS = (0.25, 0.35)  # m/s
RATE = 100  # Hz, of the plant's truth and of the tracker
NOISE, TURN_NOISE = 0.0005, 0.002  # m, rad
APART = 8.0  # m between the robots' beginnings


def figure_eights(robots: int, seed: int = 0) -> list[Drive]:
    """Return a figure-eight of each robot, each at a speed of its own."""
    random = np.random.default_rng(seed)
    drives = []
    for number in range(robots):
        commands = packets(figure_eight(SECONDS, LAPS, float(random.uniform(*SPEEDS))), SECONDS)
        start = (APART * number, 0.0, 0.0)
        drives.append(drive(commands, {}, SECONDS, REALISTIC, seed * 1000 + number, start=start))
    return drives


def tracked(kind: str, drives: list[Drive], seed: int = 0) -> "tuple[list[Recording], float]":
    """Return the recordings with the poses that came through an emulated tracker, and the largest error of a stamp [s].

    All robots are tracked by one tracker, 100 times a second.
    """
    truth = np.array([[one.truth[name] for name in ("x", "y", "theta")] for one in drives])  # (robots, 3, n)
    random = np.random.default_rng(seed)
    noise = random.normal(0.0, 1.0, truth.shape) * np.array([[NOISE], [NOISE], [TURN_NOISE]])
    bench = Bench(kind, bodies=len(drives), rate=RATE, seed=seed, has_gyros=False)
    try:
        bench.connect()
        rest = bench.now + 0.01
        for k in range(2 * RATE):  # until poses are believed
            bench.send(k, rest + k / RATE, _bodies(truth[:, :, 0], random))
        bench.placed.clear()
        begin = rest + 2.0
        for k in range(truth.shape[2]):
            bench.send(2 * RATE + k, begin + k / RATE, _bodies(truth[:, :, k], noise=noise[:, :, k]))
    finally:
        bench.close()
    errors = 0.0
    rows: list[list[tuple[int, float, float, float]]] = [[] for _ in drives]
    for placed in bench.placed:
        t = placed.utime / 1e6 - DAY - begin
        errors = max(errors, abs(t - round(t * RATE) / RATE))
        rows[placed.robot_id].append((START_UTIME + round(t * 1e6), placed.x, placed.y, placed.theta))
    return [replace(one.recording, poses=_signal(poses)) for one, poses in zip(drives, rows, strict=True)], errors


def _signal(rows: "list[tuple[int, float, float, float]]") -> Signal:
    utime, x, y, theta = zip(*rows, strict=True)
    return Signal(np.array(utime, np.int64), {"x": np.array(x), "y": np.array(y), "theta": np.array(theta)})


def _bodies(poses: Floats, random: "np.random.Generator | None" = None, noise: "Floats | float" = 0.0) -> list[Body]:
    """Return bodies at these poses (robots, 3)."""
    if random is not None:
        noise = random.normal(0.0, NOISE, poses.shape)
    return [Body(f"robot_{number}", *pose) for number, pose in enumerate((poses + noise).tolist())]

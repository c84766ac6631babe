"""Rows of drives in simulated time: pilot, driver, serial line, emulated robot, for each set of hardware."""

import tempfile
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

from benchmarks.report import Row
from robot_driver.simulated.drive import SimulatedDrive

HARDWARE = {  # (controller, gyro), messages of the gyro per second
    "RoboClaw, DSP-3000": (("roboclaw", "dsp3000"), 100),
    "RoboClaw, KVH 1750": (("roboclaw", "kvh-binary"), 1000),
    "Roboteq, DSP-3000": (("roboteq", "dsp3000"), 100),
    "Roboteq, KVH 1750": (("roboteq", "kvh-binary"), 1000),
    "MBot board": (("mbot", None), 220),
}
SECONDS, WARM_UP = 20.0, 0.5  # s of simulated time
REPETITIONS = 3
LEAST = 10.0  # simulated seconds per CPU second


def chain() -> Iterator[Row]:
    """Measure the speed of the whole chain relative to real time, in CPU time."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "drive.lcm"
        SimulatedDrive(seconds=WARM_UP).write_log(path)
        for name, ((controller, gyro), rate) in HARDWARE.items():
            drive = SimulatedDrive(controller=controller, gyro=gyro, seconds=SECONDS)
            fastest, *_, slowest = sorted(_cpu(replace(drive, seed=seed), path) for seed in range(REPETITIONS))
            yield Row(
                f"driver and emulated robot in simulated time: {name}, {rate:,} gyro messages a second",
                f"{slowest / SECONDS * 1e3:.0f} to {fastest / SECONDS * 1e3:.0f} ms of CPU time for a second",
                f"{SECONDS / slowest:.1f} to {SECONDS / fastest:.1f} times as fast as real time",
                f"{LEAST:g} times",
                SECONDS / fastest >= LEAST,
            )


def _cpu(drive: SimulatedDrive, path: Path) -> float:
    before = time.process_time()
    drive.write_log(path)
    return time.process_time() - before

"""Rows of the peers: the steps of other simulators and of CMR, measured alternately in the same run.

Peers are not dependencies: `install` creates .venv-bench for them, and each runs in a process of its own.
"""

import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import ExitStack
from pathlib import Path
from types import TracebackType
from typing import NamedTuple

from benchmarks.contacts import SERIES, Crowd
from benchmarks.report import Point, Row, per_robot
from benchmarks.stepping import fleet_of, robots
from benchmarks.timing import Clocked, Timing, clocked, in_turns

ROOT = Path(__file__).resolve().parents[2]
ENVIRONMENT = ROOT / ".venv-bench"
# This file of torch is the CPU-only build; others include gigabytes of CUDA.
PACKAGES = (("torch==2.13.0",), ("mujoco", "ir-sim", "vmas"))
WORKER = "benchmarks.peer_worker"
DISK = 4e9  # bytes while installing
REPETITIONS = 5
MANY = 100.0  # ratio above which decimals are meaningless
ROBOTS = (10, 100, 1_000, 10_000)
STEP, CONTACTS = "CMR, no contacts", SERIES  # CMR's series with which peers are compared


class Comparison(NamedTuple):
    """A peer, CMR's equivalent series, and the ratios of their times to reach, by number of robots."""

    title: str
    ours: str
    series: str
    most_robots: int
    goals: Mapping[int, int]


COMPARISONS = {
    "mujoco": Comparison("MuJoCo, planar bodies without contacts", STEP, "MuJoCo, no contacts", 10_000, {1_000: 50}),
    "mujoco_contacts": Comparison(
        "MuJoCo, planar bodies with contacts", CONTACTS, "MuJoCo, contacts", 10_000, dict.fromkeys(ROBOTS[1:], 6)
    ),
    "irsim": Comparison("ir-sim, without sensors and collisions", STEP, "ir-sim", 1_000, {1_000: 10_000}),
    "vmas": Comparison("VMAS, agents without collisions", STEP, "VMAS", 1_000, {1_000: 20_000}),
}


class Peer:
    """A peer's world in a process of its own; a context manager.

    `version` is that of its package, `contacts` the number of contacts in its last step.
    """

    def __init__(self, name: str, count: int) -> None:
        self.contacts = 0
        python = str(ENVIRONMENT / "bin" / "python")
        self._command = ["env", f"PYTHONPATH={ROOT / 'scripts'}", python, "-m", WORKER, name, str(count)]

    def __enter__(self) -> "Peer":
        self._folder = tempfile.TemporaryDirectory()  # some peers write logs into their working directory
        self._process = subprocess.Popen(
            self._command,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            text=True,
            cwd=self._folder.name,
            env=os.environ | {"OMP_NUM_THREADS": "1", "MPLBACKEND": "agg"},
        )
        self.version = self._answer()
        return self

    def __exit__(
        self, _kind: type[BaseException] | None, _error: BaseException | None, _trace: TracebackType | None
    ) -> None:
        self._process.kill()
        self._process.communicate()
        self._folder.cleanup()

    def run(self, steps: int) -> float:
        """Make `steps` steps; return their CPU seconds."""
        assert self._process.stdin is not None
        print(steps, file=self._process.stdin, flush=True)
        seconds, contacts = self._answer().split()
        self.contacts = int(contacts)
        return float(seconds)

    def _answer(self) -> str:
        assert self._process.stdout is not None
        line = self._process.stdout.readline().strip()
        if not line:
            raise RuntimeError(f"{' '.join(self._command)} ended; run it by hand to see why")
        return line


def install() -> None:
    """Create the environment of the peers, unless it exists: 1.4 GB, some minutes.

    Raises RuntimeError if the disk is too full, subprocess.CalledProcessError if pip fails.
    """
    done = ENVIRONMENT / "installed"
    if done.exists():
        return
    if shutil.disk_usage(ROOT).free < DISK:
        raise RuntimeError(f"installing the peers needs {DISK / 1e9:g} GB of free disk space")
    print(f"Installing MuJoCo, ir-sim and VMAS into {ENVIRONMENT} (1.4 GB) ...", file=sys.stderr, flush=True)
    subprocess.run([sys.executable, "-m", "venv", str(ENVIRONMENT)], check=True)
    for packages in PACKAGES:
        subprocess.run([str(ENVIRONMENT / "bin" / "pip"), "install", "--quiet", *packages], check=True)
    done.touch()


def peers() -> Iterator[Row]:
    """Measure the steps of N robots, with and without contacts, alternating with those of the peers."""
    install()
    for count in ROBOTS:
        with ExitStack() as stack:
            worlds = {
                name: stack.enter_context(Peer(name, count))
                for name, comparison in COMPARISONS.items()
                if count <= comparison.most_robots
            }
            ours, works = _ours(count)
            timings = in_turns(works | {name: world.run for name, world in worlds.items()}, REPETITIONS)
        for work in works:
            touching = f", {ours.touching()} pairs touching" if work == CONTACTS else ""
            point = Point(work, count, timings[work].median)
            yield Row(f"{work}, {count:,} robots{touching}", per_robot(timings[work], count), point=point)
        for name, world in worlds.items():
            yield _compared(COMPARISONS[name], count, world, timings[name], timings[COMPARISONS[name].ours])


def _ours(count: int) -> tuple[Crowd, dict[str, Clocked]]:
    """Return the crowd with contacts, and CMR's timed functions for `count` robots."""
    crowd, fleet = Crowd(count), fleet_of(*robots(count))
    return crowd, {STEP: clocked(fleet.advance), CONTACTS: clocked(crowd.advance)}


def _compared(comparison: Comparison, count: int, world: Peer, timing: Timing, ours: Timing) -> Row:
    """Return the row of a peer, with the ratio to CMR's time."""
    ratio, goal = timing.median / ours.median, comparison.goals.get(count)
    touching = f", {world.contacts} pairs touching" if world.contacts else ""
    return Row(
        f"{comparison.title}, {count:,} robots{touching} (version {world.version})",
        per_robot(timing, count),
        f"{ratio:,.1f} times CMR's" if ratio < MANY else f"{ratio:,.0f} times CMR's",
        f"{goal:,} times" if goal else "-",
        ratio >= goal if goal else None,
        Point(comparison.series, count, timing.median),
    )

"""Rows of the peers: other simulators, step against step in the same run, each in an environment of its own.

They are not dependencies: `install` makes .venv-bench for them, and each runs in a process of its own.
"""

import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path
from types import TracebackType

from benchmarks.report import Row, per_robot
from benchmarks.stepping import fleet_of, robots
from benchmarks.timing import clocked, in_turns

ROOT = Path(__file__).resolve().parents[2]
ENVIRONMENT = ROOT / ".venv-bench"
WORKER = Path(__file__).with_name("peer_worker.py")
# This very file of torch is for CPUs alone; others bring gigabytes of CUDA along.
PACKAGES = (("torch==2.13.0",), ("mujoco", "ir-sim", "vmas"))
DISK = 4e9  # bytes while installing
ROBOTS = (10, 100, 1_000)
REPETITIONS = 5
# Of a peer's time to ours at the largest number of robots, and the peer's name.
PEERS = {
    "mujoco": ("MuJoCo, planar bodies without contacts", 50),
    "irsim": ("ir-sim, without sensors and collisions", 10_000),
    "vmas": ("VMAS, agents without collisions", 20_000),
}


class Peer:
    """One peer's world in a process of its own; use it as a context manager. `version` is its package's."""

    def __init__(self, name: str, count: int) -> None:
        self._command = [str(ENVIRONMENT / "bin" / "python"), str(WORKER), name, str(count)]

    def __enter__(self) -> "Peer":
        self._folder = tempfile.TemporaryDirectory()  # some write logs where they run
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
        """Let so many steps pass; return the CPU seconds they took."""
        assert self._process.stdin is not None
        print(steps, file=self._process.stdin, flush=True)
        return float(self._answer())

    def _answer(self) -> str:
        assert self._process.stdout is not None
        line = self._process.stdout.readline().strip()
        if not line:
            raise RuntimeError(f"{' '.join(self._command)} ended; run it by hand to see why")
        return line


def install() -> None:
    """Make the environment with the peers, unless it is there: 1.4 GB, some minutes.

    Raises RuntimeError where the disk is too full, subprocess.CalledProcessError where pip fails.
    """
    done = ENVIRONMENT / "installed"
    if done.exists():
        return
    if shutil.disk_usage(ROOT).free < DISK:
        raise RuntimeError(f"the peers take {DISK / 1e9:g} GB of disk while they are installed, and there is less")
    print(f"Installing MuJoCo, ir-sim and VMAS into {ENVIRONMENT} (1.4 GB) ...", file=sys.stderr, flush=True)
    subprocess.run([sys.executable, "-m", "venv", str(ENVIRONMENT)], check=True)
    for packages in PACKAGES:
        subprocess.run([str(ENVIRONMENT / "bin" / "pip"), "install", "--quiet", *packages], check=True)
    done.touch()


def peers() -> Iterator[Row]:
    """Measure the step of N robots in turns with those of the peers."""
    install()
    for count in ROBOTS:
        with ExitStack() as stack:
            worlds = {name: stack.enter_context(Peer(name, count)) for name in PEERS}
            fleet = fleet_of(*robots(count))
            works = {"ours": clocked(fleet.advance)} | {name: world.run for name, world in worlds.items()}
            timings = in_turns(works, REPETITIONS)
            versions = {name: world.version for name, world in worlds.items()}
        for name, (title, goal) in PEERS.items():
            ratio = timings[name].median / timings["ours"].median
            asked = count == ROBOTS[-1]
            yield Row(
                f"{title}, {count:,} robots (version {versions[name]})",
                per_robot(timings[name], count),
                f"{ratio:,.0f} times ours, {per_robot(timings['ours'], count)}",
                f"{goal:,} times" if asked else "-",
                ratio >= goal if asked else None,
            )

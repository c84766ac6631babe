"""cmr-tracker beside an emulated tracker, each in a process of its own, in real time."""

import math
import multiprocessing
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from multiprocessing.connection import Connection
from pathlib import Path

import numpy as np

from cmr.bus.preflight import handled, open_lcm
from cmr.bus.streams import POSE
from cmr.bus.wire import utime_of
from tests.support.private_bus import private_url
from tests.support.trackers.bench import RATE, server_of
from tests.support.trackers.frame import Emitted
from tests.support.trackers.motion import Robots, measured

BODIES, FEW = 50, 10
PROCESSING = 0.004  # s from the exposure to sending
STARTED = 4.0  # s until cmr-tracker surely knows the clock and has believed all robots
COMMAND = "import sys; from cmr.tracker.command import main; sys.exit(main(sys.argv[1:]))"


def live(kinds: Sequence[str], seconds: float) -> int:
    """Run cmr-tracker beside an emulated tracker, with few and with all bodies robots, and print what was seen."""
    print("| tracker | robots | poses | largest error of a stamp | latency, 99 % | of a core |")
    print("|---|---|---|---|---|---|")
    for kind in kinds:
        for robots in (FEW, BODIES):
            print(watch(kind, robots, BODIES, RATE, seconds), flush=True)
    return 0


def watch(kind: str, robots: int, bodies: int, rate: float, seconds: float) -> str:
    """Return a row on poses on the bus: stamps compared with exposures, latency, and what cmr-tracker takes."""
    ours, theirs = multiprocessing.get_context("spawn").Pipe()
    emulator = multiprocessing.get_context("spawn").Process(target=_emulate, args=(theirs, kind, bodies, rate))
    emulator.start()
    url = private_url()
    with tempfile.TemporaryDirectory() as folder:
        profile = _written(Path(folder), kind, robots, ours.recv())
        command = [sys.executable, "-c", COMMAND, "--quiet", "--lcm-url", url, "--profile", str(profile)]
        process = subprocess.Popen(command)
        try:
            heard, share = _heard(url, process.pid, seconds)
        finally:
            process.terminate()
            process.wait()
            ours.send("end")
            sent = ours.recv()
            emulator.join()
    return _row(kind, f"{robots} of {bodies}", heard, sent, share)


def _emulate(pipe: Connection, kind: str, bodies: int, rate: float) -> None:
    """Send frames in real time until told to end; then return when each was exposed and sent [s, time of the day]."""
    server, robots, random = server_of(kind), Robots(bodies), np.random.default_rng(0)
    pipe.send(server.port)
    server.names = [f"robot_{k}" for k in range(bodies)]
    sent: list[tuple[float, float]] = []
    due, number = time.time(), 0
    while not pipe.poll():
        due = max(due + 1.0 / rate, time.time() - 0.1)
        exposed = due - PROCESSING
        content = measured(robots, exposed, random)
        while (rest := due - time.time()) > 0.0:
            time.sleep(rest)
        now = time.time()
        number += 1
        server.send(Emitted(number, exposed, now, content))
        sent.append((exposed, now))
    server.close()
    pipe.send(sent)


def _written(folder: Path, kind: str, robots: int, port: int) -> Path:
    lag = 0.0 if kind == "optitrack" else PROCESSING
    path = folder / "tracker.yaml"
    path.write_text(
        f"schema: 1\ntracker: {{type: {kind}, server: 127.0.0.1, local: 127.0.0.1, port: {port}, lag: {lag}}}\n"
        "robots:\n" + "".join(f"  {k}: {{body: robot_{k}}}\n" for k in range(robots))
    )
    return path


def _heard(url: str, pid: int, seconds: float) -> "tuple[list[tuple[int, float]], float]":
    """Return stamp [us] and arrival [s] of the poses, and what the process takes of a core.

    Poses are decoded later, so that the arrival of one does not contain the decoding of those before it.
    """
    bus = open_lcm(url)
    heard: list[tuple[float, bytes]] = []
    bus.subscribe(POSE.pattern, lambda _channel, data: heard.append((time.time(), data))).set_queue_capacity(0)
    end, begin, used = time.monotonic() + STARTED + seconds, 0.0, 0.0
    while (now := time.monotonic()) < end:
        handled(bus, 50)
        if not begin and now > end - seconds:
            begin, used = now, _used(pid)
            heard.clear()
    share = (_used(pid) - used) / (now - begin)
    return [(utime_of(data), arrived) for arrived, data in heard], share


def _used(pid: int) -> float:
    """Return what a process has used of cores [s]."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def _row(
    kind: str, robots: str, heard: "list[tuple[int, float]]", sent: "list[tuple[float, float]]", share: float
) -> str:
    if not heard:
        return f"| {kind} | {robots} | 0 | | | {100.0 * share:.0f} % |"
    exposures = np.array([exposed for exposed, _ in sent])
    stamps = np.array([utime / 1e6 for utime, _ in heard])
    nearest = np.clip(np.searchsorted(exposures, stamps), 1, len(exposures) - 1)
    nearest -= stamps - exposures[nearest - 1] < exposures[nearest] - stamps
    stamp_error = float(np.abs(stamps - exposures[nearest]).max())
    late = np.array([arrived for _, arrived in heard]) - np.array([when for _, when in sent])[nearest]
    latency = float(np.quantile(late, 0.99)) if len(late) else math.nan
    return (
        f"| {kind} | {robots} | {len(heard)} | {stamp_error * 1e3:.2f} ms | {latency * 1e3:.2f} ms | "
        f"{100.0 * share:.0f} % |"
    )

"""Measure the latency of cmr-tracker with an emulated tracker, each in a process of its own, in real time.

The latency is the time from the emulator's system call that sends a frame to the time at which the kernel receives
each of its poses for a subscriber. It includes neither the time in which the emulator assembles a frame, nor the time
in which this process reads 50 poses in Python.
"""

import contextlib
import multiprocessing
import os
import re
import socket
import struct
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from multiprocessing.connection import Connection
from pathlib import Path
from typing import NamedTuple

import numpy as np

from cmr.bus.streams import POSE
from cmr.bus.wire import utime_of
from cmr.tracker.overheard import LARGEST, joined, split
from tests.support.private_bus import private_url
from tests.support.trackers.bench import RATE, server_of
from tests.support.trackers.frame import Emitted
from tests.support.trackers.motion import Robots, measured

BODIES, FEW = 50, 10
PROCESSING = 0.004  # s from exposure to sending
START_UP = 4.0  # s until cmr-tracker has certainly estimated the clock and accepted all robots
SO_TIMESTAMPNS = 35  # socket option: the kernel's time of day when a packet arrives, as two int64: s, ns
STAMP = struct.Struct("=qq")
BUFFER = 1 << 22  # bytes of the socket's receive buffer
COMMAND = "import sys; from cmr.tracker.command import main; sys.exit(main(sys.argv[1:]))"


class ReceivedPose(NamedTuple):
    """A pose on the bus: its timestamp [us], and the times at which kernel and this process received it [s]."""

    utime: int
    received: float
    read: float


def live(kinds: Sequence[str], seconds: float) -> int:
    """Run cmr-tracker with an emulated tracker, once with few and once with all bodies being robots; print a table."""
    print(
        "| tracker | robots | poses | largest timestamp error | latency, median | 99 % | until read, 99 % "
        f"| share of a core |\n{'|---' * 8}|"
    )
    for kind in kinds:
        for robots in (FEW, BODIES):
            print(measure(kind, robots, BODIES, RATE, seconds), flush=True)
    return 0


def measure(kind: str, robots: int, bodies: int, rate: float, seconds: float) -> str:
    """Return a row of the table: errors of timestamps, latency, and the CPU load of cmr-tracker."""
    ours, theirs = multiprocessing.get_context("spawn").Pipe()
    emulator = multiprocessing.get_context("spawn").Process(target=_emulate, args=(theirs, kind, bodies, rate))
    emulator.start()
    url = private_url()
    with tempfile.TemporaryDirectory() as folder:
        profile = _write_profile(Path(folder), kind, robots, ours.recv())
        command = [sys.executable, "-c", COMMAND, "--quiet", "--lcm-url", url, "--profile", str(profile)]
        process = subprocess.Popen(command)
        try:
            poses, share = _receive_poses(url, process.pid, seconds)
        finally:
            process.terminate()
            process.wait()
            ours.send("end")
            sent = ours.recv()
            emulator.join()
    return _row(kind, f"{robots} of {bodies}", poses, sent, share)


def _emulate(pipe: Connection, kind: str, bodies: int, rate: float) -> None:
    """Send frames in real time until a message arrives; then send back exposure and sending times [s, time of day]."""
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
        number += 1
        server.send(Emitted(number, exposed, time.time(), content))
        sent.append((exposed, server.handed_over))
    server.close()
    pipe.send(sent)


def _write_profile(folder: Path, kind: str, robots: int, port: int) -> Path:
    lag = 0.0 if kind == "optitrack" else PROCESSING
    path = folder / "tracker.yaml"
    path.write_text(
        f"schema: 1\ntracker: {{type: {kind}, server: 127.0.0.1, local: 127.0.0.1, port: {port}, lag: {lag}}}\n"
        "robots:\n" + "".join(f"  {k}: {{body: robot_{k}}}\n" for k in range(robots))
    )
    return path


def _receive_poses(url: str, pid: int, seconds: float) -> tuple[list[ReceivedPose], float]:
    """Return the poses on the bus, and the share of a core that the process uses."""
    bus = joined(url)
    bus.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, BUFFER)
    bus.setsockopt(socket.SOL_SOCKET, SO_TIMESTAMPNS, 1)
    bus.settimeout(0.05)
    packets: list[tuple[bytes, bytes, float]] = []
    end, begin, cpu = time.monotonic() + START_UP + seconds, 0.0, 0.0
    while (now := time.monotonic()) < end:
        with contextlib.suppress(TimeoutError):
            packet, ((_, _, stamp),), _, _ = bus.recvmsg(LARGEST, socket.CMSG_SPACE(STAMP.size))
            packets.append((packet, stamp, time.time()))
        if not begin and now > end - seconds:
            begin, cpu = now, _cpu_time(pid)
            packets.clear()
    share = (_cpu_time(pid) - cpu) / (now - begin)
    bus.close()
    return [pose for received in packets if (pose := _pose(*received)) is not None], share


def _pose(packet: bytes, stamp: bytes, read: float) -> ReceivedPose | None:
    """Return the pose in a packet; None for other messages."""
    message = split(packet)
    if message is None or re.fullmatch(POSE.pattern, message[0]) is None:
        return None
    seconds, nanoseconds = STAMP.unpack(stamp)
    return ReceivedPose(utime_of(message[1]), seconds + nanoseconds / 1e9, read)


def _cpu_time(pid: int) -> float:
    """Return the CPU time of a process [s]."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def _row(kind: str, robots: str, poses: list[ReceivedPose], sent: "list[tuple[float, float]]", share: float) -> str:
    if not poses:
        return f"| {kind} | {robots} | 0 | | | | | {100.0 * share:.0f} % |"
    exposures, handed_over = np.array(sent).T
    stamps, received, read = np.array(poses).T
    stamps /= 1e6
    nearest = np.clip(np.searchsorted(exposures, stamps), 1, len(exposures) - 1)
    nearest -= stamps - exposures[nearest - 1] < exposures[nearest] - stamps
    stamp_error = float(np.abs(stamps - exposures[nearest]).max())
    median, most = np.quantile(received - handed_over[nearest], [0.5, 0.99])
    until_read = np.quantile(read - handed_over[nearest], 0.99)
    times = " | ".join(f"{seconds * 1e3:.2f} ms" for seconds in (stamp_error, median, most, until_read))
    return f"| {kind} | {robots} | {len(poses)} | {times} | {100.0 * share:.0f} % |"

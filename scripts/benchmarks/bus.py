"""Rows of WORLD_STATE on the bus: how much is lost between two processes at 100 Hz."""

import os
import statistics
import subprocess
import sys
import time
from collections.abc import Iterator

import numpy as np

from benchmarks.report import Row
from cmr.bus.bus import Bus
from cmr.bus.messages import now_utime
from cmr.bus.streams import WORLD_STATE
from cmr.model.motion import RobotState
from cmr.world.view import VIRTUAL, Robots, world_messages
from tests.support.private_bus import private_url

RATE = 100.0  # Hz
SECONDS = 10.0
LINGER = 1.0  # s after the last message was sent, after which missing messages count as lost
# Robots, receive buffer [bytes] (None: the system's own).
CASES = ((1_000, None), (20_000, 4_194_304))


def world_state() -> Iterator[Row]:
    """Measure how many messages are lost, and the latency of the others, for each case."""
    for robots, buffer in CASES:
        url = private_url().partition("&recv_buf_size")[0] + (f"&recv_buf_size={buffer}" if buffer else "")
        sent, ages = _send_and_receive(url, robots)
        lost = sent - len(ages)
        size = f"{buffer // 1_048_576} MB" if buffer else "stock"
        work = f"WORLD_STATE of {robots:,} robots at {RATE:.0f} Hz for {SECONDS:.0f} s, {size} socket buffers"
        late = f"median {statistics.median(ages) * 1e-3:.2f} ms" if ages else "none arrived"
        yield Row(work, f"{lost} of {sent} lost; latency: {late}", "-", "none lost", lost == 0)


def _send_and_receive(url: str, robots: int) -> tuple[int, list[int]]:
    """Return how many messages another process sent, and the latency of each that arrived [us]."""
    bus = Bus(url)
    bus.subscribe(WORLD_STATE, every=True)
    count = int(RATE * SECONDS)
    command = [sys.executable, "-m", "benchmarks.bus", url, str(robots), str(count)]
    ages: list[int] = []
    with subprocess.Popen(command, env=os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)}) as sender:
        ended = None
        while ended is None or time.monotonic() < ended + LINGER:
            ages += [now_utime() - received.message.utime for received in bus.receive(0.05)]
            if ended is None and sender.poll() is not None:
                ended = time.monotonic()
        if sender.returncode:
            raise RuntimeError("the sender failed; its output is above")
    return count, ages


def send(url: str, robots: int, count: int) -> None:
    """Send `count` messages of `robots` robots at RATE, with the time of sending as timestamp."""
    os.sched_setaffinity(0, range(os.cpu_count() or 1))  # the receiver is pinned to one core, the sender is not
    bus = Bus(url)
    columns = np.random.default_rng(0).standard_normal((len(RobotState._fields), robots))
    world = Robots(tuple(range(robots)), (VIRTUAL,) * robots, RobotState(*columns))
    began = time.monotonic()
    for number in range(count):
        time.sleep(max(began + number / RATE - time.monotonic(), 0.0))
        (message,) = world_messages(now_utime(), world)
        bus.publish(WORLD_STATE, message)
    if bus.unsent:
        raise RuntimeError(f"not sent: {dict(bus.unsent)}")


if __name__ == "__main__":
    send(sys.argv[1], int(sys.argv[2]), int(sys.argv[3]))

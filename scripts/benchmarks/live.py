"""Rows of cmr-sim in normal use: a process on the bus, 100 steps and 100 WORLD_STATE messages a second."""

import math
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

from benchmarks.drive import NOMINAL
from benchmarks.processes import processor_time
from benchmarks.report import Point, Row
from cmr.bus.bus import Bus
from cmr.bus.streams import WORLD_STATE
from tests.support.private_bus import private_url

RATE = 100.0  # Hz, of steps and of WORLD_STATE
GOALS = {100: 0.025, 1_000: 0.04, 10_000: 0.12}  # shares of a core, by the number of robots
SHORTEST_LAP = 10.0  # s; a robot drives a figure-eight in 14 s
SPACING = 3.0  # m between robots, whose figure-eights are 1.4 m long
WARM_UP, SECONDS = 2.0, 10.0  # from the first motion on
SCRIPTS = Path(__file__).resolve().parents[1]
BARE_LOOP = """
import sys, time
import lcm
import numpy as np
from cmr.bus.messages import now_utime
from cmr.bus.world_state import WorldState
from cmr.model.fleet import Fleet
from cmr.model.motion import RobotState
from cmr.world.interaction.neighbours import pairs_within
from benchmarks.drive import NOMINAL

count, period = int(sys.argv[1]), 1.0 / float(sys.argv[2])
place = np.arange(count) % 100 * 3.0, np.arange(count) // 100 * 3.0
bus, robots = lcm.LCM(), Fleet(period)
robots.add(RobotState.at_rest(*place, np.zeros(count)), NOMINAL.robot_parameters)
robots.command(slice(count), 0.5, 0.4)
ids, origins, due = tuple(range(count)), (1,) * count, time.monotonic()
while True:
    due += period
    time.sleep(max(due - time.monotonic(), 0.0))
    robots.advance()
    states = robots.states()
    pairs_within(states.x, states.y, 2.0)
    bus.publish("WORLD_STATE", WorldState(now_utime(), ids, origins, *states).encode())
"""  # without decisions, contacts and received messages
LONGEST_START = 180.0  # s; the model may have to be compiled first


def live() -> Iterator[Row]:
    """Measure the share of a core used by cmr-sim while its robots drive, and by a minimal loop."""
    for robots, goal in GOALS.items():
        with tempfile.TemporaryDirectory() as folder:
            share, rate = _share_of_a_core(command(robots, 3.0 * WARM_UP + SECONDS, folder))
        bare, _ = _share_of_a_core([sys.executable, "-c", BARE_LOOP, str(robots), str(RATE)])
        yield Row(
            f"cmr-sim live, {robots:,} robots at {RATE:.0f} Hz, WORLD_STATE at {RATE:.0f} Hz",
            f"{share:.1%} of a core; {bare:.1%} for a bare loop of step, neighbours and message",
            f"{rate:.1f} messages a second arrived",
            f"{goal:.1%}",
            share <= goal,
            Point("CMR, cmr-sim live", robots, share / RATE),
        )


def _share_of_a_core(process_command: list[str]) -> tuple[float, float]:
    """Return the share of a core that RATE messages a second take, and the number of messages that arrived a second.

    A machine that is not idle skips some messages, so the share is computed per message sent.
    """
    url = private_url()
    bus = Bus(url)
    bus.subscribe(WORLD_STATE, every=True)
    environment = os.environ | {"LCM_DEFAULT_URL": url, "PYTHONPATH": str(SCRIPTS)}
    with subprocess.Popen(process_command, stderr=subprocess.DEVNULL, env=environment) as process:
        # This process is pinned to one core; the measured one may use the others.
        os.sched_setaffinity(process.pid, range(os.cpu_count() or 1))
        try:
            _count_messages(bus, _first_motion(bus, process) + WARM_UP)
            before, begin = processor_time(process.pid), time.monotonic()
            messages = _count_messages(bus, begin + SECONDS)
            used, seconds = processor_time(process.pid) - before, time.monotonic() - begin
        finally:
            process.terminate()
    return used / (messages / RATE), messages / seconds


def command(robots: int, seconds: float, folder: str) -> list[str]:
    """Return the command of cmr-sim with robots on a grid that drive figure-eights for at least `seconds`."""
    NOMINAL.save(Path(folder) / "robot_0.yaml")
    side = round(robots**0.5) + 1
    laps = math.ceil(seconds / SHORTEST_LAP)
    each = [
        f"{1 + k}=figure_eight,start=0,laps={laps},x={k % side * SPACING:g},y={k // side * SPACING:g}"
        for k in range(robots)
    ]
    program = str(Path(sys.executable).with_name("cmr-sim"))
    return [program, "--rate", f"{RATE:g}", "--parameters", folder, "--virtual", *each]


def _first_motion(bus: Bus, process: "subprocess.Popen[bytes]") -> float:
    """Wait until robots move; return the time [s of the monotonic clock]."""
    begin = time.monotonic()
    while not any(any(world.psi_left) for received in bus.receive(0.1) if (world := received.message_of(WORLD_STATE))):
        if process.poll() is not None or time.monotonic() > begin + LONGEST_START:
            raise RuntimeError("the robots of cmr-sim do not move; run it by hand to see why")
    return time.monotonic()


def _count_messages(bus: Bus, until: float) -> int:
    """Receive messages until a time; return their number."""
    count = 0
    while (remaining := until - time.monotonic()) > 0.0:
        count += len(bus.receive(min(remaining, 0.1)))
    return count

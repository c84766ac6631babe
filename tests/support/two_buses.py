"""Two cmr-sim on two buses with a bad network between them, watched from both buses."""

import math
import subprocess
import time
from collections import defaultdict
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path

import numpy as np

from cmr.bus.bus import Bus
from cmr.bus.messages import now_utime
from cmr.bus.streams import PROCESS_STATUS, WORLD_STATE
from cmr.msg import process_status_t, world_state_t
from cmr.parameters.file import ParameterFile, Value
from tests.support.bus_bench import PATIENCE, our_command
from tests.support.private_bus import private_url
from tests.support.relay import Relay

PAPER = {"wheel_radius": 0.04, "k2_over_k3": 118.0, "k1": 0.054, "base_width": 0.161}
ROBOTS = (  # of each simulator: leaders, and one that follows a leader of the other
    ("10=figure_eight,start=0,laps=99", "11=figure_eight,start=0,laps=99,y=5", "12=follow,leader=20,x=-0.5,y=10"),
    ("20=figure_eight,start=0,laps=99,y=10", "21=figure_eight,start=0,laps=99,y=15", "22=follow,leader=10,x=-0.5"),
)
OWNED = ({10, 11, 12}, {20, 21, 22})
LOSS, DELAY, JITTER = 0.02, 0.02, 0.01  # of packets; s
TOP_SPEED = 0.7  # m/s, above what any robot here drives
ROUNDING = 1e-4  # m; floats on the wire, and straight lines between stamps 20 ms apart
LONGEST_START = 240.0  # s; a compiler may have to run first, on a busy machine
GONE = 1.0  # s; a robot not heard of for longer is lost


@dataclass(frozen=True)
class Sighting:
    """One robot in one message: when it arrived and what it is stamped [us], and where the robot is [m]."""

    arrived: int
    utime: int
    x: float
    y: float


@dataclass
class Record:
    """What was heard on two buses: sightings by (bus, robot id), and what processes said of themselves.

    `paused` is the longest time [s] for which this machine, busy with other things, let the listener wait.
    """

    sightings: dict[tuple[int, int], list[Sighting]] = field(default_factory=lambda: defaultdict(list))
    said: set[str] = field(default_factory=set)
    carried: int = 0
    lost: int = 0
    paused: float = 0.0

    def longest_silence(self, bus: int, robot_id: int) -> float:
        """Return the longest time [s] between two messages with a robot on a bus."""
        arrivals = [sighting.arrived for sighting in self.sightings[bus, robot_id]]
        return max(later - earlier for earlier, later in pairwise(arrivals)) * 1e-6

    def doubled(self, robot_id: int) -> int:
        """Return how often a robot came twice with a stamp, or was too far from where it was just before."""
        count = 0
        for bus in (0, 1):
            seen = sorted(self.sightings[bus, robot_id], key=lambda sighting: sighting.utime)
            for before, after in pairwise(seen):
                near = TOP_SPEED * (after.utime - before.utime) * 1e-6 + ROUNDING
                same = before.utime == after.utime
                count += same or math.hypot(after.x - before.x, after.y - before.y) > near
        return count

    def ages(self, robot_id: int) -> list[float]:
        """Return how old [s] a robot's states were when they arrived on the other bus."""
        return [(sighting.arrived - sighting.utime) * 1e-6 for sighting in self.sightings[_far(robot_id), robot_id]]

    def largest_excess(self, robot_id: int) -> float:
        """Return by how much a robot on the other bus was further [m] from where it was than its speed explains."""
        own = np.array([[s.utime, s.x, s.y] for s in self.sightings[1 - _far(robot_id), robot_id]])
        far = np.array([[s.arrived, s.utime, s.x, s.y] for s in self.sightings[_far(robot_id), robot_id]])
        far = far[(far[:, 0] <= own[-1, 0]) & (far[:, 1] >= own[0, 0])]
        here = np.hypot(*(np.interp(far[:, 0], own[:, 0], own[:, k]) - far[:, k + 1] for k in (1, 2)))
        return float(np.max(here - TOP_SPEED * (far[:, 0] - far[:, 1]) * 1e-6))


def _far(robot_id: int) -> int:
    """Return the bus on which a robot is not simulated."""
    return 1 if robot_id in OWNED[0] else 0


def watch_two_buses(folder: Path, seconds: float, cut: tuple[float, float]) -> Record:
    """Run two simulators for so long [s] from the moment that all robots are on both buses, and return what was heard.

    The network is cut from the first to the second moment of `cut` [s].
    """
    values = {name: Value(value) for name, value in PAPER.items()}
    ParameterFile(0, values).save(folder / "robot_0.yaml")
    urls = (private_url(), private_url())
    running = []
    with Relay(urls, loss=LOSS, delay=DELAY, jitter=JITTER) as relay:
        try:
            for url, robots in zip(urls, ROBOTS, strict=True):
                command = [our_command("cmr-sim"), "--lcm-url", url, "--parameters", str(folder), "--virtual", *robots]
                running.append(subprocess.Popen(command, stderr=subprocess.DEVNULL))
            record = _watched((Bus(urls[0]), Bus(urls[1])), relay, seconds, cut)
        finally:
            for process in running:
                process.terminate()
            for process in running:
                process.wait(PATIENCE)
        record.carried, record.lost = relay.carried, relay.lost
    return record


def _watched(buses: tuple[Bus, Bus], relay: Relay, seconds: float, cut: tuple[float, float]) -> Record:
    for bus in buses:
        bus.subscribe(WORLD_STATE, every=True)
        bus.subscribe(PROCESS_STATUS, every=True)
    beginning = Record()
    deadline = time.monotonic() + LONGEST_START
    while not all(any(s.x for s in beginning.sightings[bus, i]) for bus in (0, 1) for i in (10, 11, 20, 21)):
        assert time.monotonic() < deadline, f"only {sorted(beginning.sightings)} are there; said: {beginning.said}"
        _listen(buses, beginning)
    record = Record()
    began, last = time.monotonic(), 0.0
    while (now := time.monotonic() - began) < seconds:
        relay.joined = not cut[0] <= now < cut[1]
        record.paused, last = max(record.paused, now - last), now
        _listen(buses, record)
    return record


def _listen(buses: tuple[Bus, Bus], record: Record) -> None:
    for number, bus in enumerate(buses):
        for received in bus.receive(0.002):
            message, arrived = received.message, now_utime()
            if isinstance(message, process_status_t):
                record.said.add(message.message)
            if not isinstance(message, world_state_t):
                continue
            for i, robot_id in enumerate(message.robot_id):
                sighting = Sighting(arrived, message.utime, float(message.x[i]), float(message.y[i]))
                record.sightings[number, robot_id].append(sighting)

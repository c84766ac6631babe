"""The parts of scripts/study_ros2: cmr-ros2 between a node and the bus, each a process of its own, in real time."""

import json
import os
import select
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import IO, NamedTuple

import numpy as np

from cmr.bus.bus import Bus
from cmr.bus.messages import make, now_utime
from cmr.bus.streams import MOTOR_FEEDBACK, VELOCITY_COMMAND
from cmr.msg import motor_feedback_t, velocity_command_t
from tests.support.private_bus import private_url
from tests.support.ros2_python import environment, free_domain

RATE = 50.0  # Hz of one robot
FAST = 1000.0  # Hz, at which many messages are sent
BEFORE = 1.0  # s of messages by which the bridge learns the robot's clock, and which do not count
LATENCY_SECONDS = 40.0
TEAM = 20
LOSSES = 10  # of each kind
BEFORE_LOSS, AFTER_LOSS = 3.0, 2.0  # s
LIFETIME, CYCLE = 0.5, 0.02  # s
STEP = 1e-6  # m/s by which each command is greater than the one before it, so that it is known again
PROFILE = """\
schema: 1
name: numbered
sources: [scripts/study_ros2]
base: {{command_timeout: 0.5, source: scripts/study_ros2}}
command: {{topic: cmd_vel, speed: 1.0, turn_rate: 1.0, speeding_up: 1000.0, slowing_down: 1000.0}}
wheels:
  {{topic: joint_states, left: wheel_left_joint, right: wheel_right_joint, ticks_per_turn: 2048, reliability: {}}}
nominal: {{wheel_radius: 0.04, base_width: 0.161, response_time: 0.15, top_wheel_speed: 30.0}}
"""


class Heard(NamedTuple):
    """A message on the bus: robot, number, when it was published, when it left the bridge and when it was here [us]."""

    robot: int
    number: int
    published: int
    bridged: int
    here: int


class Run(NamedTuple):
    """What came of a run: what the bus had, what the node heard as (value, arrival), commands sent, share of a core."""

    heard: list[Heard]
    velocities: list[tuple[float, int]]
    commands: dict[int, int]
    share: float


def messages(count: int) -> int:
    """Send many messages of one robot, and print how many are lost; return 1 if any is with reliable topics."""
    print("| topics | messages | rate | lost |\n|---|---|---|---|")
    failed = 0
    for reliability in ("reliable", "best_effort"):
        extra = round(BEFORE * FAST)
        run = _run(1, FAST, count + extra, reliability, is_commanded=False)
        lost = count - len({one.number for one in run.heard if one.number >= extra})
        print(f"| {reliability.replace('_', ' ')} | {count} | {FAST:.0f} Hz | {lost} |", flush=True)
        failed |= int(reliability == "reliable" and lost > 0)
    return failed


def latency() -> int:
    """Print how late messages of one robot are on the other side, by both ways."""
    run = _run(1, RATE, round(LATENCY_SECONDS * RATE), "reliable", is_commanded=True)
    _print_latencies(run)
    return 0


def robots() -> int:
    """Print what twenty robots lose, and what they take of a core; return 1 if anything is lost."""
    count, extra = round(LATENCY_SECONDS * RATE), round(BEFORE * RATE)
    run = _run(TEAM, RATE, count + extra, "reliable", is_commanded=True)
    got = {(one.robot, one.number) for one in run.heard if one.number >= extra}
    lost = TEAM * count - len(got)
    print(
        f"{TEAM} robots at {RATE:.0f} Hz: {TEAM * count} messages, {lost} lost, {100.0 * run.share:.0f} % of a core\n"
    )
    _print_latencies(run)
    return int(lost > 0 or run.share > 1.0)


def _print_latencies(run: Run) -> None:
    print("| way | messages | median | 99 % | longest |\n|---|---|---|---|---|")
    to_bus = [one.here - one.published for one in run.heard]
    first: dict[int, int] = {}  # each is sent again until the next one comes
    for v, arrival in run.velocities:
        first.setdefault(round(v / STEP), arrival)
    to_ros = [arrival - run.commands[key] for key, arrival in first.items() if key in run.commands]
    within = [one.here - one.bridged for one in run.heard]
    ways = {"node to bus": to_bus, "of that, from the bridge's callback on": within, "bus to node": to_ros}
    for way, values in ways.items():
        figures = [np.quantile(values, share) / 1000.0 for share in (0.5, 0.99, 1.0)]
        print(f"| {way} | {len(values)} | {' | '.join(f'{figure:.2f} ms' for figure in figures)} |")


def losses() -> int:
    """Print after which time the robot is sent its last velocity; return 1 if zero comes too late, or not at all."""
    print("| loss | times | last velocity at most | zero was sent |\n|---|---|---|---|")
    failed = 0
    for loss, number in (("commands end", None), ("SIGTERM", signal.SIGTERM), ("SIGKILL", signal.SIGKILL)):
        found = [_lose(number) for _ in range(LOSSES)]
        longest, zeros = max(last for last, _ in found), sum(zero for _, zero in found)
        print(f"| {loss} | {LOSSES} | {longest:.3f} s | {zeros} of {LOSSES} |", flush=True)
        expected = 0 if number == signal.SIGKILL else LOSSES
        failed |= int(longest > LIFETIME + 2.0 * CYCLE or zeros < expected)
    return failed


def _lose(number: int | None) -> tuple[float, bool]:
    """Have the bridge lose its commands, or end it; return when after that the last velocity came [s], and if zero."""
    with (
        tempfile.TemporaryDirectory() as name,
        _bridge(Path(name), ["/a"], "reliable") as (bridge, url, domain),
        _source(Path(name), url, ["/a"], RATE, round(RATE * (BEFORE_LOSS + AFTER_LOSS)), "reliable", domain) as source,
    ):
        assert source.stdout is not None
        bus, end = Bus(url), time.monotonic() + BEFORE_LOSS
        while time.monotonic() < end:
            _command(bus, 0, 0.5)
            time.sleep(CYCLE)
        lost = now_utime()
        if number is not None:
            bridge.send_signal(number)
        arrivals = json.loads(source.stdout.readline())["heard"]
    assert any(v > 0.0 for v, _ in arrivals), "the robot was never commanded"
    last = max(at for v, at in arrivals if v > 0.0)
    return (last - lost) / 1e6, arrivals[-1][0] == 0.0


def _command(bus: Bus, robot: int, v: float) -> int:
    utime = now_utime()
    bus.publish(VELOCITY_COMMAND, make(velocity_command_t, utime=utime, robot_id=robot, v=v, omega=0.0), robot)
    return utime


def _run(team: int, rate: float, count: int, reliability: str, *, is_commanded: bool) -> Run:
    """Have a node publish numbered joints of a team, and command its robots meanwhile."""
    names = [f"/r{k}" for k in range(team)]
    with (
        tempfile.TemporaryDirectory() as name,
        _bridge(Path(name), names, reliability) as (bridge, url, domain),
        _source(Path(name), url, names, rate, count, reliability, domain) as source,
    ):
        assert source.stdout is not None
        bus = Bus(url)
        bus.subscribe(MOTOR_FEEDBACK, every=True)
        begin, used = time.monotonic(), _used(bridge.pid)
        heard, commands = _listen(bus, team, source.stdout, is_commanded=is_commanded)
        share = (_used(bridge.pid) - used) / (time.monotonic() - begin)
        said = json.loads(source.stdout.readline())
    return Run(heard, [(float(v), int(at)) for v, at in said["heard"] if v], commands, share)


def _listen(bus: Bus, team: int, source: IO[str], *, is_commanded: bool) -> tuple[list[Heard], dict[int, int]]:
    """Return what the bus has until the source says that all is published, and when each command was sent [us]."""
    heard: list[Heard] = []
    commands: dict[int, int] = {}
    due, number = time.monotonic(), 0
    while not select.select([source], [], [], 0.0)[0]:
        received = bus.receive(0.002 if is_commanded else 0.05)
        here = now_utime()
        for one in received:
            if isinstance(one.message, motor_feedback_t):
                message = one.message
                heard.append(Heard(message.robot_id, message.ticks_left, message.utime, message.received_utime, here))
        if is_commanded and time.monotonic() >= due:
            due += 1.0 / RATE
            for robot in range(team):
                number += 1
                commands[number] = _command(bus, robot, number * STEP)
    return heard, commands


@contextmanager
def _source(
    folder: Path, url: str, names: Sequence[str], rate: float, count: int, reliability: str, domain: int
) -> "Iterator[subprocess.Popen[str]]":
    """Run a node that publishes numbered joints; yield its process when it begins to."""
    command = [sys.executable, "-m", "tests.support.ros2_source", ",".join(names), str(rate), str(count), reliability]
    source = subprocess.Popen(
        [*command, str(domain)], env=environment(url, folder), stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    )
    assert source.stdin is not None
    assert source.stdout is not None
    source.stdout.readline()
    time.sleep(2.0)  # until all subscriptions are there
    source.stdin.write("go\n")
    source.stdin.flush()
    try:
        yield source
    finally:
        source.communicate("end\n")


@contextmanager
def _bridge(
    folder: Path, names: Sequence[str], reliability: str
) -> "Iterator[tuple[subprocess.Popen[bytes], str, int]]":
    """Run cmr-ros2 for robots in some namespaces; yield its process, its bus and the domain of ROS 2."""
    profile = folder / "numbered.yaml"
    profile.write_text(PROFILE.format(reliability))
    url, domain = private_url(), free_domain()
    robots = [part for k, name in enumerate(names) for part in ("--robot", f"{k}={profile}@{name}")]
    command = [sys.executable, "-m", "cmr", "ros2", "--quiet", "--domain-id", str(domain), *robots]
    process = subprocess.Popen(command, env=environment(url, folder))
    try:
        yield process, url, domain
    finally:
        process.terminate()
        process.wait()


def _used(pid: int) -> float:
    """Return what a process has used of cores [s]."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")

"""The parts of scripts/study_ros2: cmr-ros2 between a ROS 2 node and the bus, in real time."""

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

RATE = 50.0  # Hz, per robot
FAST = 1000.0  # Hz, for the part `messages`
BEFORE = 1.0  # s of messages that are not counted: the bridge estimates the robot's clock meanwhile
LATENCY_SECONDS = 40.0
TEAM = 20
LOSSES = 10  # of each kind
BEFORE_LOSS, AFTER_LOSS = 3.0, 2.0  # s
LIFETIME, CYCLE = 0.5, 0.02  # s
STEP = 1e-6  # m/s; the velocity of command k is k STEP, which identifies the command
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


class Received(NamedTuple):
    """A message on the bus: robot, number, and the times of publication, in the bridge, and of reception here [us]."""

    robot: int
    number: int
    published: int
    bridged: int
    received: int


class Run(NamedTuple):
    """The result of a run.

    `messages` were received on the bus, `velocities` by the node, as (m/s, arrival [us]). `commands` maps the number
    of each command to its time [us]. `share` is the part of a core that the bridge used.
    """

    messages: list[Received]
    velocities: list[tuple[float, int]]
    commands: dict[int, int]
    share: float


def messages(count: int) -> int:
    """Send many messages of one robot, and print how many are lost; return 1 if any is lost with reliable topics."""
    print("| topics | messages | rate | lost |\n|---|---|---|---|")
    failed = 0
    for reliability in ("reliable", "best_effort"):
        extra = round(BEFORE * FAST)
        run = _run(1, FAST, count + extra, reliability, is_commanded=False)
        lost = count - len({message.number for message in run.messages if message.number >= extra})
        print(f"| {reliability.replace('_', ' ')} | {count} | {FAST:.0f} Hz | {lost} |", flush=True)
        failed |= int(reliability == "reliable" and lost > 0)
    return failed


def latency() -> int:
    """Print the latency of messages of one robot, in both directions."""
    run = _run(1, RATE, round(LATENCY_SECONDS * RATE), "reliable", is_commanded=True)
    _print_latencies(run)
    return 0


def robots() -> int:
    """Print how many messages of twenty robots are lost, and the CPU load; return 1 if any message is lost."""
    count, extra = round(LATENCY_SECONDS * RATE), round(BEFORE * RATE)
    run = _run(TEAM, RATE, count + extra, "reliable", is_commanded=True)
    arrived = {(message.robot, message.number) for message in run.messages if message.number >= extra}
    lost = TEAM * count - len(arrived)
    print(
        f"{TEAM} robots at {RATE:.0f} Hz: {TEAM * count} messages, {lost} lost, {100.0 * run.share:.0f} % of a core\n"
    )
    _print_latencies(run)
    return int(lost > 0 or run.share > 1.0)


def _print_latencies(run: Run) -> None:
    print("| direction | messages | median | 99 % | longest |\n|---|---|---|---|---|")
    to_bus = [message.received - message.published for message in run.messages]
    first: dict[int, int] = {}  # the bridge repeats each command until the next one
    for v, arrival in run.velocities:
        first.setdefault(round(v / STEP), arrival)
    to_ros = [arrival - run.commands[key] for key, arrival in first.items() if key in run.commands]
    within = [message.received - message.bridged for message in run.messages]
    directions = {"node to bus": to_bus, "of that, after the bridge's callback": within, "bus to node": to_ros}
    for direction, values in directions.items():
        figures = [np.quantile(values, share) / 1000.0 for share in (0.5, 0.99, 1.0)]
        print(f"| {direction} | {len(values)} | {' | '.join(f'{figure:.2f} ms' for figure in figures)} |")


def losses() -> int:
    """Print the time until the last non-zero velocity after a loss; return 1 if zero is sent too late, or never."""
    print("| loss | times | last velocity after at most | zero was sent |\n|---|---|---|---|")
    failed = 0
    for loss, number in (("commands end", None), ("SIGTERM", signal.SIGTERM), ("SIGKILL", signal.SIGKILL)):
        results = [_measure_loss(number) for _ in range(LOSSES)]
        longest, zeros = max(last for last, _ in results), sum(zero for _, zero in results)
        print(f"| {loss} | {LOSSES} | {longest:.3f} s | {zeros} of {LOSSES} |", flush=True)
        expected = 0 if number == signal.SIGKILL else LOSSES
        failed |= int(longest > LIFETIME + 2.0 * CYCLE or zeros < expected)
    return failed


def _measure_loss(number: int | None) -> tuple[float, bool]:
    """Stop commanding, or send the bridge signal `number`.

    Return the time from then to the last non-zero velocity [s], and whether zero came at the end.
    """
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
    assert any(v > 0.0 for v, _ in arrivals), "no velocity reached the robot"
    last = max(at for v, at in arrivals if v > 0.0)
    return (last - lost) / 1e6, arrivals[-1][0] == 0.0


def _command(bus: Bus, robot: int, v: float) -> int:
    utime = now_utime()
    bus.publish(VELOCITY_COMMAND, make(velocity_command_t, utime=utime, robot_id=robot, v=v, omega=0.0), robot)
    return utime


def _run(team: int, rate: float, count: int, reliability: str, *, is_commanded: bool) -> Run:
    """Let a node publish numbered joint states of a team; command the robots meanwhile, if `is_commanded`."""
    names = [f"/r{k}" for k in range(team)]
    with (
        tempfile.TemporaryDirectory() as name,
        _bridge(Path(name), names, reliability) as (bridge, url, domain),
        _source(Path(name), url, names, rate, count, reliability, domain) as source,
    ):
        assert source.stdout is not None
        bus = Bus(url)
        bus.subscribe(MOTOR_FEEDBACK, every=True)
        begin, cpu = time.monotonic(), _cpu_time(bridge.pid)
        messages, commands = _receive(bus, team, source.stdout, is_commanded=is_commanded)
        share = (_cpu_time(bridge.pid) - cpu) / (time.monotonic() - begin)
        output = json.loads(source.stdout.readline())
    return Run(messages, [(float(v), int(at)) for v, at in output["heard"] if v], commands, share)


def _receive(bus: Bus, team: int, source: IO[str], *, is_commanded: bool) -> tuple[list[Received], dict[int, int]]:
    """Receive until the source has published everything; return the messages, and the time of each command [us]."""
    messages: list[Received] = []
    commands: dict[int, int] = {}
    due, number = time.monotonic(), 0
    while not select.select([source], [], [], 0.0)[0]:
        arrived = bus.receive(0.002 if is_commanded else 0.05)
        now = now_utime()
        for received in arrived:
            message = received.message
            if isinstance(message, motor_feedback_t):
                times = message.utime, message.received_utime, now
                messages.append(Received(message.robot_id, message.ticks_left, *times))
        if is_commanded and time.monotonic() >= due:
            due += 1.0 / RATE
            for robot in range(team):
                number += 1
                commands[number] = _command(bus, robot, number * STEP)
    return messages, commands


@contextmanager
def _source(
    folder: Path, url: str, names: Sequence[str], rate: float, count: int, reliability: str, domain: int
) -> "Iterator[subprocess.Popen[str]]":
    """Run a node that publishes numbered joint states; yield its process when it begins."""
    command = [sys.executable, "-m", "tests.support.ros2_source", ",".join(names), str(rate), str(count), reliability]
    source = subprocess.Popen(
        [*command, str(domain)], env=environment(url, folder), stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    )
    assert source.stdin is not None
    assert source.stdout is not None
    source.stdout.readline()
    time.sleep(2.0)  # until all subscriptions are established
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
    """Run cmr-ros2 for robots in these namespaces; yield its process, the URL of its bus and the ROS 2 domain."""
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


def _cpu_time(pid: int) -> float:
    """Return the CPU time of a process [s]."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")

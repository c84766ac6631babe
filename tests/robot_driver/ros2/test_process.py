"""cmr-ros2 as a process between a real bus and real topics; an emulated robot is driven over both."""

import signal
import subprocess
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from cmr.bus.bus import Bus
from cmr.bus.keys import write_new_key
from cmr.bus.messages import make, now_utime
from cmr.bus.streams import (
    ESTOP,
    GYRO,
    MOTOR_COMMAND,
    MOTOR_FEEDBACK,
    POSE,
    PROCESS_STATUS,
    VELOCITY_COMMAND,
    WORLD_STATE,
)
from cmr.bus.world_state import WorldState
from cmr.msg import estop_t, motor_feedback_t, pose_xyt_t, process_status_t, robot_state_t, velocity_command_t
from robot_driver.ros2.profile import shipped
from tests.support.private_bus import private_url
from tests.support.ros2_python import environment, free_domain, ros2_python

pytestmark = pytest.mark.waits
PATIENCE = 90.0  # s; this computer may be busy, and nodes take seconds to find each other
STILL = 0.05  # rad/s
DAY = 86_400_000_000  # us


class World:
    """A bus, an emulated robot in ROS 2, and what was heard."""

    def __init__(self, folder: Path) -> None:
        self.python, self.domain, self.url = ros2_python(), free_domain(), private_url()
        self.environment = environment(self.url, folder)
        self.folder = folder
        self.bus = Bus(self.url)
        for stream in (MOTOR_FEEDBACK, GYRO, POSE, PROCESS_STATUS, MOTOR_COMMAND):
            self.bus.subscribe(stream, every=True)
        self.heard: list[Any] = []
        self.commanded: tuple[float, float] | None = None
        self._processes: list[subprocess.Popen[str]] = []

    def start(self, module: str, *arguments: str) -> "subprocess.Popen[str]":
        """Start a process of ours; what it says goes to a file named after its module."""
        command = [self.python, "-m", *module.split(), *arguments, "--domain-id", str(self.domain)]
        output = (self.folder / f"{module.split('.')[-1]}.txt").open("w")
        process = subprocess.Popen(command, env=self.environment, stdout=output, stderr=subprocess.STDOUT, text=True)
        self._processes.append(process)
        return process

    def close(self) -> None:
        for process in reversed(self._processes):
            if process.poll() is None:
                process.kill()
            process.wait()

    def turn(self) -> None:
        """Command what is to be commanded, and listen for a moment."""
        if self.commanded is not None:
            v, omega = self.commanded
            command = make(velocity_command_t, utime=now_utime(), robot_id=0, v=v, omega=omega)
            self.bus.publish(VELOCITY_COMMAND, command, 0)
        self.heard += [received.message for received in self.bus.receive(0.02)]

    def until(self, is_so: Callable[[], bool]) -> None:
        """Go on until something is so."""
        deadline = time.monotonic() + PATIENCE
        while not is_so():
            assert time.monotonic() < deadline, [path.read_text() for path in self.folder.glob("*.txt")]
            self.turn()

    def last(self, kind: type[Any]) -> Any:
        """Return the last message of a kind; None if none came."""
        return next((message for message in reversed(self.heard) if isinstance(message, kind)), None)

    def is_moving(self) -> bool:
        feedback = self.last(motor_feedback_t)
        return feedback is not None and min(abs(feedback.psi_left), abs(feedback.psi_right)) > 1.0

    def is_still(self) -> bool:
        feedback = self.last(motor_feedback_t)
        return feedback is not None and max(abs(feedback.psi_left), abs(feedback.psi_right)) < STILL


@pytest.fixture
def world(tmp_path: Path) -> Iterator[World]:
    with _world(tmp_path) as made:
        yield made


@contextmanager
def _world(folder: Path) -> Iterator[World]:
    made = World(folder)
    try:
        yield made
    finally:
        made.close()


def profile(folder: Path) -> Path:
    path = folder / "emulated.yaml"
    path.write_text(shipped()["example"].read_text(encoding="utf-8"))
    return path


def bridged(world: World) -> "subprocess.Popen[str]":
    """Start robot and bridge, and have the robot move."""
    world.start("robot_driver.ros2.emulated", "--namespace", "/turtle", "--ideal")
    bridge = world.start("cmr ros2", "--robot", f"0={profile(world.folder)}@/turtle")
    world.commanded = 0.2, 0.3
    world.until(world.is_moving)
    return bridge


def test_a_robot_is_driven_and_says_how_it_moves(world: World) -> None:
    bridged(world)
    world.until(lambda: world.last(pose_xyt_t) is not None and world.last(pose_xyt_t).x > 0.05)
    world.until(lambda: world.last(process_status_t).state == process_status_t.RUNNING)


def test_a_robot_stands_when_its_commands_end(world: World) -> None:
    bridge = bridged(world)
    world.commanded = None
    world.until(world.is_still)
    assert bridge.poll() is None


def test_an_emergency_stop_holds_over_a_restart_of_the_bridge(world: World) -> None:
    bridge = bridged(world)
    stop = make(estop_t, utime=now_utime(), engaged=True, source="test", reason="a test")
    world.bus.publish(ESTOP, stop)
    world.until(world.is_still)
    bridge.send_signal(signal.SIGTERM)
    assert bridge.wait(PATIENCE) == 130
    world.start("cmr ros2", "--robot", f"0={world.folder / 'emulated.yaml'}@/turtle")
    world.heard.clear()
    world.until(lambda: any(is_held(message) for message in world.heard))
    for _ in range(50):
        world.turn()
    assert world.is_still()


def is_held(message: Any) -> bool:
    """Return whether a message tells of the emergency stop."""
    return isinstance(message, motor_feedback_t) and bool(message.status & motor_feedback_t.STATUS_ESTOP)


def test_the_robot_stands_when_the_bridge_is_ended_and_when_it_is_killed(world: World) -> None:
    """Ended, it says zero itself; killed, the robot's own timeout stops it. Its joints are heard by a second bridge."""
    bridge = bridged(world)
    for number in (signal.SIGINT, signal.SIGKILL):
        world.commanded = 0.2, 0.3
        world.until(world.is_moving)
        bridge.send_signal(number)
        bridge.wait(PATIENCE)
        world.commanded = None
        bridge = world.start("cmr ros2", "--robot", f"0={world.folder / 'emulated.yaml'}@/turtle")
        world.heard.clear()
        world.until(world.is_still)


def test_on_a_bus_with_a_key_the_bridge_signs_and_a_stranger_moves_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What is heard of the robot is signed: a bus with a key takes nothing else."""
    write_new_key(tmp_path / "key")
    monkeypatch.setenv("CMR_KEY", str(tmp_path / "key"))
    with _world(tmp_path) as world:
        with monkeypatch.context() as without:
            without.delenv("CMR_KEY")
            stranger = Bus(world.url)
        bridged(world)
        world.commanded = None
        world.until(world.is_still)
        for _ in range(100):
            forged = make(velocity_command_t, utime=now_utime(), robot_id=0, v=0.2, omega=0.3)
            stranger.publish(VELOCITY_COMMAND, forged, 0)
            world.turn()
        assert world.is_still()


def test_a_probe_writes_a_profile_of_what_is_there(world: World) -> None:
    world.start("robot_driver.ros2.emulated", "--namespace", "/turtle", "--ideal")
    path = world.folder / "found.yaml"
    deadline = time.monotonic() + PATIENCE
    while not path.exists():
        assert time.monotonic() < deadline
        world.start("cmr ros2", "--probe", str(path), "--namespace", "/turtle").wait(PATIENCE)
    from robot_driver.ros2.profile import Profile

    found = Profile.load(str(path))
    assert found.command.topic == "cmd_vel"
    assert found.wheels.joints == (["wheel_left_joint"], ["wheel_right_joint"])
    assert found.gyro is not None
    assert found.pose is not None


def test_a_virtual_robot_is_shown_to_ros_and_driven_from_there(world: World) -> None:
    """A navigation stack is a process of its own: it hears odometry and answers with cmd_vel.

    The world is that of a log which is played again a day later; the stack goes by /clock.
    """
    (world.folder / "robot_0.yaml").write_text(PARAMETERS)
    world.start("cmr ros2", "--virtual", "10", "--clock", "--parameters", str(world.folder))
    world.start("tests.support.ros2_navigator", "/robot_10")
    state = ([10], [robot_state_t.VIRTUAL], [1.5], [0.0], [0.0], [2.0], [2.0], [0.0], [0.0])

    def driven() -> bool:
        world.bus.publish(WORLD_STATE, WorldState(now_utime() - DAY, *state))
        return any(getattr(message, "left", 0.0) > 0.1 for message in world.heard)

    world.until(driven)


PARAMETERS = """
schema: 1
robot_id: 0
written: 2026-01-31T12:00:00Z
parameters:
  wheel_radius: {value: 0.04, unit: m}
  k2_over_k3: {value: 118.0, unit: rad/s^2}
  k1: {value: 0.054, unit: s/rad}
  base_width: {value: 0.161, unit: m}
effects: []
"""

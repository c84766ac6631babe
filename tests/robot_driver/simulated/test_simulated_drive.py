"""Whole drives in simulated time: the driver's code and its bytes, without waiting; again they are the same bytes."""

import itertools
import math
from collections import defaultdict
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from cmr.bus.streams import COMMAND_LIFETIME
from cmr.msg import motor_feedback_t
from cmr.recordings.events import LogReader
from robot_driver.controllers import CONTROLLERS
from robot_driver.emulator.faults import Faults
from robot_driver.emulator.settings import Settings, load_settings
from robot_driver.gyros import GYROS
from robot_driver.serial_port import PortLost
from robot_driver.simulated.drive import SimulatedDrive
from robot_driver.simulated.usb import Lateness
from tests.support.lanes import further

pytestmark = pytest.mark.slow

SECONDS = 6.0
SLOW_USB = Lateness(usb_latency=0.016)
BUSY = Lateness(busy=0.1)


def logged(drive: SimulatedDrive, path: Path) -> dict[str, list[Any]]:
    """Return the messages of a drive, by channel."""
    drive.write_log(path / "drive.log")
    messages: dict[str, list[Any]] = defaultdict(list)
    for received in LogReader(path / "drive.log"):
        messages[received.channel].append(received.message)
    return messages


def hiding(**effects: float) -> Settings:
    return replace(load_settings().ideal(), effects=effects)


def served(messages: dict[str, list[Any]]) -> list[Any]:
    """Return the feedback since two seconds after the start: a board is waited for for more than one."""
    return [message for message in messages["MOTOR_FEEDBACK_0"] if message.utime > messages["POSE_0"][0].utime + 2e6]


def assert_driven(messages: dict[str, list[Any]]) -> None:
    """See that the robot was driven, and told what it did, without a break once it had begun."""
    poses = messages["POSE_0"]
    driving = served(messages)
    assert all(not message.status & motor_feedback_t.STATUS_COMMAND_STALE for message in driving)
    assert all(later.utime - earlier.utime < 400_000 for earlier, later in itertools.pairwise(driving))
    assert max(message.applied_left for message in driving) > 0.1
    assert max(math.hypot(pose.x - poses[0].x, pose.y - poses[0].y) for pose in poses) > 0.3


@pytest.mark.parametrize("lateness", [BUSY, *further(Lateness(), SLOW_USB)], ids=["busy", "usual", "slow USB"])
def test_the_same_seeds_give_the_same_log_byte_for_byte_and_others_another(lateness: Lateness, tmp_path: Path) -> None:
    drive = SimulatedDrive(gyro="kvh-binary", seconds=3.0, lateness=lateness, faults=Faults(lose_answer=0.05))
    paths = [tmp_path / name for name in ("first", "again", "other")]
    for path, seed in zip(paths, (1, 1, 2), strict=True):
        replace(drive, seed=seed).write_log(path)
    first, again, other = (path.read_bytes() for path in paths)
    assert first == again
    assert first != other


@pytest.mark.parametrize(
    ("controller", "gyro"),
    [
        ("roboteq", "dsp3000"),
        *((one, "kvh-binary") for one in sorted(CONTROLLERS)),
        *further(*((one, "dsp3000") for one in sorted(CONTROLLERS) if one != "roboteq")),
    ],
)
def test_every_controller_drives_and_every_gyro_tells_the_turns(controller: str, gyro: str, tmp_path: Path) -> None:
    assert gyro in GYROS
    messages = logged(SimulatedDrive(controller=controller, gyro=gyro, seconds=SECONDS), tmp_path)
    assert_driven(messages)
    # Two units are asked one after the other, which takes longer than a turn on such a line.
    assert 85.0 < len(served(messages)) / (SECONDS - 2.0) < 101.0
    assert_gyro_agrees(messages, 900 if gyro == "kvh-binary" else 90)


def test_a_board_with_a_gyro_of_its_own_tells_both_on_one_port(tmp_path: Path) -> None:
    messages = logged(SimulatedDrive(controller="mbot", gyro=None, seconds=SECONDS), tmp_path)
    assert_driven(messages)
    assert_gyro_agrees(messages, 150)


def assert_gyro_agrees(messages: dict[str, list[Any]], least_rate: float) -> None:
    """See that the rates add up to the heading of the poses, at the times that their stamps say."""
    valid = [message for message in messages["GYRO_0"] if message.valid]
    assert len(valid) > least_rate * (SECONDS - 1.5)
    poses = [pose for pose in messages["POSE_0"] if valid[0].utime <= pose.utime <= valid[-1].utime]
    turned = sum(math.remainder(b.theta - a.theta, 2.0 * math.pi) for a, b in itertools.pairwise(poses))
    inside = [message for message in valid if poses[0].utime <= message.utime <= poses[-1].utime]
    added = sum(b.yaw_rate * (b.utime - a.utime) * 1e-6 for a, b in itertools.pairwise(inside))
    assert added == pytest.approx(turned, abs=0.06)  # rad; bias of 0.002 rad/s, noise of the poses
    assert abs(turned) > 0.3


@pytest.mark.parametrize("controller", ["roboclaw", "roboteq"])
@pytest.mark.parametrize("lateness", [SLOW_USB, BUSY], ids=["slow USB", "busy"])
def test_lost_answers_slow_adapters_and_a_busy_computer_do_not_end_a_drive(
    controller: str, lateness: Lateness, tmp_path: Path
) -> None:
    drive = SimulatedDrive(controller=controller, seconds=SECONDS, lateness=lateness, faults=Faults(lose_answer=0.05))
    assert_driven(logged(drive, tmp_path))


def test_commands_are_late_by_what_is_hidden_in_the_robot(tmp_path: Path) -> None:
    moved = []
    for delay in (0.0, 0.1):
        messages = logged(SimulatedDrive(settings=hiding(command_delay=delay), seconds=3.0), tmp_path)
        began = next(message.utime for message in messages["MOTOR_FEEDBACK_0"] if message.applied_left > 0.0)
        turning = next(message.utime for message in messages["MOTOR_FEEDBACK_0"] if abs(message.psi_left) > 0.1)
        moved.append((turning - began) / 1e6)
    assert moved[1] - moved[0] == pytest.approx(0.1, abs=0.02)


def test_a_motor_that_gets_more_turns_faster_on_the_same_duty(tmp_path: Path) -> None:
    settings = {"name": "straight_runs"}
    drive = SimulatedDrive(
        settings=hiding(motor_gain_asymmetry=0.05), behaviour="manoeuvre", behaviour_settings=settings, seconds=4.0
    )
    feedback = logged(drive, tmp_path)["MOTOR_FEEDBACK_0"]
    fast = [message for message in feedback if abs(message.applied_left) > 0.1]
    left, right = (sum(abs(getattr(message, f"psi_{side}")) for message in fast) for side in ("left", "right"))
    assert left / right == pytest.approx(1.05 / 0.95, rel=0.02)


def test_commands_reach_the_motors_within_their_life(tmp_path: Path) -> None:
    messages = logged(SimulatedDrive(seconds=3.0), tmp_path)
    commands = {message.utime: message.left for message in messages["MOTOR_COMMAND_0"]}
    assert max(b - a for a, b in zip(sorted(commands), sorted(commands)[1:], strict=False)) < COMMAND_LIFETIME


def test_what_is_not_there_cannot_be_driven(tmp_path: Path) -> None:
    with pytest.raises((PortLost, KeyError)):
        SimulatedDrive(controller="abacus", seconds=1.0).write_log(tmp_path / "log")

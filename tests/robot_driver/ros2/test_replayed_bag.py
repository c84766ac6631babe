"""A rosbag2 (MCAP) that is played to cmr-ros2 live gives what cmr-import makes of the file."""

import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cmr.msg import gyro_t, motor_feedback_t, process_status_t
from cmr.recordings.recording import Recording
from cmr_tools.importing.import_log import main as import_log
from tests.documentation.turtlebot_bag import write_turtlebot_bag
from tests.robot_driver.ros2.test_process import PATIENCE, World

pytestmark = pytest.mark.waits
MOST_LOST = 50  # messages in turn


def test_a_bag_that_is_played_live_is_what_its_import_is(tmp_path: Path) -> None:
    bag = write_turtlebot_bag(tmp_path, storage="mcap")
    imported = tmp_path / "imported.lcm"
    assert import_log(["turtlebot3_burger", str(bag), "--out", str(imported)]) == 0
    recording = Recording.read(imported)
    world = World(tmp_path)
    try:
        world.start("cmr ros2", "--robot", "0=turtlebot3", "--no-base-timeout")
        player = world.start("tests.support.ros2_player", str(bag))
        deadline = time.monotonic() + PATIENCE
        while player.poll() is None:
            assert time.monotonic() < deadline
            world.turn()
        assert player.returncode == 0, (tmp_path / "ros2_player.txt").read_text()
    finally:
        world.close()
    feedback = [one for one in world.heard if isinstance(one, motor_feedback_t)]
    gyro = [one for one in world.heard if isinstance(one, gyro_t)]
    compare(feedback, recording.wheels, "psi_left", "psi_right")
    compare(gyro, recording.gyro, "yaw_rate")
    # The bag's own cmd_vel is another node's, which passes by the emergency stop.
    said = [one.message for one in world.heard if isinstance(one, process_status_t)]
    assert any("Another node publishes /cmd_vel" in message for message in said)
    assert any("The robot's clock is" in message and "behind" in message for message in said)  # the bag is old


def compare(heard: list[Any], signal: Any, *names: str) -> None:
    """Nearly all of a signal was heard, in order, with its numbers and intervals, from when the clock was known on."""
    values = np.array([[getattr(message, name) for name in names] for message in heard])
    expected = np.stack([signal[name] for name in names], axis=1)
    # The robot stands at first: where it begins to move, both are the same moment.
    begin, at = (int(np.argmax(np.abs(numbers[:, 0]) > 0.5)) for numbers in (values, expected))
    assert begin > 0, "nothing was heard before the robot moved"
    found = []
    for value in values[begin:]:  # best effort may lose some
        following = [k for k in range(at, min(at + MOST_LOST, len(expected))) if np.allclose(expected[k], value, 1e-12)]
        assert following, f"{value} is not in the bag, or not there"
        found.append(following[0])
        at = following[0] + 1
    assert len(found) > 0.99 * (len(expected) - found[0])
    utime = np.array([message.utime for message in heard[begin:]])
    moved = (utime - utime[0]) - (signal.utime[found] - signal.utime[found[0]])
    assert np.median(np.abs(moved)) < 20_000  # us, by which the estimate of the clock's offset improves

"""A log that is played again gives its time to nodes with use_sim_time, and its robots to ROS 2."""

import subprocess
from pathlib import Path

import pytest

from cmr.bus.world_state import WorldState
from cmr.msg import robot_state_t
from tests.robot_driver.ros2.test_process import PARAMETERS, World
from tests.support.emulated_drive import write_log

pytestmark = pytest.mark.waits
BEGIN, SECONDS, RATE, SPEED = 1_700_000_000_000_000, 20.0, 50.0, 0.1  # us, years ago; s; Hz; m/s
SEEN = 30  # odometry messages that are looked at
LATE = 1_000_000  # us, by which the clock may be away from the odometry: this computer may be busy


def log_of_a_robot(path: Path) -> Path:
    """Write a log in which robot 10 goes along x."""
    robot, still = ([10], [robot_state_t.VIRTUAL]), [[0.0]] * 6
    times = [step / RATE for step in range(round(SECONDS * RATE))]
    write_log(
        path, [("WORLD_STATE", WorldState(BEGIN + round(1e6 * time), *robot, [SPEED * time], *still)) for time in times]
    )
    return path


def test_nodes_with_use_sim_time_live_in_the_log_that_is_played(tmp_path: Path) -> None:
    log = log_of_a_robot(tmp_path / "run.lcm")
    (tmp_path / "robot_0.yaml").write_text(PARAMETERS)
    world = World(tmp_path)
    replay = [world.python, "-m", "cmr", "replay", str(log), "--loop", "--quiet"]
    try:
        world.start("cmr ros2", "--show", "10", "--clock", "--parameters", str(tmp_path))
        world.start("tests.support.ros2_sim_time", "/robot_10")
        with subprocess.Popen(replay, env=world.environment) as player:
            try:
                world.until(lambda: len(said(tmp_path)) > SEEN)
            finally:
                player.kill()
    finally:
        world.close()
    for clock, utime, x in said(tmp_path)[-SEEN:]:
        assert BEGIN <= utime <= BEGIN + SECONDS * 1e6
        assert abs(clock - utime) < LATE or clock >= BEGIN + SECONDS * 1e6 - LATE  # it has begun again
        assert x == pytest.approx(SPEED * (utime - BEGIN) / 1e6, abs=1e-6)


def said(folder: Path) -> list[tuple[float, ...]]:
    """Return what the node with use_sim_time has printed: time of its clock and of the odometry [us], and x [m]."""
    lines = (folder / "ros2_sim_time.txt").read_text().splitlines(keepends=True)
    return [tuple(map(float, line.split())) for line in lines if line.endswith("\n")]

"""Promise 19: an emergency stop outlives its sender, the driver and the computer, until somebody releases it."""

import signal
import time
from pathlib import Path

import pytest

from tests.support.driver_bench import DriverProcess, Robot, driving

pytestmark = pytest.mark.real_time

LONG_ENOUGH = 6.0  # s, within which a robot drove that was never released


def engage(driver: DriverProcess, seconds: float) -> None:
    """Engage the emergency stop at 10 Hz for so long, and be gone."""
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        driver.estop(True)
        driver.listen(0.1)


def drives_within(robot: Robot, driver: DriverProcess, seconds: float) -> bool:
    """Command half duty as a pilot does, zero first; return whether the robot was driven meanwhile."""
    end, count = time.monotonic() + seconds, len(robot.drives)
    while time.monotonic() < end:
        driver.command(0.5, 0.5)
        driver.listen(0.02)
    return any(drive[1:] != (0, 0) for drive in robot.drives[count:])


@pytest.mark.parametrize("end", [signal.SIGTERM, signal.SIGKILL])
def test_19_a_stop_outlives_its_sender_and_the_driver(tmp_path: Path, end: int) -> None:
    with driving(tmp_path) as (robot, driver):
        engage(driver, 2.0)
        driver.end(end)
        restarted = DriverProcess(tmp_path)
        try:
            assert not drives_within(robot, restarted, LONG_ENOUGH)
            assert restarted.in_service
            restarted.estop(False)
            restarted.command(0.0, 0.0)
            restarted.command_until(lambda: robot.device.duty == [16384, 16384])
        finally:
            restarted.end(signal.SIGKILL)

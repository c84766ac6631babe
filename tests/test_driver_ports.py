"""Promises 10, 11 and 12: ports come and go, have two kinds of names, and belong to one driver."""

from pathlib import Path

import pytest

from cmr.bus.messages import now_utime
from cmr.msg import process_status_t
from robot_driver import serial_port
from robot_driver.driver import Driver, Settings
from robot_driver.serial_port import numbering_warning
from tests.driver_bench import DriverProcess, driving


def test_10_12_unplugging_is_told_at_once_and_the_robot_starts_from_zero_behind_the_same_name(tmp_path: Path) -> None:
    with driving(tmp_path) as (robot, driver):
        second = DriverProcess(tmp_path)
        assert second.process.wait(20.0) == 1
        assert "Another program is using" in second.end()[1]

        unplugged = now_utime()
        robot.unplug()
        driver.statuses.clear()
        driver.command_until(lambda: any(status.state == process_status_t.DEGRADED for status in driver.statuses))
        told = next(status for status in driver.statuses if status.state == process_status_t.DEGRADED)
        assert "gone" in told.message
        assert told.utime - unplugged < 500_000

        robot.drives.clear()
        robot.plug_in()
        driver.statuses.clear()
        driver.command_until(lambda: robot.device.duty == [16384, 16384])
        assert robot.drives[0][1:] == (0, 0)
        driver.command_until(lambda: driver.statuses and driver.statuses[-1].state == process_status_t.RUNNING)


@pytest.fixture
def stable_names(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setattr(serial_port, "STABLE_NAMES", tmp_path)
    return tmp_path


def test_11_a_numbered_path_draws_a_warning_that_names_the_stable_one(stable_names: Path) -> None:
    assert "udev rule" in numbering_warning("/dev/ttyACM3")
    (stable_names / "usb-Basicmicro_RoboClaw-if00").symlink_to("/dev/ttyACM3")
    assert f"Use {stable_names}/usb-Basicmicro_RoboClaw-if00." in numbering_warning("/dev/ttyACM3")
    warned = Driver(Settings(port="/dev/ttyACM3", gyro_port="/dev/ttyUSB0"))
    assert "/dev/ttyACM3 belongs to another device" in warned.remarks()
    assert "/dev/ttyUSB0 belongs to another device" in warned.remarks()


@pytest.mark.parametrize("path", ["/dev/serial/by-id/usb-Basicmicro_RoboClaw-if00", "/dev/cmr-motor", "/dev/ttyS0"])
def test_11_a_path_that_stays_draws_none(path: str) -> None:
    assert numbering_warning(path) == ""

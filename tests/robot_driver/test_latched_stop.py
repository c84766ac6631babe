"""Promise 19: an emergency stop outlives its sender, the driver and the computer, until somebody releases it."""

import json
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from cmr.bus.messages import make, now_utime
from cmr.bus.process import EXIT_INTERRUPTED
from cmr.bus.streams import ESTOP, ESTOP_LATCH
from cmr.msg import estop_latch_t, estop_t, motor_feedback_t
from robot_driver.clock import seconds_since_boot
from robot_driver.driver import Driver
from robot_driver.serial_port import PortLost
from robot_driver.settings import Settings
from robot_driver.stop_file import EngagedStop, StopFile
from tests.support.driver_bench import URL, DriverProcess, Robot, driving, wait_for

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


def estop(*arguments: str) -> "subprocess.CompletedProcess[str]":
    """Run `cmr estop` on the bus of the tests."""
    code = "import sys; from cmr.commands import umbrella; sys.exit(umbrella())"
    command = [sys.executable, "-c", code, "estop", "--lcm-url", URL, *arguments]
    return subprocess.run(command, capture_output=True, text=True, timeout=60.0, check=False)


def reports(driver: DriverProcess) -> list[estop_latch_t]:
    return [message for message in driver.heard if isinstance(message, estop_latch_t)]


def file_of(folder: Path) -> StopFile:
    return StopFile(folder / "state" / "cmr", 0, URL)


def test_19_everybody_hears_who_engaged_it_and_the_command_releases_it(tmp_path: Path) -> None:
    with driving(tmp_path) as (robot, driver):
        driver.bus.subscribe(ESTOP_LATCH, every=True)
        said = estop("stop", "--name", "Ada", "--reason", "smoke")
        assert said.returncode == 0, said.stderr
        assert said.stdout.startswith("robot 0: HELD since 20")
        assert said.stdout.endswith(" by Ada: smoke\n")
        driver.end(signal.SIGKILL)
        (path,) = (tmp_path / "state" / "cmr" / "estop").iterdir()
        assert json.loads(path.read_text())["reason"] == "smoke"
        restarted = DriverProcess(tmp_path)
        try:
            restarted.command_until(lambda: any(report.engaged and report.stored for report in reports(restarted)))
            restarted.command_until(
                lambda: any("EMERGENCY STOP engaged by Ada: smoke, since 20" in s.message for s in restarted.statuses)
            )
            assert estop().stdout == said.stdout, "since when it was engaged first"
            assert estop("release").returncode == 2, "without a reason"
            released = estop("release", "--name", "Grace", "--reason", "it was toast")
            assert released.returncode == 0, released.stderr
            assert released.stdout.endswith(" by Grace: it was toast\n")
            restarted.command(0.0, 0.0)
            restarted.command_until(lambda: robot.device.duty == [16384, 16384])
            code, terminal = restarted.end()
        finally:
            restarted.end(signal.SIGKILL)
        assert code == EXIT_INTERRUPTED
        assert "EMERGENCY STOP engaged by Ada: smoke, since 20" in terminal
        assert "emergency stop released by Grace: it was toast" in terminal
        assert file_of(tmp_path).load() is None


def test_19_without_a_driver_the_command_says_that_nothing_was_done() -> None:
    said = estop("release", "--reason", "clear")
    assert said.returncode == 1
    assert said.stderr.startswith("cmr estop: No driver reports on this bus.")


def test_19_a_release_without_a_name_or_a_reason_releases_nothing(tmp_path: Path) -> None:
    with driving(tmp_path) as (robot, driver):
        engage(driver, 0.5)
        release = make(estop_t, utime=now_utime(), engaged=False, source="", reason="clear")
        driver.bus.publish(ESTOP, release)
        assert not drives_within(robot, driver, 1.0)
        driver.command_until(lambda: any("without name or reason: 1" in status.message for status in driver.statuses))


@pytest.mark.parametrize("content", [b"", b'{"schema": 1, "robot_id": 0, "bu', b"\0" * 200])
def test_19_a_torn_file_keeps_the_robot_and_says_so(tmp_path: Path, content: bytes) -> None:
    file = file_of(tmp_path)
    file.store(EngagedStop(now_utime(), "Ada", "smoke"))
    file.path.write_bytes(content)
    robot, driver = Robot(tmp_path), DriverProcess(tmp_path)
    driver.in_service = True
    try:
        assert not drives_within(robot, driver, 2.0)
        driver.command_until(lambda: any("is damaged. It is taken for" in status.message for status in driver.statuses))
        driver.estop(False)
        driver.command(0.0, 0.0)
        driver.command_until(lambda: robot.device.duty == [16384, 16384])
    finally:
        _, terminal = driver.end()
        robot.unplug()
    assert f"{file.path} is damaged. It is taken for an emergency stop that is engaged." in terminal
    assert not file.path.exists()


def test_19_a_disk_that_takes_no_file_stops_the_robot_all_the_same(tmp_path: Path) -> None:
    with driving(tmp_path) as (robot, driver):
        file_of(tmp_path).path.mkdir()  # as root, who runs some tests, one may write anywhere
        engage(driver, 0.5)
        wait_for(lambda: robot.device.duty == [0, 0])
        driver.command_until(
            lambda: any("A restart forgets that the emergency stop is engaged" in s.message for s in driver.statuses)
        )
        _, terminal = driver.end()
        assert "--state DIR chooses a folder." in terminal


def test_19_the_motors_are_held_before_the_port_is_opened(tmp_path: Path) -> None:
    file = file_of(tmp_path)
    file.store(EngagedStop(now_utime(), "Ada", "smoke"))
    driver = Driver(Settings(port=str(tmp_path / "motor")), stop_file=file)  # there is no such port
    assert driver._gate.drive(seconds_since_boot()).status & motor_feedback_t.STATUS_ESTOP
    with pytest.raises(PortLost), driver:
        pass
    assert file.load() is not None

"""A driver with a key moves for nobody else, is stopped by anybody, and released by nobody else."""

from pathlib import Path

import pytest

from cmr.bus.bus import Bus
from cmr.bus.keys import write_new_key
from cmr.bus.messages import make, now_utime
from cmr.bus.streams import ESTOP, MOTOR_COMMAND
from cmr.msg import estop_t, motor_command_t
from tests.support.driver_bench import URL, DriverProcess, driving, wait_for

pytestmark = pytest.mark.real_time

FORWARD = [16384, 16384]


def command(bus: Bus, duty: float) -> None:
    message = make(motor_command_t, utime=now_utime(), robot_id=0, left=duty, right=duty)
    bus.publish(MOTOR_COMMAND, message, 0)


def estop(bus: Bus, engaged: bool) -> None:
    bus.publish(ESTOP, make(estop_t, utime=now_utime(), engaged=engaged, source="test", reason="test"))


def test_without_the_key_a_robot_can_be_stopped_and_neither_driven_nor_released(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    stranger = Bus(URL)
    write_new_key(tmp_path / "key")
    monkeypatch.setenv("CMR_KEY", str(tmp_path / "key"))
    member = Bus(URL)
    monkeypatch.setattr(DriverProcess, "command", lambda _self, left, _right: command(member, left))
    with driving(tmp_path) as (robot, driver):
        estop(stranger, True)
        wait_for(lambda: robot.device.duty == [0, 0])
        for _ in range(100):
            estop(stranger, False)
            command(stranger, 0.5)
            command(member, 0.0)
            driver.listen(0.02)
        assert robot.device.duty == [0, 0]
        estop(member, False)
        command(member, 0.0)
        driver.command_until(lambda: robot.device.duty == FORWARD)
        for _ in range(50):
            command(stranger, -1.0)
            command(member, 0.5)
            driver.listen(0.02)
        assert all(left >= 0 for _, left, _ in robot.drives)

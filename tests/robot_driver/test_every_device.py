"""Every controller and every gyro that can be emulated works with the driver; a new one is taken up by itself."""

from pathlib import Path
from statistics import median
from typing import Any

import pytest

from robot_driver.controllers import CONTROLLERS
from robot_driver.driver import Driver
from robot_driver.emulator.devices import CONTROLLER_DEVICES, GYRO_DEVICES
from robot_driver.emulator.plant import Plant
from robot_driver.emulator.settings import load_settings
from robot_driver.gyro_device import GyroDevice
from robot_driver.gyros import GYROS
from robot_driver.port_thread import PortThread
from robot_driver.serial_port import SerialPort
from robot_driver.settings import Settings
from robot_driver.terminals.pseudo_terminal import Ports
from tests.robot_driver.controllers.test_mbot import Client
from tests.support.driver_bench import PunctualEngine, wait_for

pytestmark = pytest.mark.real_time

LEFT, RIGHT = 0.25, 0.5


class NotedPlant(Plant):
    """A robot that notes what it was driven with last."""

    driven = (0.0, 0.0)

    def command(self, left: float, right: float) -> None:
        self.driven = (left, right)
        super().command(left, right)


@pytest.mark.parametrize("kind", sorted(CONTROLLERS))
def test_a_controller_drives_forward_measures_and_stops(tmp_path: Path, kind: str) -> None:
    emulated = load_settings().ideal()
    plant = NotedPlant(emulated)
    device = CONTROLLER_DEVICES[kind](emulated, plant)
    with Ports(tmp_path, ("motor",)) as ports, PunctualEngine(plant, {"motor": device}, ports.terminals) as engine:
        with Driver(Settings(port=str(tmp_path / "motor"), controller=kind)) as driver:
            client = Client(driver)
            # The wheels reach one over k1, times the duty.
            client.until(lambda: plant.right.velocity > 0.9 * RIGHT / emulated.robot.k1, LEFT, RIGHT)
            client.more(20, LEFT, RIGHT)
            steady = client.feedback[-20:]
            assert driver.problems() == ""
            client.until(lambda: client.feedback[-1].applied_left == 0.0, 0.0, 0.0)
            client.until(lambda: client.feedback[-1].applied_right != 0.0, LEFT, RIGHT)
        assert plant.driven == (0.0, 0.0)  # left while driving
        engine.check()
    last = steady[-1]
    assert (last.applied_left, last.applied_right) == pytest.approx((LEFT, RIGHT), abs=0.01)
    assert 0 < last.ticks_left < last.ticks_right
    assert median(message.psi_right for message in steady) == pytest.approx(RIGHT / emulated.robot.k1, rel=0.1)


@pytest.mark.parametrize("kind", sorted(GYRO_DEVICES))
def test_a_gyro_tells_the_rate_counter_clockwise(tmp_path: Path, kind: str) -> None:
    emulated = load_settings().ideal()
    plant = Plant(emulated)
    plant.command(-0.1, 0.1)
    rate = 2.0 * 0.1 / emulated.robot.k1 * emulated.robot.wheel_radius / emulated.robot.base_width
    published: list[Any] = []
    port = SerialPort(str(tmp_path / "gyro"), GYROS[kind].baud_rate)
    with (
        Ports(tmp_path, ("gyro",)) as ports,
        PunctualEngine(plant, {"gyro": GYRO_DEVICES[kind](emulated, plant)}, ports.terminals),
        PortThread(port, GyroDevice(port, GYROS[kind], robot_id=0, sign=1, publish=published.append)) as thread,
    ):
        wait_for(lambda: published and published[-1].yaw_rate == pytest.approx(rate, rel=0.1))
        assert thread.problem == ""

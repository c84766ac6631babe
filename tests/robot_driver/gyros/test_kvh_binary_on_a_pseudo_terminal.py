"""KVH binary gyros end to end: the real driver process, a pseudo-terminal, and an emulated gyro at its other end."""

import contextlib
import math
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from cmr.bus.bus import Bus
from cmr.bus.messages import now_utime
from cmr.bus.streams import GYRO, PROCESS_STATUS
from cmr.msg import gyro_t
from robot_driver.emulator.device import Transmission
from robot_driver.emulator.engine import Engine
from robot_driver.emulator.kvh_binary_device import KvhBinaryDevice
from robot_driver.emulator.plant import Plant
from robot_driver.gyro_device import GyroDevice
from robot_driver.gyros.kvh_binary import KvhBinary
from robot_driver.gyros.kvh_messages import Sample, Stream
from robot_driver.port_thread import PortThread
from robot_driver.serial_port import SerialPort
from robot_driver.terminals.pseudo_terminal import Ports
from tests.robot_driver.emulator.test_emulator_kvh_binary import RATE, kvh_settings
from tests.robot_driver.gyros.test_kvh_binary_protocol import RATES, interviewed, message
from tests.support.private_bus import private_url
from tests.support.typed_messages import as_a

pytestmark = pytest.mark.real_time

DRIVER = [sys.executable, "-c", "from cmr.commands import driver; raise SystemExit(driver())"]
PATIENCE = 20.0  # s; far more than anything here takes on a loaded machine
TIME_OFF = 0.7  # s


class Switchable:
    """The emulated gyro with a switch; after it was off it may be set otherwise. Remembers what it measured (rad/s)."""

    def __init__(self, plant: Plant, **changes: Any) -> None:
        self.truth: set[float] = set()
        self._plant = plant
        self._next: dict[str, Any] | None = None
        self._switch_on(0.0, changes)

    @property
    def wake_time(self) -> float:
        return self.device.wake_time

    def switch_off_and_on(self, **changes: Any) -> None:
        self._next = changes

    def receive(self, data: bytes, time: float) -> list[Transmission]:
        return self.device.receive(data, time) if time > self._powered_from else []

    def wake(self, time: float) -> list[Transmission]:
        if self._next is not None:
            self._switch_on(time + TIME_OFF, self._next)
            self._next = None
            return []
        sent = self.device.wake(time)
        for transmission in sent:
            (sample,) = (part for part in Stream().feed(transmission.data) if isinstance(part, Sample))
            if sample.status & 4:
                self.truth.add(sample.rotation[2] * self._scale)
        return sent

    def _switch_on(self, time: float, changes: dict[str, Any]) -> None:
        settings = kvh_settings(**changes)
        own = settings.kvh_binary
        self._scale = (1.0 if own.sends_rate else float(own.rate)) * (math.radians(1.0) if own.degrees else 1.0)
        self._powered_from = time
        self.byte_time = 10.0 / own.baud
        self.device = KvhBinaryDevice(settings, self._plant, time)


@contextlib.contextmanager
def emulated(folder: Path, **changes: Any) -> Iterator[tuple[Switchable, Path]]:
    """A gyro on a robot that begins to turn counter-clockwise, and its port."""
    plant = Plant(kvh_settings())
    plant.command(-0.1, 0.1)
    gyro = Switchable(plant, **changes)
    with Ports(folder, ("gyro", "motor")) as ports, Engine(plant, {"gyro": gyro}, ports.terminals):
        yield gyro, folder


class Listener:
    """Collects what the driver publishes about the gyro until something holds."""

    def __init__(self, url: str) -> None:
        self.readings: list[Any] = []
        self.message = ""
        self._bus = Bus(url)
        self._bus.subscribe(GYRO, 0, every=True)
        self._bus.subscribe(PROCESS_STATUS)

    def until_rate(self, rate: float, count: int) -> None:
        """Wait for so many valid readings of this rate in turn, from now on, and no complaint about the gyro."""
        deadline, in_turn, now = time.monotonic() + PATIENCE, 0, now_utime()
        while in_turn < count or "gyro" in self.message.lower():
            assert time.monotonic() < deadline, f"waited in vain; the driver says: {self.message}"
            for received in self._bus.receive(0.1):
                if (status := received.message_of(PROCESS_STATUS)) is not None:
                    self.message = status.message
                    continue
                self.readings.append(reading := as_a(gyro_t, received.message))
                right = reading.valid and math.isclose(reading.yaw_rate, rate, rel_tol=1e-3)
                in_turn = in_turn + 1 if right and reading.utime > now else 0

    def valid(self) -> list[float]:
        return [reading.yaw_rate for reading in self.readings if reading.valid]


def test_the_driver_publishes_the_rate_also_after_a_power_cycle_into_another_mode(tmp_path: Path) -> None:
    url = private_url()
    listener = Listener(url)
    with emulated(tmp_path / "ports", rate=250) as (gyro, ports):
        options = ["--port", str(ports / "motor"), "--gyro", "kvh-binary", "--gyro-port", str(ports / "gyro")]
        process = subprocess.Popen([*DRIVER, *options, "--lcm-url", url], stderr=subprocess.DEVNULL)
        try:
            listener.until_rate(RATE, 50)
            for changes in ({"sends_rate": True, "degrees": True}, {"rate": 100, "degrees": True}):
                gyro.switch_off_and_on(**changes)
                time.sleep(TIME_OFF)
                listener.until_rate(RATE, 50)
        finally:
            process.terminate()
            process.wait(PATIENCE)
    assert process.returncode == 130
    assert set(listener.valid()) <= gyro.truth
    assert all(math.isnan(reading.yaw_rate) for reading in listener.readings if not reading.valid)
    assert gyro.device.writes == 0


def test_settings_that_give_no_rates_are_explained_and_read_as_soon_as_a_person_has_changed_them(
    tmp_path: Path,
) -> None:
    published: list[Any] = []
    with emulated(tmp_path / "ports", rate=100) as (gyro, ports):
        gyro.device.kept["MSYNC"] = "EXT"
        port = SerialPort(str(ports / "gyro"), KvhBinary.baud_rate)
        with PortThread(port, GyroDevice(port, KvhBinary, robot_id=0, sign=-1, publish=published.append)) as thread:
            wait_for(lambda: "=ROTFMT to RATE" in thread.problem)
            assert published == []
            gyro.device.kept["MSYNC"] = "IMU"
            wait_for(lambda: sum(reading.valid for reading in published) > 20 and thread.problem == "")
    assert all(reading.yaw_rate < 0.0 for reading in published if reading.valid)
    assert all(reading.utime < reading.received_utime for reading in published)


def test_a_message_lost_amid_a_burst_bends_no_time_stamps() -> None:
    port = SerialPort("no port", KvhBinary.baud_rate)
    device = GyroDevice(port, KvhBinary, robot_id=0, sign=1, publish=print)
    device._gyro = interviewed(RATES | {"DR": "100"})
    errors, lost = [], {number for number in range(1000) if number % 35 in (7, 8, 32)}
    for burst in range(0, 1000, 5):
        numbers = [number for number in range(burst, burst + 5) if number not in lost]
        readings = device._gyro.feed(b"".join(message(0.1, number) for number in numbers))
        began = 10**12 + numbers[-1] * 10**7  # ns, of the last message, with which all of them come
        moments = device._measured(readings, began + round(1e9 * port.wire_time(36)))
        errors += [abs(moment - 10**12 - number * 10**7) / 1e9 for moment, number in zip(moments, numbers, strict=True)]
    assert max(errors[50:]) < 0.002
    assert device.lost == len(lost)


def wait_for(condition: Any) -> None:
    deadline = time.monotonic() + PATIENCE
    while not condition():
        assert time.monotonic() < deadline, "waited in vain"
        threading.Event().wait(0.01)

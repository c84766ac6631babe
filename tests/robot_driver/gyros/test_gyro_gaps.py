"""Promise 15 after short gaps: a gyro that may have been off meanwhile is not believed before its mode is known.

All time is virtual, so that gaps are as long as they are meant to be.
"""

import math
from collections.abc import Callable
from typing import Any

import pytest

from robot_driver.emulator.device import Device, Transmission
from robot_driver.emulator.dsp3000_device import INCREMENTAL_ANGLE, INTEGRATED_ANGLE, RATE, Dsp3000Device
from robot_driver.emulator.kvh_binary_device import KvhBinaryDevice
from robot_driver.emulator.plant import Plant
from robot_driver.emulator.settings import load_settings
from robot_driver.gyro_device import GyroDevice
from robot_driver.gyros import Gyro
from robot_driver.gyros.dsp3000 import Dsp3000
from robot_driver.gyros.kvh_binary import KvhBinary
from robot_driver.gyros.kvh_messages import Sample, Stream
from robot_driver.host import Host
from robot_driver.serial_port import SerialPort
from tests.robot_driver.emulator.test_emulator_kvh_binary import kvh_settings

SECOND = 10**9  # ns


class Time(Host):
    """The clock of driver and gyro; `now` in ns."""

    now = 0

    def monotonic_ns(self) -> int:
        return self.now

    def monotonic(self) -> float:
        return self.now / SECOND

    def sleep(self, seconds: float) -> None:
        self.now += round(seconds * SECOND)


class Line(SerialPort):
    """A port with an emulated gyro behind it.

    `truth` holds each rate (rad/s) that the gyro measured, as `rate_of` finds it in what is sent.
    """

    def __init__(self, device: Device, plant: Plant, rate_of: Callable[[bytes], float]) -> None:
        self.time = Time()
        super().__init__("no port", 38400, self.time)
        self.device = device
        self.silent = False
        self.sent_by_driver: list[bytes] = []
        self.truth: set[float] = set()
        self._plant = plant
        self._rate_of = rate_of
        self._coming: list[Transmission] = []

    def write(self, data: bytes) -> None:
        self.sent_by_driver.append(data)
        self._coming += self.device.receive(data, self.time.monotonic())

    def read(self, most: int, timeout: float) -> bytes:
        """Return what has come, else what comes next, unless that takes too long."""
        end = self.time.monotonic() + timeout
        while not (arrived := [coming for coming in self._coming if coming.time <= self.time.monotonic()]):
            upcoming = min([self.device.wake_time, *(coming.time for coming in self._coming)])
            if upcoming > end:
                self.time.now = round(end * SECOND)
                return b""
            self.time.now = max(self.time.now, math.ceil(upcoming * SECOND) + 1)  # a float may be a little late
            self._measure()
        self._measure()
        self._coming = [coming for coming in self._coming if coming not in arrived]
        data = b"".join(coming.data for coming in arrived)
        assert len(data) <= most
        return data

    def _measure(self) -> None:
        while (time := self.device.wake_time) <= self.time.monotonic():
            self._plant.advance(time)
            for sent in self.device.wake(time):
                self.truth.add(self._rate_of(sent.data))
                self._coming += [] if self.silent else [sent]


class Client:
    """The driver's gyro on such a line."""

    def __init__(self, line: Line, gyro_type: type[Gyro]) -> None:
        self.line = line
        self.published: list[Any] = []
        self.gyro = GyroDevice(line, gyro_type, robot_id=0, sign=1, publish=self.published.append)
        self.gyro.connect(None)  # type: ignore[arg-type]

    def run(self, seconds: float) -> list[Any]:
        """Take turns for so long; return what is published meanwhile."""
        seen, end = len(self.published), self.line.time.monotonic() + seconds
        while self.line.time.monotonic() < end:
            self.gyro.turn(None)  # type: ignore[arg-type]
        return self.published[seen:]

    def rates(self, seconds: float) -> list[float]:
        return [message.yaw_rate for message in self.run(seconds) if message.valid]


def slowly_turning(plant: Plant) -> Plant:
    """Return the robot, which turns at 0.02 rad/s: the scatter of its gyro is no less."""
    plant.command(-0.0011, 0.0011)
    return plant


def dsp3000() -> tuple[Client, Dsp3000Device]:
    settings = load_settings().ideal()
    plant = slowly_turning(Plant(settings))
    device = Dsp3000Device(settings, plant)

    def rate_of(line: bytes) -> float:
        return -math.radians(float(line.split()[0])) if device._mode == RATE else math.nan

    return Client(Line(device, plant, rate_of), Dsp3000), device


def kvh_binary() -> tuple[Client, KvhBinaryDevice]:
    settings = kvh_settings(rate=100)
    plant = slowly_turning(Plant(settings))
    device = KvhBinaryDevice(settings, plant)

    def rate_of(data: bytes) -> float:
        (sample,) = (said for said in Stream().feed(data) if isinstance(said, Sample))
        return sample.rotation[2] * (1 if device.kept["ROTFMT"] == "RATE" else 100)

    return Client(Line(device, plant, rate_of), KvhBinary), device


def go_silent(client: Client, seconds: float) -> None:
    client.line.silent = True
    client.run(seconds)
    client.line.silent = False


@pytest.mark.parametrize("mode", [INCREMENTAL_ANGLE, INTEGRATED_ANGLE])
@pytest.mark.parametrize("gap", [0.12, 0.4])
def test_15_a_dsp3000_that_comes_back_as_it_should_not_is_put_into_its_mode_before_it_is_believed(
    mode: int, gap: float
) -> None:
    client, device = dsp3000()
    rates = client.rates(2.0)
    assert len(rates) > 100
    go_silent(client, gap)
    device._mode = mode
    again = client.rates(2.0)
    assert len(again) > 100
    assert set(rates + again) <= client.line.truth


@pytest.mark.parametrize("gap", [0.12, 0.4])
def test_15_a_kvh_binary_gyro_that_comes_back_otherwise_is_asked_before_it_is_believed(gap: float) -> None:
    client, device = kvh_binary()
    rates = client.rates(2.0)
    assert len(rates) > 100
    go_silent(client, gap)
    device.kept["ROTFMT"] = "RATE"
    again = client.rates(2.0)
    assert len(again) > 100
    assert set(rates + again) <= client.line.truth


@pytest.mark.parametrize("make", [dsp3000, kvh_binary])
@pytest.mark.parametrize("busy", [0.09, 0.3, 0.9])
def test_15_readings_that_only_waited_for_a_busy_computer_are_believed(
    make: Callable[[], tuple[Client, Any]], busy: float
) -> None:
    client, _ = make()
    client.run(2.0)
    requests = len(client.line.sent_by_driver)
    client.line.time.sleep(busy)
    assert all(message.valid for message in client.run(1.0))
    assert len(client.line.sent_by_driver) == requests


def test_15_among_readings_that_waited_none_is_believed_if_some_are_missing() -> None:
    client, device = dsp3000()
    client.run(2.0)
    client.line.time.sleep(0.1)
    client.line._measure()
    client.line.silent = True
    client.line.time.sleep(0.3)
    client.line._measure()
    client.line.silent, device._mode = False, INCREMENTAL_ANGLE
    client.line.time.sleep(0.1)
    rates = client.rates(2.0)
    assert len(rates) > 100
    assert set(rates) <= client.line.truth


def test_14_nothing_is_believed_before_it_is_known_well_when_it_was_measured() -> None:
    client, _ = dsp3000()
    published = client.run(2.0)
    first = next(message for message in published if message.valid)
    assert 0.5e6 <= first.received_utime - published[0].received_utime < 0.6e6


@pytest.mark.parametrize("step", range(12))
def test_a_kvh_binary_gyro_is_asked_again_at_once_what_it_did_not_answer(
    step: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    settings = kvh_settings(rate=100)
    device = KvhBinaryDevice(settings, Plant(settings))
    receive, requests = device.receive, iter(range(1000))

    def receive_not_all(data: bytes, time: float) -> list[Transmission]:
        return [] if next(requests) == step else receive(data, time)

    monkeypatch.setattr(device, "receive", receive_not_all)
    client = Client(Line(device, Plant(settings), lambda _: 0.0), KvhBinary)
    published = client.run(0.4)
    assert len(published) > 15
    assert client.gyro.problem == ""


@pytest.mark.parametrize("answers", range(11))
def test_a_kvh_binary_gyro_is_not_left_in_configuration_mode(answers: int) -> None:
    client, device = kvh_binary()
    line = client.line
    while len(line.sent_by_driver) < 1 + answers:
        client.gyro.turn(None)  # type: ignore[arg-type]
    assert device._configuring
    left = line.time.monotonic()
    client.gyro.leave()
    assert not device._configuring
    assert line.time.monotonic() - left < 0.2


def test_a_kvh_binary_gyro_that_sends_readings_is_told_nothing_at_the_end() -> None:
    client, _ = kvh_binary()
    client.run(1.0)
    told = list(client.line.sent_by_driver)
    client.gyro.leave()
    assert client.line.sent_by_driver == told

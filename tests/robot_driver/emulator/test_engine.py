"""The engine lets everything happen at its exact time, and its end is noticed."""

import math
import socket
import time
from collections.abc import Callable

import pytest

from robot_driver.emulator.device import Transmission
from robot_driver.emulator.engine import CLOCKS_TOGETHER, Engine
from robot_driver.emulator.plant import Plant
from robot_driver.emulator.settings import load_settings

pytestmark = pytest.mark.waits

PATIENCE = 20.0  # s


class SocketPort:
    """A port whose client is the other end of a pair of sockets."""

    is_open = True

    def __init__(self) -> None:
        self._socket, self.client = socket.socketpair()
        self.client.settimeout(PATIENCE)

    def fileno(self) -> int:
        return self._socket.fileno()

    def read(self) -> bytes:
        return self._socket.recv(4096)

    def write(self, data: bytes) -> None:
        self._socket.sendall(data)


class EchoDevice:
    """A device that sends back what it receives and notes when it did and where the plant was."""

    byte_time = 0.01
    wake_time = math.inf

    def __init__(self, plant: Plant, fail: bool = False) -> None:
        self.received: list[tuple[bytes, float, float]] = []
        self._plant = plant
        self._fail = fail

    def receive(self, data: bytes, time: float) -> list[Transmission]:
        if self._fail:
            raise ArithmeticError("broken device")
        self.received.append((data, time, self._plant.time))
        return [Transmission(time + len(data) * self.byte_time, data)]

    def wake(self, time: float) -> list[Transmission]:
        raise AssertionError(f"woken at {time}, though it never asked for that")


def wait_until(condition: Callable[[], bool]) -> None:
    deadline = time.monotonic() + PATIENCE
    while not condition() and time.monotonic() < deadline:
        time.sleep(0.01)


def test_bytes_take_their_time_on_the_wire_both_ways_and_queue_behind_one_another() -> None:
    plant, port = Plant(load_settings()), SocketPort()
    device = EchoDevice(plant)
    with Engine(plant, {"motor": device}, {"motor": port}) as engine:
        sent = engine.now()
        port.client.send(b"12345")
        time.sleep(0.02)
        port.client.send(b"678")
        echoed = b""
        while len(echoed) < 8:
            echoed += port.client.recv(100)
        answered = engine.now()
    times = [received[1] for received in device.received]
    assert [received[0] for received in device.received] == [b"12345", b"678"]
    assert times[0] - sent >= 0.05
    assert times[1] - times[0] >= 0.03 - 1e-9  # not before the first had arrived, however early it was sent
    assert answered - times[1] >= 0.03


def test_the_plant_stands_at_the_very_moment_of_the_event() -> None:
    plant, port = Plant(load_settings()), SocketPort()
    device = EchoDevice(plant)
    with Engine(plant, {"motor": device}, {"motor": port}):
        port.client.send(b"1")
        port.client.recv(1)
    _, moment, plant_time = device.received[0]
    assert plant_time == moment


def test_a_failure_in_the_thread_is_raised_where_it_is_asked_for() -> None:
    plant, port = Plant(load_settings()), SocketPort()
    with Engine(plant, {"motor": EchoDevice(plant, fail=True)}, {"motor": port}) as engine:
        engine.check()
        port.client.send(b"1")
        wait_until(lambda: engine.failure is not None)
        with pytest.raises(ArithmeticError, match="broken device"):
            engine.check()


def test_stamps_are_the_time_of_day_of_the_moment() -> None:
    plant = Plant(load_settings())
    with Engine(plant, {"motor": EchoDevice(plant)}, {"motor": SocketPort()}) as engine:
        before = time.time_ns() // 1000
        stamp = engine.utime(engine.now() - 10.0)
        after = time.time_ns() // 1000
    apart = CLOCKS_TOGETHER * 1e6 + 1  # us: the two clocks are read one after the other
    assert before - 10_000_000 - apart <= stamp <= after - 10_000_000 + apart

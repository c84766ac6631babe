"""The driver's motor thread against the emulated RoboClaw on a pseudo-terminal, with a line as bad as one likes."""

import dataclasses
import os
import struct
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from cmr.bus.messages import now_utime
from robot_driver.command_gate import CommandGate
from robot_driver.controllers.roboclaw import RoboClaw
from robot_driver.emulator.engine import Engine
from robot_driver.emulator.faults import Faults, FaultyLine
from robot_driver.emulator.plant import Plant
from robot_driver.emulator.pseudo_terminal import Ports
from robot_driver.emulator.roboclaw_device import RoboclawDevice
from robot_driver.emulator.settings import load_settings
from robot_driver.encoders import Wiring
from robot_driver.motors import Motors
from robot_driver.port_thread import PortThread
from robot_driver.ramp import Limits
from robot_driver.serial_port import SerialPort

READ_ENCODERS = bytes((0x80, 78))


def number(name: str, default: int) -> int:
    """Return how often a test does what it does: `default` in CI, else what the environment says."""
    return int(os.environ.get(name, default))


def wait_for(condition: Callable[[], object], seconds: float = 20.0) -> None:
    deadline = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < deadline, "waited in vain"
        time.sleep(0.002)


class Bench:
    """A running emulator and the motor thread of the driver on it, with what that publishes."""

    def __init__(self, line: FaultyLine, device: RoboclawDevice, motors: Motors, gate: CommandGate) -> None:
        self.line = line
        self.device = device
        self.motors = motors
        self.gate = gate
        self.feedback: list[Any] = []
        self.thread: PortThread

    def command(self, left: float, right: float) -> None:
        self.gate.offer(now_utime(), left, right, now=time.monotonic(), utime=now_utime())

    def until_transactions(self, count: int) -> None:
        """Drive to and fro until the device has been asked so many times more."""
        end = len(self.line.truth) + count
        while len(self.line.truth) < end:
            assert self.thread.failure is None
            self.command(0.4 if len(self.line.truth) // 200 % 2 else -0.3, 0.2)
            time.sleep(0.02)

    def counts_answered(self) -> list[tuple[int, int]]:
        """Return all encoder counts that the device has answered with, undamaged, before the wire."""
        return [struct.unpack(">II", reply[:8]) for _, reply in list(self.line.truth) if len(reply) == 10]


@contextmanager
def bench(folder: Path, faults: Faults | None = None, *, rate_hz: float = 100.0, baud: int = 115200) -> Iterator[Bench]:
    settings = load_settings().ideal()
    settings = dataclasses.replace(settings, roboclaw=dataclasses.replace(settings.roboclaw, baud=baud))
    plant = Plant(settings)
    device = RoboclawDevice(settings, plant)
    line = FaultyLine(device, faults or Faults())
    port, gate = SerialPort(str(folder / "motor"), baud), CommandGate()
    motors = Motors(
        port,
        RoboClaw,
        gate,
        robot_id=0,
        rate_hz=rate_hz,
        ticks_per_turn=2048,
        wiring=Wiring(),
        limits=Limits(),
        publish=lambda message: result.feedback.append(message),
    )
    result = Bench(line, device, motors, gate)
    with Ports(folder, ("motor",)) as ports, Engine(plant, {"motor": line}, ports.terminals) as engine:
        with PortThread(port, motors) as result.thread:
            wait_for(lambda: len(result.feedback) > 2)
            yield result
        engine.check()

"""The driver's motor thread against the emulated RoboClaw on a pseudo-terminal, with a line as bad as one likes."""

import dataclasses
import multiprocessing
import os
import signal
import struct
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from functools import cache
from itertools import pairwise
from multiprocessing.synchronize import Event as EventOfProcesses
from pathlib import Path
from typing import Any

from cmr.bus.bus import Bus
from cmr.bus.messages import make, now_utime
from cmr.bus.streams import ESTOP, MOTOR_COMMAND, PROCESS_STATUS
from cmr.model.duty_ramp import Limits
from cmr.msg import estop_t, motor_command_t, process_status_t
from cmr.priority import go_first
from robot_driver.battery import Thresholds
from robot_driver.clock import seconds_since_boot
from robot_driver.command_gate import LISTENING_TIME, CommandGate
from robot_driver.controllers.roboclaw import RoboClaw
from robot_driver.driver import Driver
from robot_driver.emulator.device import Transmission
from robot_driver.emulator.engine import Engine
from robot_driver.emulator.faults import Faults, FaultyLine
from robot_driver.emulator.plant import Plant
from robot_driver.emulator.roboclaw_device import RoboclawDevice
from robot_driver.emulator.settings import Settings, load_settings
from robot_driver.encoders import Wiring
from robot_driver.motors import Motors
from robot_driver.port_thread import PortThread
from robot_driver.rhythm import Rhythm
from robot_driver.serial_port import SerialPort
from robot_driver.terminals.pseudo_terminal import Ports
from tests.support.private_bus import private_url
from tests.support.stalls import Interval

ENCODER_REPLY = 10  # bytes


PATIENCE = 20.0  # s


def number(name: str, default: int) -> int:
    """Return how often a test does what it does: `default` in CI, else what the environment says."""
    return int(os.environ.get(name, default))


def wait_for(condition: Callable[[], object], seconds: float = PATIENCE) -> None:
    deadline = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < deadline, "waited in vain"
        time.sleep(0.002)


def open_gate() -> CommandGate:
    """A gate that has listened for an emergency stop for long enough, and to which zero was commanded."""
    gate = CommandGate()
    gate.note_listening(seconds_since_boot() - LISTENING_TIME)
    gate.offer(now_utime(), 0.0, 0.0, now=seconds_since_boot(), utime=now_utime())
    return gate


def open_gate_of(driver: Driver) -> None:
    """Have a driver that is not on a bus listen to it for long enough, and command zero."""
    driver.turn()
    driver._gate.note_listening(seconds_since_boot() - LISTENING_TIME)
    zero = make(motor_command_t, utime=now_utime(), robot_id=driver._robot_id, left=0.0, right=0.0)
    driver.handle(zero.utime, MOTOR_COMMAND.channel(driver._robot_id), zero)


class NotedDevice(RoboclawDevice):
    """A RoboClaw that notes what is true whenever its encoders are read: both counts, and both duties."""

    def __init__(self, settings: Settings, plant: Plant) -> None:
        super().__init__(settings, plant)
        self.readings: list[tuple[int, int, int, int]] = []

    def receive(self, data: bytes, time: float) -> list[Transmission]:
        answers = super().receive(data, time)
        for answer in answers:
            if len(answer.data) == ENCODER_REPLY:
                left, right = struct.unpack(">II", answer.data[:8])
                self.readings.append((left, right, *self.duty))
        return answers


class PunctualEngine(Engine):
    """An emulator that plays hardware: what else the machine does is not to hold it up."""

    def _run(self) -> None:
        go_first()
        super()._run()


class NotedRhythm(Rhythm):
    """Notes when each turn began (s of the monotonic clock)."""

    def __init__(self) -> None:
        super().__init__()
        self.turns: list[float] = []

    def note_turn(self) -> None:
        super().note_turn()
        self.turns.append(time.monotonic())

    def intervals(self) -> list[Interval]:
        """Return from when to when each period lasted."""
        return [Interval(*turns) for turns in pairwise(list(self.turns))]


class Bench:
    """A running emulator and the motor thread of the driver on it, with what that publishes."""

    def __init__(self, line: FaultyLine, device: NotedDevice) -> None:
        self.line = line
        self.device = device
        self.gate = open_gate()
        self.feedback: list[Any] = []
        self.motors: Motors
        self.thread: PortThread

    def command(self, left: float, right: float) -> None:
        self.gate.offer(now_utime(), left, right, now=seconds_since_boot(), utime=now_utime())

    def until(self, condition: Callable[[], object], seconds: float = PATIENCE) -> None:
        """Command some duty until the condition holds."""

        def commanded() -> object:
            self.command(0.2, 0.2)
            return condition()

        wait_for(commanded, seconds)

    def until_moving(self) -> None:
        self.until(lambda: self.device.duty == [6553, 6553])

    def set_battery(self, voltage: float) -> None:
        self.device.board.plant._electrics = dataclasses.replace(load_settings().electrics, battery_voltage=voltage)

    def until_transactions(self, count: int) -> None:
        """Drive to and fro until the device has been asked so many times more."""
        end = len(self.line.truth) + count
        while len(self.line.truth) < end:
            assert self.thread.failure is None
            self.command(0.4 if len(self.line.truth) // 200 % 2 else -0.3, 0.2)
            time.sleep(0.02)


@contextmanager
def bench(
    folder: Path,
    faults: Faults | None = None,
    *,
    rate_hz: float = 100.0,
    baud: int = 115200,
    thresholds: Thresholds = Thresholds(),  # noqa: B008 - it is frozen
) -> Iterator[Bench]:
    with _emulated(folder, faults or Faults(), baud) as (line, device):
        result, port = Bench(line, device), SerialPort(str(folder / "motor"), baud)
        result.motors = _motors(port, result.gate, rate_hz, thresholds, result.feedback.append)
        with PortThread(port, result.motors) as result.thread:
            wait_for(lambda: len(result.feedback) > 2)
            yield result


@contextmanager
def bench_apart(folder: Path, faults: Faults, *, rate_hz: float) -> Iterator[Motors]:
    """The motor thread, on an emulator that runs in another process and so takes no time from it."""
    context = multiprocessing.get_context("spawn")
    ready, stop = context.Event(), context.Event()
    emulator = context.Process(target=_emulate, args=(folder, faults, ready, stop))
    emulator.start()
    try:
        assert ready.wait(20.0)
        feedback: list[Any] = []
        motors = _motors(SerialPort(str(folder / "motor"), 115200), open_gate(), rate_hz, Thresholds(), feedback.append)
        with PortThread(motors._port, motors) as thread:
            wait_for(lambda: len(feedback) > 2)
            yield motors
            assert thread.problem == ""
    finally:
        stop.set()
        emulator.join()


def _emulate(folder: Path, faults: Faults, ready: EventOfProcesses, stop: EventOfProcesses) -> None:
    with _emulated(folder, faults, 115200):
        ready.set()
        stop.wait()


@contextmanager
def _emulated(folder: Path, faults: Faults, baud: int) -> Iterator[tuple[FaultyLine, NotedDevice]]:
    settings = load_settings().ideal()
    settings = dataclasses.replace(settings, roboclaw=dataclasses.replace(settings.roboclaw, baud=baud))
    plant = Plant(settings)
    device = NotedDevice(settings, plant)
    line = FaultyLine(device, faults)
    with Ports(folder, ("motor",)) as ports, PunctualEngine(plant, {"motor": line}, ports.terminals) as engine:
        yield line, device
        engine.check()


def _motors(
    port: SerialPort, gate: CommandGate, rate_hz: float, thresholds: Thresholds, publish: Callable[[Any], None]
) -> Motors:
    return Motors(
        port,
        RoboClaw,
        gate,
        robot_id=0,
        rate_hz=rate_hz,
        ticks_per_turn=2048,
        wiring=Wiring(),
        limits=Limits(),
        thresholds=thresholds,
        publish=publish,
        publish_duty=lambda _: None,
    )


@cache
def _bus(url: str) -> Bus:
    """Return a bus for all tests of a session: LCM keeps what it has opened."""
    bus = Bus(url)
    bus.subscribe(PROCESS_STATUS, every=True)
    return bus


URL = private_url()
START_DRIVER = [sys.executable, "-c", "import sys; from cmr.commands import driver; sys.exit(driver())"]


class Robot:
    """An emulated RoboClaw behind `folder`/motor that can be unplugged; `drives` holds (time, duty M1, duty M2)."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.drives: list[tuple[float, int, int]] = []
        self.plug_in()

    def plug_in(self) -> None:
        """Switch on a robot that knows nothing of the past."""
        plant = Plant(load_settings().ideal())

        def noted(left: float, right: float) -> None:
            self.drives.append((time.monotonic(), round(left * 32767), round(right * 32767)))
            plant.command(left, right)

        self.device = RoboclawDevice(load_settings().ideal(), plant, noted)
        with ExitStack() as stack:
            ports = stack.enter_context(Ports(self.folder, ("motor",)))
            stack.enter_context(PunctualEngine(plant, {"motor": self.device}, ports.terminals))
            self._plugged_in = stack.pop_all()

    def unplug(self) -> None:
        self._plugged_in.close()


class DriverProcess:
    """A running cmr-driver on a bus of its own, and the commands it gets."""

    def __init__(self, folder: Path, *arguments: str) -> None:
        self.bus = _bus(URL)
        self.bus.receive(0.0)
        self.heard: list[Any] = []
        self.statuses: list[Any] = []
        self.in_service = False
        command = [*START_DRIVER, "--port", str(folder / "motor"), "--lcm-url", URL, *arguments]
        # Where an engaged stop is kept: each test has its own, but not each driver of a test.
        environment = {**os.environ, "XDG_STATE_HOME": str(folder / "state")}
        self.process = subprocess.Popen(command, stderr=subprocess.PIPE, text=True, env=environment)

    def command_until(self, condition: Callable[[], object], left: float = 0.5, right: float = 0.5) -> None:
        """Command this duty at 50 Hz until `condition` holds."""

        def commanded() -> object:
            self.command(left, right)
            self.listen(0.02)
            return condition()

        wait_for(commanded)

    def command(self, left: float, right: float) -> None:
        """Command a duty; zero for as long as the driver was not in service, as every pilot must."""
        if not self.in_service:
            left = right = 0.0
        command = make(motor_command_t, utime=now_utime(), robot_id=0, left=left, right=right)
        self.bus.publish(MOTOR_COMMAND, command, 0)
        self.in_service |= any(status.state == process_status_t.RUNNING for status in self._own_statuses())

    def estop(self, engaged: bool, *, age: float = 0.0) -> None:
        """Engage or release the emergency stop by a message that was made `age` seconds ago."""
        utime = now_utime() - round(1e6 * age)
        self.bus.publish(ESTOP, make(estop_t, utime=utime, engaged=engaged, source="test", reason="test"))

    def listen(self, seconds: float) -> None:
        heard = [received.message for received in self.bus.receive(seconds)]
        self.heard += heard
        self.statuses += [message for message in heard if isinstance(message, process_status_t)]

    def _own_statuses(self) -> list[Any]:
        return [status for status in self.statuses if status.pid == self.process.pid]

    def end(self, signal_number: int = signal.SIGTERM) -> tuple[int, str]:
        """Send a signal; return the exit code and what was written to stderr."""
        if self.process.poll() is None:
            self.process.send_signal(signal_number)
        _, errors = self.process.communicate(timeout=20.0)
        return self.process.returncode, errors


@contextmanager
def driving(folder: Path) -> Iterator[tuple[Robot, DriverProcess]]:
    """A robot that moves because cmr-driver obeys commands of half duty."""
    robot = Robot(folder)
    driver = DriverProcess(folder)
    try:
        driver.command_until(lambda: robot.device.duty == [16384, 16384])
        yield robot, driver
    finally:
        driver.end(signal.SIGKILL)
        robot.unplug()

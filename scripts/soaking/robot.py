"""The emulated robot of a soak, in a process of its own: its lines fail on request, and it says what was true.

What it was driven with, what its devices said before any damage, and every damage go to the other process as records,
stamped by the moment at which they happened to the device.
"""

import math
import queue
import signal
from collections import deque
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import replace
from multiprocessing.connection import Connection
from pathlib import Path
from time import monotonic
from typing import Any, NamedTuple

from robot_driver.emulator.device import Device, Transmission
from robot_driver.emulator.devices import GYRO_DEVICES
from robot_driver.emulator.dsp3000_device import INCREMENTAL_ANGLE, RATE, Dsp3000Device
from robot_driver.emulator.engine import Engine
from robot_driver.emulator.faults import Faults, FaultyLine
from robot_driver.emulator.plant import Plant
from robot_driver.emulator.roboclaw_device import RoboclawDevice
from robot_driver.emulator.settings import Settings, load_settings
from robot_driver.terminals.pseudo_terminal import PseudoTerminal
from soaking.truth import said_by_dsp3000, said_by_kvh, said_by_roboclaw

LOOK = 0.01  # s between looks at what is to be done
LATE = 0.005  # s by which the machine may hold the emulator up before that is reported
BURST = 0.05  # s for which an adapter that sends in bursts holds bytes back
FLUSH = 0.05  # s between deliveries of records
START_UP = 1.0  # s for which a gyro that was switched on says that its readings are not valid
GYRO_PERIOD = 10_000  # us; of both kinds
RESET_ENCODERS = bytes.fromhex("8014492d")  # a RoboClaw that was reset counts from zero
FULL_DUTY = 32767
SECOND = 1_000_000  # us

Note = Callable[[float, str, Any], None]  # takes the time (s of the engine), what kind of thing happened, its value
Saying = Callable[[bytes], Any]  # bytes of a device to (kind, value) pairs


class Record(NamedTuple):
    """Something that happened to a device at `utime` (us since the Unix epoch)."""

    utime: int
    kind: str
    value: Any


class Order(NamedTuple):
    """What is to happen: the name of a line, that of one of its methods, and what to give it."""

    line: str
    action: str
    values: tuple[Any, ...] = ()


class Plug:
    """A serial port that can be pulled out and put back; all its methods are called by the engine's thread."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._terminal: PseudoTerminal | None = PseudoTerminal(path)

    def pull(self) -> None:
        """Take the port away."""
        if self._terminal is not None:
            self._terminal.close()
            self._terminal = None

    def put_back(self) -> None:
        """Offer it again, behind the same name."""
        self._terminal = self._terminal or PseudoTerminal(self._path)

    def fileno(self) -> int:
        """Return the file descriptor to wait on while the port is open."""
        return self._terminal.fileno() if self._terminal is not None else -1

    @property
    def is_open(self) -> bool:
        """Return whether a client has the port open."""
        return self._terminal is not None and self._terminal.is_open

    def read(self) -> bytes:
        """Return what the client has sent."""
        return self._terminal.read() if self._terminal is not None else b""

    def write(self, data: bytes) -> None:
        """Send to the client."""
        if self._terminal is not None:
            self._terminal.write(data)


class Off:
    """A device without power."""

    wake_time = math.inf
    byte_time = 0.0

    def receive(self, _data: bytes, _time: float) -> list[Transmission]:
        """Do nothing."""
        return []

    def wake(self, _time: float) -> list[Transmission]:
        """Do nothing."""
        return []


class Truthful:
    """`device`, of which `note` gets everything it says; another may take its place."""

    def __init__(self, device: Device, said: Saying, note: Note) -> None:
        self.device = device
        self.byte_time = device.byte_time
        self._said = said
        self._note = note

    @property
    def wake_time(self) -> float:
        """When the device next acts of its own accord."""
        return self.device.wake_time

    def receive(self, data: bytes, time: float) -> list[Transmission]:
        """Take bytes."""
        return self._noted(self.device.receive(data, time), time)

    def wake(self, time: float) -> list[Transmission]:
        """Act."""
        return self._noted(self.device.wake(time), time)

    def _noted(self, sent: list[Transmission], time: float) -> list[Transmission]:
        for transmission in sent:
            for kind, value in self._said(transmission.data):
                self._note(time, kind, value)
        return sent


class Line(FaultyLine):
    """A device at the end of a cable; the engine's thread carries out what is put into `orders`."""

    def __init__(self, name: str, device: Truthful, plug: Plug, note: Note, seed: int) -> None:
        super().__init__(device, Faults(), seed)
        self.orders: queue.SimpleQueue[Order] = queue.SimpleQueue()
        self.end = device
        self._name = name
        self._plug = plug
        self._note = note
        self._next_look = 0.0
        self._bursting = False
        self._damages = 0
        self._start = math.inf  # of the engine, by the monotonic clock (s)

    @property
    def wake_time(self) -> float:
        """When the device acts, or orders are looked at."""
        return min(self._next_look, self.end.wake_time)

    def wake(self, time: float) -> list[Transmission]:
        """Carry out orders; let the device act if it is its time."""
        if self._next_look <= time:
            self._note_lateness(time)
            self._next_look = time + LOOK
            while not self.orders.empty():
                order = self.orders.get()
                getattr(self, order.action)(time, *order.values)
        return self._on_its_way(super().wake(time), time) if self.end.wake_time <= time else []

    def receive(self, data: bytes, time: float) -> list[Transmission]:
        """Take bytes, perhaps damaged on their way."""
        sent = super().receive(data, time)
        self.truth.clear()  # noted elsewhere, with its time
        return self._on_its_way(sent, time)

    def fail(self, _time: float, fault: str, value: Any) -> None:
        """Change one of the faults of the line."""
        setattr(self.faults, fault, value)

    def burst(self, _time: float, on: bool) -> None:
        """Hold everything back for a while and send it at once; or end that."""
        self._bursting = on

    def pull(self, _time: float) -> None:
        """Unplug the cable."""
        self._plug.pull()

    def put_back(self, _time: float) -> None:
        """Plug it in again."""
        self._plug.put_back()

    def _note_lateness(self, due: float) -> None:
        """Note by how much the machine holds this process up."""
        now = monotonic()
        self._start = min(self._start, now - due)
        if (late := now - self._start - due) > LATE:
            self._note(due, "late", (self._name, round(late * SECOND)))

    def _on_its_way(self, sent: list[Transmission], time: float) -> list[Transmission]:
        """Note what was damaged; return when the rest comes."""
        damages, self._damages = self.damaged.total() - self._damages, self.damaged.total()
        if damages:
            self._note(time, "damage", (self._name, damages))
            for transmission in sent:
                self._note_changed(transmission.data, time)
        if not self._bursting:
            return sent
        return [Transmission(math.ceil(moment / BURST) * BURST, data) for moment, data in sent]

    def _note_changed(self, data: bytes, time: float) -> None:
        """Note what can be read from damaged bytes; nothing where there is a checksum."""


class MotorLine(Line):
    """A RoboClaw on its cable."""

    def __init__(self, settings: Settings, plant: Plant, plug: Plug, note: Note, seed: int) -> None:
        self._settings = settings
        self._plant = plant
        self._tell = note
        self._dip_ends = math.inf
        super().__init__("motor", Truthful(self._made(), said_by_roboclaw, note), plug, note, seed)

    def power_off(self, _time: float) -> None:
        """Let its power fail: the motors are driven no longer."""
        self._drive(0.0, 0.0)
        self.end.device = Off()

    def power_on(self, time: float) -> None:
        """Switch it on: it has forgotten everything."""
        self.end.device = self._made()
        self.end.device.receive(RESET_ENCODERS, time)

    def wake(self, time: float) -> list[Transmission]:
        """End a dip of the battery by the robot's own clock: however busy the machine is, it lasts no longer."""
        if self._dip_ends <= time:
            self._dip_ends = math.inf
            self._plant._electrics = self._settings.electrics
        return super().wake(time)

    def dip(self, time: float, voltage: float, seconds: float) -> None:
        """Have the battery at this voltage (V) for so long (s)."""
        self._dip_ends = time + seconds
        self._plant._electrics = replace(self._settings.electrics, battery_voltage=voltage)

    def _made(self) -> Device:
        return RoboclawDevice(self._settings, self._plant, self._drive)

    def _drive(self, left: float, right: float) -> None:
        self._plant.command(left, right)
        self._tell(self._plant.time, "duty", (round(left * FULL_DUTY), round(right * FULL_DUTY)))


class GyroLine(Line):
    """A gyro on its cable."""

    def __init__(self, kind: str, settings: Settings, plant: Plant, plug: Plug, note: Note, seed: int) -> None:
        self._kind = kind
        self._settings = settings
        self._plant = plant
        super().__init__("gyro", Truthful(self._made(0.0, 0.0), self._said, note), plug, note, seed)

    def power_off(self, _time: float) -> None:
        """Switch it off."""
        self.end.device = Off()

    def power_on(self, time: float) -> None:
        """Switch it on; a DSP-3000 sends angles then, as if somebody had meanwhile used it otherwise."""
        self.end.device = self._made(time, time + START_UP)
        if isinstance(self.end.device, Dsp3000Device):
            self.end.device.receive(bytes([INCREMENTAL_ANGLE]), time)

    def invalid(self, time: float, seconds: float) -> None:
        """Have it send readings that it says are not valid; it is not a new one, which would report its self-test."""
        device: Any = self.end.device
        if isinstance(device, Dsp3000Device):
            device._start_up = time + seconds
        else:
            device._valid_from = time + seconds

    def _made(self, time: float, valid_from: float) -> Any:
        """Return a gyro that was switched on at `time` (s)."""
        settings = replace(
            self._settings,
            dsp3000=replace(self._settings.dsp3000, start_up=valid_from),
            kvh_binary=replace(self._settings.kvh_binary, start_up=valid_from),
        )
        device: Any = GYRO_DEVICES[self._kind](settings, self._plant)
        device.wake_time += time
        return device

    def _said(self, data: bytes) -> Any:
        if self._kind == "kvh-binary":
            return said_by_kvh(data, 1.0 / self._settings.kvh_binary.rate)
        device = self.end.device
        sends_rates = isinstance(device, Dsp3000Device) and device._mode == RATE
        return said_by_dsp3000(data) if sends_rates else ()

    def _note_changed(self, data: bytes, time: float) -> None:
        if self._kind == "dsp3000":
            for _, reading in said_by_dsp3000(data):
                self._note(time, "misheard", reading)


def run(connection: Connection, folder: Path, gyro: str, seed: int) -> None:
    """Emulate until the other end of `connection` closes; take Orders, send lists of Records."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    settings = load_settings(seed=seed).ideal()
    settings = replace(settings, kvh_binary=replace(settings.kvh_binary, rate=SECOND // GYRO_PERIOD))
    plant = Plant(settings)
    noted: deque[tuple[float, str, Any]] = deque()

    def note(time: float, kind: str, value: Any) -> None:
        noted.append((time, kind, value))

    plugs = {name: Plug(folder / name) for name in ("motor", "gyro")}
    lines: dict[str, Line] = {
        "motor": MotorLine(settings, plant, plugs["motor"], note, seed),
        "gyro": GyroLine(gyro, settings, plant, plugs["gyro"], note, seed + 1),
    }
    with ExitStack() as stack:
        for plug in plugs.values():
            stack.callback(plug.pull)
        engine = stack.enter_context(Engine(plant, lines, plugs))
        connection.send([])
        _serve(connection, engine, plant, lines, noted)


def _serve(
    connection: Connection, engine: Engine, plant: Plant, lines: dict[str, Line], noted: deque[tuple[float, str, Any]]
) -> None:
    due = monotonic()
    while True:
        due = max(due + FLUSH, monotonic())
        try:
            while connection.poll(max(due - monotonic(), 0.0)):
                order = connection.recv()
                lines[order.line].orders.put(order)
            engine.check()
            upto, start = plant.time, engine.utime(0.0)
            records = [noted.popleft() for _ in range(len(noted))]
            records_so_far = [Record(start + round(1e6 * moment), kind, value) for moment, kind, value in records]
            connection.send([*records_so_far, Record(start + round(1e6 * upto), "upto", None)])
        except (EOFError, OSError):
            return

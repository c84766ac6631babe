"""The emulated robot of a soak test, in a process of its own: its lines fail on request, and it records ground truth.

The duties of its motors, the values that its devices sent before any damage, and every damage are sent to the other
process as records, with the time at which they happened in the device.
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
from soaking.decoding import decode_dsp3000, decode_kvh, decode_roboclaw

ORDER_PERIOD = 0.01  # s between checks for orders
LATE = 0.005  # s by which the emulator may run late before that is recorded
BURST = 0.05  # s between bursts of an adapter that holds bytes back
RECORD_PERIOD = 0.05  # s between deliveries of records
START_UP = 1.0  # s for which a gyro's readings are invalid after it was switched on
GYRO_PERIOD = 10_000  # us; of both gyros
RESET_ENCODERS = bytes.fromhex("8014492d")  # command; a RoboClaw counts from zero after power-on
FULL_DUTY = 32767
US_PER_S = 1_000_000  # us

Note = Callable[[float, str, Any], None]  # arguments: time [s of the engine], kind of record, value
Decode = Callable[[bytes], Any]  # from the bytes of a device to (kind, value) pairs


class Record(NamedTuple):
    """An event in a device at `utime` [us since the Unix epoch]."""

    utime: int
    kind: str
    value: Any


class Order(NamedTuple):
    """An order to the emulated robot: the name of a line, the name of its method, and the method's arguments."""

    line: str
    action: str
    values: tuple[Any, ...] = ()


class Plug:
    """A serial port that can be unplugged and plugged in again; only the engine's thread calls its methods."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._terminal: PseudoTerminal | None = PseudoTerminal(path)

    def pull(self) -> None:
        """Remove the port."""
        if self._terminal is not None:
            self._terminal.close()
            self._terminal = None

    def put_back(self) -> None:
        """Add the port again, with the same name."""
        self._terminal = self._terminal or PseudoTerminal(self._path)

    def fileno(self) -> int:
        """Return the file descriptor to wait on while the port is open."""
        return self._terminal.fileno() if self._terminal is not None else -1

    @property
    def is_open(self) -> bool:
        """Return whether a client has the port open."""
        return self._terminal is not None and self._terminal.is_open

    def read(self) -> bytes:
        """Return the bytes that the client has sent."""
        return self._terminal.read() if self._terminal is not None else b""

    def write(self, data: bytes) -> None:
        """Send bytes to the client."""
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


class RecordedDevice:
    """Wraps a replaceable `device`, and records all values that it sends with `note`."""

    def __init__(self, device: Device, decode: Decode, note: Note) -> None:
        self.device = device
        self.byte_time = device.byte_time
        self._decode = decode
        self._note = note

    @property
    def wake_time(self) -> float:
        """The time at which the device next acts by itself [s of the engine]."""
        return self.device.wake_time

    def receive(self, data: bytes, time: float) -> list[Transmission]:
        """Give bytes to the device; return its answer."""
        return self._noted(self.device.receive(data, time), time)

    def wake(self, time: float) -> list[Transmission]:
        """Let the device act by itself; return what it sends."""
        return self._noted(self.device.wake(time), time)

    def _noted(self, sent: list[Transmission], time: float) -> list[Transmission]:
        for transmission in sent:
            for kind, value in self._decode(transmission.data):
                self._note(time, kind, value)
        return sent


class Line(FaultyLine):
    """A device at the end of a cable; the engine's thread carries out the `orders`."""

    def __init__(self, name: str, device: RecordedDevice, plug: Plug, note: Note, seed: int) -> None:
        super().__init__(device, Faults(), seed)
        self.orders: queue.SimpleQueue[Order] = queue.SimpleQueue()
        self.end = device
        self._name = name
        self._plug = plug
        self._note = note
        self._next_orders = 0.0
        self._bursting = False
        self._damages = 0
        self._start = math.inf  # of the engine [s of the monotonic clock]

    @property
    def wake_time(self) -> float:
        """The time at which the device acts or orders are due [s of the engine]."""
        return min(self._next_orders, self.end.wake_time)

    def wake(self, time: float) -> list[Transmission]:
        """Carry out orders, and let the device act if it is due."""
        if self._next_orders <= time:
            self._note_lateness(time)
            self._next_orders = time + ORDER_PERIOD
            while not self.orders.empty():
                order = self.orders.get()
                getattr(self, order.action)(time, *order.values)
        return self._on_its_way(super().wake(time), time) if self.end.wake_time <= time else []

    def receive(self, data: bytes, time: float) -> list[Transmission]:
        """Pass bytes to the device, possibly damaged; return its answer."""
        sent = super().receive(data, time)
        self.truth.clear()  # recorded elsewhere, with its time
        return self._on_its_way(sent, time)

    def fail(self, _time: float, fault: str, value: Any) -> None:
        """Change one of the faults of the line."""
        setattr(self.faults, fault, value)

    def burst(self, _time: float, on: bool) -> None:
        """Begin or end sending in bursts."""
        self._bursting = on

    def pull(self, _time: float) -> None:
        """Unplug the cable."""
        self._plug.pull()

    def put_back(self, _time: float) -> None:
        """Plug the cable in again."""
        self._plug.put_back()

    def _note_lateness(self, due: float) -> None:
        """Record by how much this process runs late."""
        now = monotonic()
        self._start = min(self._start, now - due)
        if (late := now - self._start - due) > LATE:
            self._note(due, "late", (self._name, round(late * US_PER_S)))

    def _on_its_way(self, sent: list[Transmission], time: float) -> list[Transmission]:
        """Record damage; return the transmissions with the times at which they arrive."""
        damages, self._damages = self.damaged.total() - self._damages, self.damaged.total()
        if damages:
            self._note(time, "damage", (self._name, damages))
            for transmission in sent:
                self._note_changed(transmission.data, time)
        if not self._bursting:
            return sent
        return [Transmission(math.ceil(moment / BURST) * BURST, data) for moment, data in sent]

    def _note_changed(self, data: bytes, time: float) -> None:
        """Record values that can be read from damaged bytes; none if there is a checksum."""


class MotorLine(Line):
    """A RoboClaw on its cable."""

    def __init__(self, settings: Settings, plant: Plant, plug: Plug, note: Note, seed: int) -> None:
        self._settings = settings
        self._plant = plant
        self._record = note
        self._dip_ends = math.inf
        super().__init__("motor", RecordedDevice(self._made(), decode_roboclaw, note), plug, note, seed)

    def power_off(self, _time: float) -> None:
        """Switch the controller off; the motors stop."""
        self._drive(0.0, 0.0)
        self.end.device = Off()

    def power_on(self, time: float) -> None:
        """Switch the controller on; it has lost its state."""
        self.end.device = self._made()
        self.end.device.receive(RESET_ENCODERS, time)

    def wake(self, time: float) -> list[Transmission]:
        """Act; end a dip of the battery voltage by the robot's clock, so that a busy machine does not prolong it."""
        if self._dip_ends <= time:
            self._dip_ends = math.inf
            self._plant._electrics = self._settings.electrics
        return super().wake(time)

    def dip(self, time: float, voltage: float, seconds: float) -> None:
        """Set the battery voltage [V] for some time [s]."""
        self._dip_ends = time + seconds
        self._plant._electrics = replace(self._settings.electrics, battery_voltage=voltage)

    def _made(self) -> Device:
        return RoboclawDevice(self._settings, self._plant, self._drive)

    def _drive(self, left: float, right: float) -> None:
        self._plant.command(left, right)
        self._record(self._plant.time, "duty", (round(left * FULL_DUTY), round(right * FULL_DUTY)))


class GyroLine(Line):
    """A gyro on its cable."""

    def __init__(self, kind: str, settings: Settings, plant: Plant, plug: Plug, note: Note, seed: int) -> None:
        self._kind = kind
        self._settings = settings
        self._plant = plant
        super().__init__("gyro", RecordedDevice(self._made(0.0, 0.0), self._decode, note), plug, note, seed)

    def power_off(self, _time: float) -> None:
        """Switch the gyro off."""
        self.end.device = Off()

    def power_on(self, time: float) -> None:
        """Switch the gyro on; a DSP-3000 then sends incremental angles, as if it had been configured for them."""
        self.end.device = self._made(time, time + START_UP)
        if isinstance(self.end.device, Dsp3000Device):
            self.end.device.receive(bytes([INCREMENTAL_ANGLE]), time)

    def invalid(self, time: float, seconds: float) -> None:
        """Send invalid readings for some time [s], without a restart, which would report a self-test."""
        device: Any = self.end.device
        if isinstance(device, Dsp3000Device):
            device._start_up = time + seconds
        else:
            device._valid_from = time + seconds

    def _made(self, time: float, valid_from: float) -> Any:
        """Return a gyro that is switched on at `time` [s of the engine]."""
        settings = replace(
            self._settings,
            dsp3000=replace(self._settings.dsp3000, start_up=valid_from),
            kvh_binary=replace(self._settings.kvh_binary, start_up=valid_from),
        )
        device: Any = GYRO_DEVICES[self._kind](settings, self._plant)
        device.wake_time += time
        return device

    def _decode(self, data: bytes) -> Any:
        if self._kind == "kvh-binary":
            return decode_kvh(data, 1.0 / self._settings.kvh_binary.rate)
        device = self.end.device
        sends_rates = isinstance(device, Dsp3000Device) and device._mode == RATE
        return decode_dsp3000(data) if sends_rates else ()

    def _note_changed(self, data: bytes, time: float) -> None:
        if self._kind == "dsp3000":
            for _, reading in decode_dsp3000(data):
                self._note(time, "misread", reading)


def run(connection: Connection, folder: Path, gyro: str, seed: int) -> None:
    """Emulate the robot until the other end of `connection` closes; receive Orders, send lists of Records."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    settings = load_settings(seed=seed).ideal()
    settings = replace(settings, kvh_binary=replace(settings.kvh_binary, rate=US_PER_S // GYRO_PERIOD))
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
        due = max(due + RECORD_PERIOD, monotonic())
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

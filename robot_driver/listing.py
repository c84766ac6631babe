"""List serial ports by stable name, and the devices that answer there; nothing moves.

A gyro that sends is recognised by listening. Only if nothing is heard is anything sent: a question for the device's
name, to boards that are silent until they are sent the time also zero duty. A port that another program uses is left
alone. Controllers are asked at their default baud rate first, then at the others that are usual for their kind.
"""

import os
from contextlib import suppress
from dataclasses import dataclass

from robot_driver.controllers import CONTROLLERS, BadReply, Controller
from robot_driver.gyros import GYROS, Gyro
from robot_driver.host import THIS_COMPUTER, Host
from robot_driver.serial_port import SerialPort, numbering_warning
from robot_driver.stream_port import StreamPort

LISTENING = 0.2  # s within which a running gyro sends something
CONVERSATION = 1.5  # s within which a gyro has answered the questions about its settings
ENOUGH = 3  # readings, which noise does not produce
ATTEMPTS = 3  # a device may first have to discard requests meant for others
READ_SIZE = 4096  # bytes
WHOLE = {"roboclaw": "roboclaw-pair"}  # part, what it is a part of: alone it would drive some of the wheels
LONGEST_ASKING = 8.0  # s at a port; after that no attempt is begun; each takes at most 2 s


@dataclass(frozen=True)
class Rates:
    """Baud rates at which to look for controllers and gyros; None: the usual ones of their kind."""

    controller: int | None = None
    gyro: int | None = None


USUAL = Rates()


@dataclass(frozen=True)
class Found:
    """A device that answers: whether it is a gyro, its name and baud rate as in the options, and its own
    identification.
    """

    is_gyro: bool
    name: str
    baud: int
    said: str = ""

    @property
    def other_baud(self) -> int | None:
        """The baud rate, if it is not the usual one of its kind."""
        usual = GYROS[self.name].baud_rate if self.is_gyro else CONTROLLERS[self.name].default_baud_rate
        return None if self.baud == usual else self.baud

    def __str__(self) -> str:
        kind, option = ("gyro", "--gyro") if self.is_gyro else ("motor controller", "--controller")
        baud = ("--gyro-baud" if self.is_gyro else "--baud") + f" {self.baud}"
        words = f"{kind}: {option} {self.name}{'' if self.other_baud is None else ' ' + baud}"
        return f"{words} ({self.said})" if self.said else words


def describe(path: str, rates: Rates = USUAL) -> str:
    """Return lines for the user: the port, the devices that answer there, and the options to start the driver with
    them.

    Raises PortLost if it cannot be opened or is lost meanwhile.
    """
    device = os.path.realpath(path)
    title = path if device == path else f"{path} (now {device})"
    found = list(map(str, devices_at(path, rates)))
    warning = numbering_warning(path)
    lines = [title, *(found or ["nothing that cmr-driver knows answers"]), *([warning] if warning else [])]
    return "\n    ".join(lines)


def devices_at(path: str, rates: Rates = USUAL, host: Host = THIS_COMPUTER) -> list[Found]:
    """Return the devices that answer at a port.

    Raises PortLost if it cannot be opened or is lost meanwhile.
    """
    end = host.monotonic() + LONGEST_ASKING
    return _gyro_at(path, rates.gyro, end, host) or _controllers_at(path, rates.controller, end, host)


def _gyro_at(path: str, only: int | None, end: float, host: Host) -> list[Found]:
    """Return the gyro that sends at a port, if one does before `end` (s, monotonic)."""
    silent_at: set[int] = set()  # baud rates at which nothing arrives
    for name, gyro in sorted(GYROS.items()):
        baud = only or gyro.baud_rate
        if baud not in silent_at and host.monotonic() < end and _talks(SerialPort(path, baud, host), gyro, silent_at):
            return [Found(True, name, baud)]
    return []


def _controllers_at(path: str, only: int | None, end: float, host: Host) -> list[Found]:
    """Return the controllers that answer at the first baud rate at which any does."""
    choices = {name: (only,) if only else _usual_rates(kind) for name, kind in sorted(CONTROLLERS.items())}
    for turn in range(max(map(len, choices.values()))):
        found = {}
        for name, bauds in choices.items():
            kind = CONTROLLERS[name]
            if turn < len(bauds) and host.monotonic() < end and (said := _name_of(path, kind, bauds[turn], host)):
                found[name] = Found(False, name, bauds[turn], said)
        if found:
            return [one for name, one in found.items() if WHOLE.get(name) not in found]
    return []


def _usual_rates(kind: type[Controller]) -> tuple[int, ...]:
    return (kind.default_baud_rate, *kind.other_baud_rates)


def _talks(at: SerialPort, gyro_type: type[Gyro], silent_at: set[int]) -> bool:
    """Return whether a gyro of this kind sends readings; it is asked only if its data need the settings to be read.

    If nothing arrives at all, its baud rate is added to `silent_at`.
    """
    with _Opened(at) as port:
        gyro = gyro_type()
        heard, readings = _listen(port, gyro, LISTENING)
        if not heard:
            silent_at.add(at.baud_rate)
        elif not readings:
            try:
                port.write(gyro.wake_up)
                _, readings = _listen(port, gyro, CONVERSATION)
            finally:
                port.write(gyro.farewell)
        return readings >= ENOUGH


def _listen(port: SerialPort, gyro: Gyro, seconds: float) -> tuple[int, int]:
    """Return the numbers of bytes and readings received within `seconds` at most; send the gyro's requests."""
    heard = readings = 0
    end = port.host.monotonic() + seconds
    while readings < ENOUGH and (remaining := end - port.host.monotonic()) > 0.0:
        data = port.read(READ_SIZE, remaining)
        heard += len(data)
        readings += len(gyro.feed(data))
        if request := gyro.next_request():
            port.write(request)
    return heard, readings


def _name_of(path: str, controller_type: type[Controller], baud: int, host: Host) -> str:
    """Return the name reported by a controller of this kind; "" if none answers."""
    port_type = StreamPort if controller_type.streams else SerialPort
    with _Opened(port_type(path, baud, host)) as port:
        controller = controller_type()
        controller.monotonic_ns = host.monotonic_ns
        for _ in range(ATTEMPTS):
            with suppress(BadReply):
                port.resynchronise()
                if controller_type.streams:
                    port.exchange(controller.drive(0.0, 0.0))
                return port.exchange(controller.identify()).value
        return ""


class _Opened:
    """A port that is open for the duration of a with statement."""

    def __init__(self, port: SerialPort) -> None:
        self._port = port

    def __enter__(self) -> SerialPort:
        self._port.open()
        return self._port

    def __exit__(self, *_: object) -> None:
        self._port.close()

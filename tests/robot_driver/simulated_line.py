"""The driver's motors on an emulated controller, in a time that goes on only when somebody waits: no thread, no wait.

What a test does happens at the very moment that it means, however busy the machine is.
"""

import math
import threading
from collections.abc import Callable
from itertools import pairwise
from typing import Any

import pytest

from robot_driver.battery import Thresholds
from robot_driver.command_gate import LISTENING_TIME, CommandGate
from robot_driver.controllers import CONTROLLERS
from robot_driver.emulator.device import Device, Transmission
from robot_driver.encoders import Wiring
from robot_driver.host import Host
from robot_driver.motors import Motors
from robot_driver.ramp import Limits
from robot_driver.serial_port import SerialPort
from robot_driver.stream_port import StreamPort

START = 1000.0  # s


class Clock(Host):
    """The time of all that drives motors (s); `at` are things to be done at a time, in order."""

    def __init__(self) -> None:
        self.now = START
        self.at: list[tuple[float, Callable[[], object]]] = []

    def monotonic(self) -> float:
        return self.now

    def monotonic_ns(self) -> int:
        return round(1e9 * self.now)

    def seconds_since_boot(self) -> float:
        return self.now

    def go_on(self, until: float) -> None:
        while self.at and self.at[0][0] <= until:
            moment, action = self.at.pop(0)
            self.now = max(self.now, moment)
            action()
        self.now = max(self.now, until)


class Stop(threading.Event):
    """Tells that the process is ending; waits in simulated time."""

    def __init__(self, clock: Clock) -> None:
        super().__init__()
        self._clock = clock

    def wait(self, timeout: float | None = None) -> bool:
        if not self.is_set():
            self._clock.go_on(self._clock.now + (timeout or 0.0))
        return self.is_set()


class Line:
    """What a port does, with `device` at its other end.

    `before(data)` is called with what is to be written, and may return other bytes, or b"" where they are lost.
    `after(data, answers)` may change what is answered. `driven` notes (time, duties) whenever these change, `said`
    what was written and when.
    """

    _last_traffic: float

    def place(self, device: Any, clock: Clock) -> None:
        self.device, self.clock = device, clock
        self.before: Callable[[bytes], bytes] = lambda data: data
        self.after: Callable[[bytes, list[Transmission]], list[Transmission]] = lambda _data, answers: answers
        self.driven: list[tuple[float, tuple[float, float]]] = []
        self.said: list[tuple[float, bytes]] = []
        self._coming: list[Transmission] = []

    def open(self) -> None:
        pass

    def close(self) -> None:
        pass

    def write(self, data: bytes) -> None:
        self.said.append((self.clock.now, data))
        arriving = self.before(data)
        arrival = self.clock.now + len(data) * self.device.byte_time
        self._act(arrival)
        answers = self.device.receive(arriving, arrival) if arriving else []
        self._coming += self.after(data, answers)
        self._last_traffic = arrival
        self._note(arrival)

    def noise(self, data: bytes, later: float = 0.0) -> None:
        """Have bytes arrive that no device sent, so much later (s)."""
        self._coming.append(Transmission(self.clock.now + later, data))

    def read(self, most: int, timeout: float) -> bytes:
        end = self.clock.now + max(timeout, 0.0)
        while not (due := [one for one in self._coming if one.time <= self.clock.now]):
            following = min([self.device.wake_time, *(one.time for one in self._coming)])
            if following > end:
                self._act(end)
                self.clock.go_on(end)
                return b""
            self._act(following)
            self.clock.go_on(following)
        data = b"".join(one.data for one in sorted(due, key=lambda one: one.time))
        self._coming = [one for one in self._coming if one.time > self.clock.now]
        if data[most:]:
            self._coming.insert(0, Transmission(self.clock.now, data[most:]))
        self._last_traffic = self.clock.now
        return data[:most]

    def _act(self, until: float) -> None:
        while self.device.wake_time <= until:
            moment = self.device.wake_time
            self._coming += self.after(b"", self.device.wake(moment))
            self._note(moment)

    def _note(self, moment: float) -> None:
        duty = self.device.duty[0], self.device.duty[1]
        if not self.driven or self.driven[-1][1] != duty:
            self.driven.append((moment, duty))


class Packets(Line, SerialPort):
    """The port of a controller that answers."""


class Stream(Line, StreamPort):
    """The port of a board that talks."""


class Bench:
    """Motors that are connected to `device`, and commanded full duty as long as nothing else is said."""

    def __init__(self, controller: str, device: Device, clock: Clock, rate_hz: float = 100.0) -> None:
        self.clock, self.stop = clock, Stop(clock)
        self.wanted = (1.0, 1.0)
        self.feedback: list[Any] = []
        self.duties: list[Any] = []
        port_type = Stream if CONTROLLERS[controller].streams else Packets
        self.line = port_type("a simulated line", 115200, clock)
        self.line.place(device, clock)
        self.gate = CommandGate()
        self.motors = Motors(
            self.line,
            CONTROLLERS[controller],
            self.gate,
            robot_id=0,
            rate_hz=rate_hz,
            ticks_per_turn=2048,
            wiring=Wiring(),
            limits=Limits(),
            thresholds=Thresholds(),
            publish=self.feedback.append,
            publish_duty=self.duties.append,
        )
        self.gate.note_listening(START - LISTENING_TIME)

    def connect(self) -> None:
        self.motors.connect(self.stop)

    def turn(self) -> None:
        utime = round(1e6 * self.clock.now)
        self.gate.offer(utime, *self.wanted, now=self.clock.now, utime=utime)
        self.motors.turn(self.stop)

    def until(self, condition: Callable[[], object]) -> None:
        end = self.clock.now + 10.0
        while not condition():
            assert self.clock.now < end, "waited in vain"
            self.turn()

    def turns(self, count: int) -> None:
        for _ in range(count):
            self.turn()


def steepest(driven: list[tuple[float, tuple[float, float]]]) -> float:
    """Return by how much a duty grew at most from one that was in force to the next."""
    return max(
        (abs(after[1][side]) - abs(before[1][side]) for before, after in pairwise(driven) for side in (0, 1)),
        default=-math.inf,
    )


@pytest.fixture
def clock() -> Clock:
    """The time of all that drives motors."""
    return Clock()

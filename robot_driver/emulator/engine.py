"""The event loop of the emulator: it moves bytes between serial ports and devices, and the plant through time."""

import heapq
import itertools
import math
import os
import select
import threading
import time
from collections.abc import Callable, Mapping
from functools import partial
from types import TracebackType
from typing import Protocol

from robot_driver.emulator.device import Device, Transmission
from robot_driver.emulator.plant import Plant
from robot_driver.emulator.sensors import MotionCapture, Pose

LONGEST_WAIT = 0.5  # s
CLOSED_PORT_PERIOD = 0.005  # s between looks at a port that no client has open; such a port cannot be waited on
CLOCKS_TOGETHER = 50e-6  # s within which both clocks must be read to be compared; it takes 1e-6


class Port(Protocol):
    """What the engine needs of a serial port; none of it blocks."""

    def fileno(self) -> int:
        """Return the file descriptor to wait on."""

    @property
    def is_open(self) -> bool:
        """Tell whether a client has the port open."""

    def read(self) -> bytes:
        """Return what the client has sent."""

    def write(self, data: bytes) -> None:
        """Send to the client."""


class SerialLine:
    """A device, the port it is seen through, and until when (s) the wire is busy in each direction."""

    def __init__(self, device: Device, port: Port) -> None:
        self.device = device
        self.port = port
        self.busy_to_device = 0.0
        self.busy_to_client = 0.0


class Engine:
    """Runs a robot in real time in a thread of its own; use it as a context manager.

    The plant is moved to the exact time of each event (a request's last byte has arrived, a sample is due), so
    nothing depends on how punctually the thread runs. `on_pose` is called from that thread.
    """

    def __init__(
        self,
        plant: Plant,
        devices: Mapping[str, Device],
        ports: Mapping[str, Port],
        *,
        motion_capture: MotionCapture | None = None,
        on_pose: Callable[[Pose], None] = lambda _pose: None,
    ) -> None:
        self.failure: BaseException | None = None
        self._plant = plant
        self._lines = [SerialLine(device, ports[name]) for name, device in devices.items()]
        self._motion_capture = motion_capture
        self._on_pose = on_pose
        self._events: list[tuple[float, int, Callable[[], None]]] = []
        self._order = itertools.count()  # events of the same time happen in the order they were scheduled
        self._stopping = False
        self._stop_reader, self._stop_writer = os.pipe()
        self._start = time.monotonic()
        self._thread = threading.Thread(target=self._run, name="emulated robot", daemon=True)

    def __enter__(self) -> "Engine":
        self._start = time.monotonic()
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._stopping = True
        os.write(self._stop_writer, b"x")
        self._thread.join()
        os.close(self._stop_reader)
        os.close(self._stop_writer)

    def check(self) -> None:
        """Raise what ended the thread, if anything did."""
        if self.failure is not None:
            raise self.failure

    def now(self) -> float:
        """Return the time in s since the robot was switched on."""
        return time.monotonic() - self._start

    def utime(self, moment: float) -> int:
        """Return a time of the robot in microseconds since the Unix epoch."""
        while True:
            before, utime, now = self.now(), time.time_ns() // 1000, self.now()
            if now - before < CLOCKS_TOGETHER:  # else the thread was held up between the two clocks
                return utime - round((now - moment) * 1e6)

    def _run(self) -> None:
        try:
            while not self._stopping:
                due, before = self._next_due(), self.now()
                for line, data in self._arrived(due - before):
                    # If this thread was held up, the bytes came before what it should have done meanwhile.
                    self._bring(line, data, min(self.now(), due))
                # Of what is due since then, nothing: bytes may be waiting that came before.
                self._let_happen(before)
        except BaseException as failure:  # handed to the main thread by check()
            self.failure = failure

    def _arrived(self, timeout: float) -> list[tuple[SerialLine, bytes]]:
        """Wait for bytes of clients up to `timeout` (s); return them by line."""
        open_lines = [line for line in self._lines if line.port.is_open]
        longest = LONGEST_WAIT if len(open_lines) == len(self._lines) else CLOSED_PORT_PERIOD
        waited_on = [line.port.fileno() for line in open_lines]
        ready, _, _ = select.select([*waited_on, self._stop_reader], [], [], min(max(timeout, 0.0), longest))
        # A client may have written and closed the port since the last look; that is not lost.
        return [
            (line, line.port.read()) for line in self._lines if line not in open_lines or line.port.fileno() in ready
        ]

    def _bring(self, line: SerialLine, data: bytes, start: float) -> None:
        """Send bytes down the wire to the device, after those that are still on it."""
        if data:
            arrival = max(start, line.busy_to_device) + len(data) * line.device.byte_time
            line.busy_to_device = arrival
            self._schedule(arrival, lambda: self._send(line, line.device.receive(data, arrival)))

    def _send(self, line: SerialLine, transmissions: list[Transmission]) -> None:
        """Hand bytes to the client when they have come up the wire, after those that are still on it."""
        for transmission in transmissions:
            earliest = line.busy_to_client + len(transmission.data) * line.device.byte_time
            line.busy_to_client = max(transmission.time, earliest)
            self._schedule(line.busy_to_client, partial(line.port.write, transmission.data))

    def _schedule(self, moment: float, action: Callable[[], None]) -> None:
        heapq.heappush(self._events, (moment, next(self._order), action))

    def _next_due(self) -> float:
        """Return the time of the earliest event or of the first device to act."""
        due = self._events[0][0] if self._events else math.inf
        if self._motion_capture is not None:
            due = min(due, self._motion_capture.wake_time)
        return min(due, *(line.device.wake_time for line in self._lines))

    def _let_happen(self, now: float) -> None:
        """Do everything that is due by `now`, in order of time."""
        while (due := self._next_due()) <= now:
            self._plant.advance(due)
            if self._events and self._events[0][0] <= due:
                heapq.heappop(self._events)[2]()
            elif self._motion_capture is not None and self._motion_capture.wake_time <= due:
                self._see(self._motion_capture.wake(due))
            else:
                line = min(self._lines, key=lambda line: line.device.wake_time)
                self._send(line, line.device.wake(due))

    def _see(self, pose: Pose) -> None:
        self._schedule(pose.time, lambda: self._on_pose(pose))

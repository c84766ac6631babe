"""The event loop of the emulator: it runs a robot in real time and transfers bytes between it and serial ports."""

import os
import select
import threading
import time
from collections.abc import Callable, Mapping
from types import TracebackType
from typing import Protocol

from cmr.priority import go_first
from robot_driver.emulator.device import Device
from robot_driver.emulator.plant import Plant
from robot_driver.emulator.robot_in_time import RobotInTime, StreamingAdapter
from robot_driver.emulator.sensors import MotionCapture, Pose

LONGEST_WAIT = 0.5  # s
CLOSED_PORT_PERIOD = 0.005  # s between polls of a port that no client has open, which cannot be waited on
CLOCKS_TOGETHER = 50e-6  # s within which both clocks must be read to be compared; it takes 1e-6


class Port(Protocol):
    """The engine's interface to a serial port; no method blocks."""

    def fileno(self) -> int:
        """Return the file descriptor to wait on."""

    @property
    def is_open(self) -> bool:
        """Return whether a client has the port open."""

    def read(self) -> bytes:
        """Return the bytes that the client has sent."""

    def write(self, data: bytes) -> None:
        """Send to the client."""


class Engine:
    """Runs a robot in real time in a thread of its own; a context manager.

    The plant is moved to the exact time of each event (a request's last byte has arrived, a sample is due), so timing
    does not depend on the thread's punctuality. `on_pose` is called from that thread.
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
        self._ports = {name: ports[name] for name in devices}
        self._robot = RobotInTime(
            plant,
            devices,
            lambda name, data: self._ports[name].write(data),
            adapters={name: StreamingAdapter() for name in devices},
            motion_capture=motion_capture,
            on_pose=on_pose,
        )
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
        """Raise the exception that ended the thread, if any."""
        if self.failure is not None:
            raise self.failure

    def now(self) -> float:
        """Return the time in s since the robot was switched on."""
        return time.monotonic() - self._start

    def utime(self, moment: float) -> int:
        """Return a time of the robot in microseconds since the Unix epoch."""
        while True:
            before, utime, now = self.now(), time.time_ns() // 1000, self.now()
            if now - before < CLOCKS_TOGETHER:  # else the thread was interrupted between the two clock readings
                return utime - round((now - moment) * 1e6)

    def _run(self) -> None:
        go_first()
        try:
            while not self._stopping:
                due, before = self._robot.next_due(), self.now()
                for name, data in self._arrived(due - before):
                    # If this thread was delayed, the bytes arrived before events that are overdue.
                    self._robot.bring(name, data, min(self.now(), due))
                # Overdue events since then are not processed yet: bytes may be waiting that arrived before them.
                self._robot.let_happen(before)
        except BaseException as failure:  # handed to the main thread by check()
            self.failure = failure

    def _arrived(self, timeout: float) -> list[tuple[str, bytes]]:
        """Wait for bytes of clients up to `timeout` (s); return them by port name."""
        is_open = {name: port.is_open for name, port in self._ports.items()}
        longest = LONGEST_WAIT if all(is_open.values()) else CLOSED_PORT_PERIOD
        waited_on = [port.fileno() for name, port in self._ports.items() if is_open[name]]
        ready, _, _ = select.select([*waited_on, self._stop_reader], [], [], min(max(timeout, 0.0), longest))
        # A client may have written and closed the port since the last poll; those bytes are not lost.
        return [
            (name, port.read()) for name, port in self._ports.items() if not is_open[name] or port.fileno() in ready
        ]

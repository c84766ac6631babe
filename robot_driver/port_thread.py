"""One thread that owns one port: opens it, works with the device, and reconnects after a loss."""

import threading
from abc import ABC, abstractmethod
from contextlib import suppress
from types import TracebackType

from robot_driver.serial_port import PortInUse, PortLost, SerialPort

FIRST_PAUSE = 0.1  # s before the first attempt to reconnect; doubled each time
LONGEST_PAUSE = 1.0  # s
STOP_TIMEOUT = 0.8  # s; a hanging thread must not keep the process alive: the device's watchdog stops the motors
LETTING_GO = 0.8  # s for which the last gate of a killed driver may still use the port, to stop the motors
LOOK = 0.02  # s between checks whether the port is free


class Device(ABC):
    """Interface of the device on a port; all methods are called by the port's thread.

    `problem` is a sentence about a problem while the device answers, or "". `rest` is the time (s) for which the device
    must be left alone after `leave`.
    """

    problem = ""
    rest = 0.0

    @abstractmethod
    def connect(self, stop: threading.Event) -> None:
        """Start on a port that has just been opened. Raises PortLost."""

    @abstractmethod
    def turn(self, stop: threading.Event) -> None:
        """Do one cycle of the work, within a tenth of a second. Raises PortLost."""

    @abstractmethod
    def leave(self) -> None:
        """Leave the device in a safe state; the port is closed next. Raises PortLost."""


class PortThread:
    """Runs `device` on `port`; a context manager, inside which the thread runs.

    Entering opens the port and raises PortLost if that fails: at once for a wrong path, after a short wait for a port
    used by another program. Later losses of the device are handled. Leaving stops the thread after `device.leave()`.
    """

    def __init__(self, port: SerialPort, device: Device) -> None:
        self.port = port
        self.device = device
        self.failure: Exception | None = None
        self._lost = f"Waiting for the device at {port.path}."
        self._stop = port.host.event()
        self._thread = port.host.thread(self._run, port.path)

    def __enter__(self) -> "PortThread":
        self._open_at_last()
        self._thread.start()
        return self

    def __exit__(
        self, _kind: type[BaseException] | None, _error: BaseException | None, _trace: TracebackType | None
    ) -> None:
        self.ask_to_stop()
        self._thread.join(STOP_TIMEOUT)

    def ask_to_stop(self) -> None:
        """Request the thread's end; leaving waits for it."""
        self._stop.set()

    @property
    def problem(self) -> str:
        """The problem of the port or the device, in a sentence; "" if there is none.

        Raises the exception that ended the thread, if it was a program error.
        """
        if self.failure is not None:
            raise self.failure
        return self._lost or self.device.problem

    def _open_at_last(self) -> None:
        end = self.port.host.monotonic() + LETTING_GO
        while True:
            try:
                return self.port.open()
            except PortInUse:
                if self.port.host.monotonic() >= end:
                    raise
            self._stop.wait(LOOK)

    def _run(self) -> None:
        pause = FIRST_PAUSE
        while not self._stop.is_set():
            try:
                self.port.open()
                self.device.connect(self._stop)
                self._lost, pause = "", FIRST_PAUSE
                while not self._stop.is_set():
                    self.device.turn(self._stop)
            except PortLost as lost:
                self._lost = str(lost)
            except Exception as failure:
                self._end(failure)
            finally:
                self._let_go()
            self._stop.wait(max(pause, self.device.rest))
            pause = min(2 * pause, LONGEST_PAUSE)

    def _let_go(self) -> None:
        try:
            with suppress(PortLost):
                self.device.leave()
        except Exception as failure:
            self._end(failure)
        finally:
            self.port.close()

    def _end(self, failure: Exception) -> None:
        """Stop working, and pass the reason to every caller."""
        self.failure = self.failure or failure
        self._stop.set()

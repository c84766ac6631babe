"""One thread that owns one port: opens it, works with the device, and gets it back after it was lost."""

import threading
from abc import ABC, abstractmethod
from contextlib import suppress
from types import TracebackType

from robot_driver.serial_port import PortInUse, PortLost, SerialPort

FIRST_PAUSE = 0.1  # s before the first attempt to get a lost device back; doubled each time
LONGEST_PAUSE = 1.0  # s
STOP_TIMEOUT = 0.8  # s; a thread that hangs must not keep the process alive: the device's own watchdog stops it
LETTING_GO = 0.8  # s for which the last gate of a driver that was killed may still have the port, to stop the motors
LOOK = 0.02  # s between looks whether it has let go


class Device(ABC):
    """What a port's thread does with the device on it; all methods are called by that thread.

    `problem` is a sentence about what is wrong while the device answers, or "". `rest` is for how long (s) the device
    has to be left alone after `leave`.
    """

    problem = ""
    rest = 0.0

    @abstractmethod
    def connect(self, stop: threading.Event) -> None:
        """Begin with a port that has just been opened. Raises PortLost."""

    @abstractmethod
    def turn(self, stop: threading.Event) -> None:
        """Do one turn of the work, within a tenth of a second. Raises PortLost."""

    @abstractmethod
    def leave(self) -> None:
        """Leave the device in a safe state; the port is closed next. Raises PortLost."""


class PortThread:
    """Runs `device` on `port`; a context manager, inside which the thread lives.

    Entering opens the port and raises PortLost if that fails: a wrong path shows at once, and a port that another
    program has, after a moment. Later the device may come and go. Leaving stops the thread after `device.leave()`.
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
        """Have the thread end soon; leaving waits for it."""
        self._stop.set()

    @property
    def problem(self) -> str:
        """What is wrong with the port or the device, in a sentence; "" when all is well.

        Raises what ended the thread, if it was a fault of the program.
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
        """Stop working, and give the reason to every caller."""
        self.failure = self.failure or failure
        self._stop.set()

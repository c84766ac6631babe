"""The computer on which the driver runs: its clocks, waiting, threads and ports.

The driver reaches all of them through one `Host`, so that it can also run in simulated time: there the same code drives
an emulated robot, many times as fast.
"""

import fcntl
import os
import queue
import select
import termios
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from typing import Protocol

import serial

from cmr.priority import go_first
from robot_driver.clock import seconds_since_boot, utime_at

# pyserial's flushing calls may raise termios.error, which is a subclass of neither of the others.
PORT_ERRORS = (serial.SerialException, OSError, termios.error)
WRITE_TIMEOUT = 0.1  # s
TIOCGEXCL = 0x80045440  # of Linux: whether TIOCEXCL is in force; not defined by Python


class LineLost(OSError):  # noqa: N818 - as PortLost
    """A line cannot be used any more, for a reason other than its device; the text gives the reason."""


class Line(Protocol):
    """An open serial port. It raises only PORT_ERRORS."""

    def write(self, data: bytes) -> object:
        """Write all of it."""

    def read(self, most: int, timeout: float) -> bytes:
        """Return what has arrived, up to `most` bytes, as soon as there is any; b"" after `timeout` seconds."""

    def close(self) -> None:
        """Close the port."""


class Worker(Protocol):
    """A thread."""

    def start(self) -> None:
        """Start it."""

    def join(self, timeout: float | None = None) -> None:
        """Wait until it has ended, for up to `timeout` seconds."""


class Mailbox(Protocol):
    """Transfers pieces of bytes from one thread to another."""

    def put(self, piece: bytes) -> None:
        """Add a piece; it is dropped if too many are waiting."""

    def get(self, timeout: float) -> bytes:
        """Return the oldest piece; b"" if none arrives within `timeout` seconds."""


class Host:
    """This computer, in real time: `runs_processes`: whether processes of the system share its time."""

    runs_processes = True

    def monotonic_ns(self) -> int:
        """Return the monotonic time (ns)."""
        return time.monotonic_ns()

    def monotonic(self) -> float:
        """Return the monotonic time (s)."""
        return time.monotonic()

    def seconds_since_boot(self) -> float:
        """Return a monotonic time (s) that continues while the computer is suspended."""
        return seconds_since_boot()

    def utime_at(self, monotonic_nanoseconds: int) -> int:
        """Return the wall-clock time (us since the Unix epoch) of a recent monotonic time."""
        return utime_at(monotonic_nanoseconds)

    def utime(self) -> int:
        """Return the wall-clock time (us since the Unix epoch)."""
        return time.time_ns() // 1000

    def sleep(self, seconds: float) -> None:
        """Wait this long."""
        time.sleep(seconds)

    def event(self) -> threading.Event:
        """Return an event that one thread sets and others wait for."""
        return threading.Event()

    def mailbox(self, most: int) -> Mailbox:
        """Return a mailbox for up to this many pieces."""
        return _Queue(most)

    def thread(self, work: Callable[[], None], name: str) -> Worker:
        """Return a thread, not started yet, with real-time priority if the system permits it."""

        def urgent() -> None:
            go_first()
            work()

        return threading.Thread(target=urgent, name=name, daemon=True)

    def open_line(self, path: str, baud_rate: int, *, lock_out: bool) -> Line:
        """Open a serial port (8N1, no flow control), exclusively; `lock_out`: the kernel enforces that, too.

        Raises one of PORT_ERRORS, or ValueError.
        """
        return Terminal(path, baud_rate, lock_out=lock_out)


THIS_COMPUTER = Host()


class Terminal:
    """A serial port of this computer."""

    def __init__(self, path: str, baud_rate: int, *, lock_out: bool) -> None:
        self._serial = serial.Serial(path, baud_rate, timeout=0, write_timeout=WRITE_TIMEOUT, exclusive=True)
        with suppress(*PORT_ERRORS, ValueError):  # most adapters lack this mode
            self._serial.set_low_latency_mode(True)
        if lock_out:
            with suppress(*PORT_ERRORS):
                fcntl.ioctl(self._serial.fileno(), termios.TIOCEXCL)

    def fileno(self) -> int:
        """Return its file descriptor."""
        return int(self._serial.fileno())

    def reader(self) -> int:
        """Return a second, read-only descriptor of it, if the system permits that."""
        descriptor = self.fileno()
        locked = fcntl.ioctl(descriptor, TIOCGEXCL, bytes(4)) != bytes(4)
        try:
            fcntl.ioctl(descriptor, termios.TIOCNXCL)
            return os.open(f"/proc/self/fd/{descriptor}", os.O_RDONLY | os.O_NOCTTY | os.O_NONBLOCK)
        except OSError:
            return os.dup(descriptor)
        finally:
            if locked:
                fcntl.ioctl(descriptor, termios.TIOCEXCL)

    def write(self, data: bytes) -> None:
        """Write all of it."""
        self._serial.write(data)

    def read(self, most: int, timeout: float) -> bytes:
        """Return what has arrived, as soon as there is any."""
        if not select.select([self._serial.fileno()], [], [], max(timeout, 0.0))[0]:
            return b""
        return bytes(self._serial.read(most))

    def close(self) -> None:
        """Close the port."""
        with suppress(*PORT_ERRORS):
            self._serial.close()


class _Queue:
    def __init__(self, most: int) -> None:
        self._pieces: queue.Queue[bytes] = queue.Queue(most)

    def put(self, piece: bytes) -> None:
        with suppress(queue.Full):
            self._pieces.put_nowait(piece)

    def get(self, timeout: float) -> bytes:
        try:
            return self._pieces.get(timeout=max(timeout, 0.0))
        except queue.Empty:
            return b""

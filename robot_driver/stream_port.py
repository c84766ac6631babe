"""The port of a board that sends continuously: one user makes requests, others listen."""

from collections.abc import Callable
from typing import TypeVar

from robot_driver.controllers import Request
from robot_driver.gyro_device import LONGEST_DELAY
from robot_driver.host import THIS_COMPUTER, Host
from robot_driver.serial_port import Answer, SerialPort

T = TypeVar("T")

PATIENCE = 0.1  # s without an answer; some firmware sends everything 25 times a second
SILENCE = 0.1  # s after which such a board counts as silent: longer than the delays of a busy computer
MOST_UNHEARD = 1000  # pieces kept for a listener that does not read


class StreamPort(SerialPort):
    """The port at `path`; each of the `listeners` receives all bytes.

    Unrequested bytes are normal here, so there is nothing to resynchronise.
    """

    def __init__(self, path: str, baud_rate: int, host: Host = THIS_COMPUTER) -> None:
        super().__init__(path, baud_rate, host)
        self.listeners: list[Callable[[bytes], None]] = []

    def read(self, most: int, timeout: float) -> bytes:
        """Return the bytes received, as any port does, after passing them to the listeners."""
        data = super().read(most, timeout)
        for listener in self.listeners:
            listener(data)
        return data

    def exchange(self, request: Request[T]) -> Answer[T]:
        """Write, and return the answer as soon as the board sends it.

        If it does not arrive in time, the request's `parse` gets the bytes received, and raises BadReply. If the time
        by the board's clock is impossible, the time of arrival is used. Raises PortLost.
        """
        self._send(request)
        deadline = self.host.monotonic() + PATIENCE
        reply = b""
        while (missing := request.missing(reply)) > 0:
            remaining = max(deadline - self.host.monotonic(), 0.0)
            data = self.read(missing, remaining)
            if not data and not remaining:  # nothing arrived in time, nor while this process was delayed
                break
            if data and request.ends_in_silence:
                deadline = self.host.monotonic() + SILENCE
            reply += data
        arrived = self.host.monotonic_ns()
        value = request.parse(reply)
        measured = request.measured() if request.measured else arrived
        believed = 0 <= arrived - measured < LONGEST_DELAY
        return Answer(value, measured if believed else arrived, arrived)

    def discard_strays(self) -> None:
        """Do nothing: all bytes are processed."""

    def resynchronise(self) -> None:
        """Do nothing: frames mark where they begin."""


class OverheardPort(SerialPort):
    """A second, read-only user of `port`: receives all bytes while it is open."""

    def __init__(self, port: StreamPort) -> None:
        super().__init__(port.path, port.baud_rate, port.host)
        self._pieces = port.host.mailbox(MOST_UNHEARD)
        port.listeners.append(self._hear)

    def open(self) -> None:
        """Do nothing: the port is opened by its first user."""

    def close(self) -> None:
        """Do nothing."""

    def write(self, data: bytes) -> None:
        """Do nothing: the first user keeps the board sending."""

    def read(self, most: int, timeout: float) -> bytes:  # noqa: ARG002 - pieces keep their length
        """Return the next piece; b"" if none arrives within `timeout` seconds."""
        return self._pieces.get(timeout)

    def _hear(self, data: bytes) -> None:
        if data:
            self._pieces.put(data)

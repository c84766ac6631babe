"""The port of a board that talks all the time: one asks it for something, others listen to all it says."""

from collections.abc import Callable
from typing import TypeVar

from robot_driver.controllers import Request
from robot_driver.gyro_device import LONGEST_DELAY
from robot_driver.host import THIS_COMPUTER, Host
from robot_driver.serial_port import Answer, SerialPort

T = TypeVar("T")

PATIENCE = 0.1  # s without an answer; there is firmware that says everything 25 times a second
SILENCE = 0.1  # s after which such a board has really fallen silent: a busy computer looks away for less
MOST_UNHEARD = 1000  # pieces kept for a listener that does not listen


class StreamPort(SerialPort):
    """The port at `path`; each of the `listeners` is given all that comes.

    What nobody asked for is no fault here, so there is nothing to get back in step with.
    """

    def __init__(self, path: str, baud_rate: int, host: Host = THIS_COMPUTER) -> None:
        super().__init__(path, baud_rate, host)
        self.listeners: list[Callable[[bytes], None]] = []

    def read(self, most: int, timeout: float) -> bytes:
        """Return what has arrived, as any port does, after the listeners have heard it."""
        data = super().read(most, timeout)
        for listener in self.listeners:
            listener(data)
        return data

    def exchange(self, request: Request[T]) -> Answer[T]:
        """Write, and return the answer as soon as it is among what the board says.

        When it does not come in time, what came is all that the request's `parse` gets: it raises BadReply. When the
        board's clock says what cannot be, a reading was taken when it arrived. Raises PortLost.
        """
        self._send(request)
        deadline = self.host.monotonic() + PATIENCE
        reply = b""
        while (missing := request.missing(reply)) > 0:
            remaining = max(deadline - self.host.monotonic(), 0.0)
            data = self.read(missing, remaining)
            if not data and not remaining:  # nothing came in time, nor while this process was held up
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
        """Do nothing: all that comes is listened to."""

    def resynchronise(self) -> None:
        """Do nothing: in a stream, frames show where they begin."""


class OverheardPort(SerialPort):
    """A second pair of ears on `port`: reads all that comes there while it is open, and writes nothing."""

    def __init__(self, port: StreamPort) -> None:
        super().__init__(port.path, port.baud_rate, port.host)
        self._pieces = port.host.mailbox(MOST_UNHEARD)
        port.listeners.append(self._hear)

    def open(self) -> None:
        """Do nothing: the port is open when it is open for the one who asks."""

    def close(self) -> None:
        """Do nothing."""

    def write(self, data: bytes) -> None:
        """Do nothing: the one who asks keeps the board talking."""

    def read(self, most: int, timeout: float) -> bytes:  # noqa: ARG002 - pieces are as long as they came
        """Return the next piece; b"" when none has come after `timeout` seconds."""
        return self._pieces.get(timeout)

    def _hear(self, data: bytes) -> None:
        if data:
            self._pieces.put(data)

"""One serial port: opened exclusively, read and written with deadlines, lost without a crash.

Every failure of the device, however the libraries report it, becomes `PortLost` with a sentence for the user.
"""

import errno
import math
import os
import re
import sys
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Generic, TypeVar

from serial.tools import list_ports

from robot_driver.controllers import BadReply, Request
from robot_driver.host import PORT_ERRORS, THIS_COMPUTER, Host, Line, LineLost

T = TypeVar("T")

BITS_PER_BYTE = 10  # 8N1: start bit, eight data bits, stop bit
REPLY_MARGIN = 0.020  # s on top of the time on the wire: USB adapters hold bytes back for up to 16 ms
USB_FRAME = 1_000_000  # ns; longest wait of a request for its frame
PACKET_GAP = 0.010  # s of silence after which a device drops a half-received packet
RESYNC_LIMIT = 0.1  # s; limit, for a device that never stops sending
PSEUDO_TERMINALS = "/dev/pts/"
STABLE_NAMES = Path("/dev/serial/by-id")
NUMBERED = re.compile(r"/dev/tty(USB|ACM)[0-9]+")  # names given in the order of plugging in
IN_USE = (errno.EAGAIN, errno.EBUSY)


class PortLost(Exception):  # noqa: N818 - unplugging is a normal event
    """The port cannot be opened or used any more; the text says why and what to do."""


class PortInUse(PortLost):
    """Another program has the port."""


class NotSent(BadReply):
    """It was too late to send the request."""


@dataclass(frozen=True)
class Answer(Generic[T]):
    """Answer of a device, when it took the reading, and when the reply's last byte arrived (monotonic nanoseconds)."""

    value: T
    measured: int
    arrived: int


class SerialPort:
    """The port at `path` of `host` (8N1, no flow control). One thread at a time may use it.

    An opened line is passed to `guard`, which may return another one that checks what is written.

    `turnaround` (ns) is the time of the device's fastest answer so far, an upper bound of its turnaround. `strays`
    counts the times that unrequested bytes were waiting before a request.
    """

    def __init__(self, path: str, baud_rate: int, host: Host = THIS_COMPUTER) -> None:
        self.guard: Callable[[Line], Line] = lambda line: line
        self.path = path
        self.host = host
        self.baud_rate = baud_rate
        self.strays = 0
        self._stable: str | None = None
        self._line: Line | None = None
        self.turnaround = sys.maxsize
        self._last_traffic = -math.inf  # when, on the monotonic clock, the last byte was on the wire (s)

    def wire_time(self, byte_count: int) -> float:
        """Return the duration of this many bytes on the wire (s)."""
        return byte_count * BITS_PER_BYTE / self.baud_rate

    def open(self) -> None:
        """Open the port, if it is not open, and lock out every other program.

        A numbered port is opened again by its stable name: its number may belong to another device then. Raises
        PortLost.
        """
        if self._line is not None:
            return
        path = self._stable or self.path
        # The kernel keeps the lock on a pseudo-terminal after this process has ended, until the other end closes.
        lock_out = not os.path.realpath(self.path).startswith(PSEUDO_TERMINALS)
        try:
            self._line = self.guard(self.host.open_line(path, self.baud_rate, lock_out=lock_out))
        except LineLost as lost:
            raise PortLost(str(lost)) from lost
        except (*PORT_ERRORS, ValueError) as error:
            kind = PortInUse if getattr(error, "errno", None) in IN_USE else PortLost
            raise kind(why_not_open(path, error)) from error
        if NUMBERED.fullmatch(self.path):
            self._stable = stable_name(self.path)

    def close(self) -> None:
        """Close the port; it may be opened again."""
        if self._line is not None:
            self._line.close()
            self._line = None

    def write(self, data: bytes) -> None:
        """Write a whole packet in one go.

        Raises PortLost.
        """
        try:
            self._opened().write(data)
            self._last_traffic = self.host.monotonic() + self.wire_time(len(data))
        except PORT_ERRORS as error:
            raise self._lost(error) from error

    def read(self, most: int, timeout: float) -> bytes:
        """Return what has arrived, up to `most` bytes, as soon as there is any; b"" after `timeout` seconds.

        Raises PortLost.
        """
        line = self._line or self._opened()
        try:
            data = line.read(most, timeout)
        except PORT_ERRORS as error:
            raise self._lost(error) from error
        if data:
            self._last_traffic = self.host.monotonic()
        return data

    def exchange(self, request: Request[T]) -> Answer[T]:
        """Make a request, and those that follow from its answer or silence; return the answer.

        A reply may come in pieces: each byte extends the deadline. Raises BadReply if no reply, half a reply or a
        damaged one arrives before the deadline, or if it is too late to send; then call `resynchronise` before the next
        request. Raises PortLost.
        """
        try:
            answer = self._ask(request)
        except BadReply:
            if request.otherwise is not None:
                self.resynchronise()
                with suppress(BadReply):
                    self.exchange(replace(request.otherwise, not_after=request.not_after))
            raise
        if request.then is None:
            return answer
        further_request = request.then(answer.value)
        if further_request.not_after != request.not_after:
            further_request = replace(further_request, not_after=request.not_after)
        further = self.exchange(further_request)
        measured = answer.measured if request.confirms else (answer.measured + further.measured) // 2
        return Answer(further.value, measured, further.arrived)

    def resynchronise(self) -> None:
        """Wait until the line has been silent for long enough that the device drops a half-received packet.

        Silence before the call counts. Raises PortLost.
        """
        give_up = self.host.monotonic() + RESYNC_LIMIT
        while self.host.monotonic() < give_up:
            if not self.read(4096, self._last_traffic + PACKET_GAP - self.host.monotonic()):
                return

    def discard_strays(self) -> None:
        """Resynchronise if unrequested bytes are waiting: a late reply must not be taken for the next one.

        Takes up to RESYNC_LIMIT (s). Raises PortLost.
        """
        if self.read(4096, 0.0):
            self.strays += 1
            self.resynchronise()

    def _send(self, request: Request[T]) -> None:
        """Write a request, unless it is out of date: then NotSent is raised. Raises PortLost."""
        if self.host.seconds_since_boot() > request.not_after:
            raise NotSent(f"{request.name} was held up for so long that it is not sent any more.")
        self.write(request.data)

    def _ask(self, request: Request[T]) -> Answer[T]:
        """Make one request, and return its answer. Raises BadReply and PortLost."""
        self.discard_strays()
        sent = self.host.monotonic_ns()
        self._send(request)
        began, reply = None, b""
        deadline = self._last_traffic + self.wire_time(request.longest_reply) + REPLY_MARGIN
        while (missing := request.missing(reply)) > 0:
            data = self.read(missing, deadline - self.host.monotonic())
            if not data and reply and request.ends_in_silence:
                break
            if not data:
                raise BadReply(f"{request.name}: {len(reply)} bytes came in time, at least {missing} are missing.")
            reply += data
            if began is None:
                began = self.host.monotonic_ns() - int(1e9 * self.wire_time(len(data)))
            piece_deadline = self._last_traffic + REPLY_MARGIN
            deadline = piece_deadline if request.ends_in_silence else max(deadline, piece_deadline)
        arrived = self.host.monotonic_ns()
        # The device samples between the last byte of the request and the first of the reply: take the middle. A reply
        # is longer than its request, so the middle of the whole exchange would be late.
        asked = sent + int(1e9 * self.wire_time(len(request.data)))
        # Additional time over the fastest answer arises on this side: a USB adapter holds replies back for up to 16 ms,
        # a busy computer lets them wait. Requests leave at once (as in NTP's clock filter, RFC 5905, section 10).
        turnaround = (began or arrived) - asked
        self.turnaround = min(self.turnaround, turnaround)
        return Answer(request.parse(reply), asked + min(turnaround, self.turnaround + USB_FRAME) // 2, arrived)

    def _opened(self) -> Line:
        if self._line is None:
            raise PortLost(f"{self.path} is not open.")
        return self._line

    def _lost(self, error: Exception) -> PortLost:
        if isinstance(error, LineLost):
            return PortLost(str(error))
        return PortLost(f"The device at {self.path} is gone ({error}). Check the cable and the power.")


def why_not_open(path: str, error: Exception) -> str:
    """Return one line that says why a port cannot be opened, and what to do."""
    number = getattr(error, "errno", None)
    if number == errno.ENOENT:
        present = ", ".join(available_ports()) or "none"
        return f"There is no serial port {path}. Plug the device in, or choose one that is there: {present}."
    if number in (errno.EACCES, errno.EPERM):
        return f"You may not use {path}. Join its group, then log in again: sudo usermod -aG dialout $USER"
    if number in IN_USE:
        return f"Another program is using {path}. End it first: sudo fuser -v {path} shows which."
    if not _is_terminal(path):
        present = ", ".join(available_ports()) or "none"
        return f"{path} is not a serial port. Choose one that is: {present}."
    return f"{path} cannot be opened: {error}."


def stable_name(path: str) -> str | None:
    """Return the name of a port that does not depend on where and when it is plugged in; None if it has none."""
    device = os.path.realpath(path)
    return next((str(link) for link in sorted(STABLE_NAMES.glob("*")) if os.path.realpath(link) == device), None)


def numbering_warning(path: str) -> str:
    """Return a warning for a path that may belong to another device later; "" for one that does not."""
    if not NUMBERED.fullmatch(path):
        return ""
    stable = stable_name(path)
    rule = "Give it a name of its own by a udev rule; docs/how_to/set_up_a_robot.md shows one."
    advice = f"Use {stable}." if stable else rule
    return f"{path} belongs to another device when ports are plugged in in another order. {advice}"


def available_ports() -> list[str]:
    """Return the serial ports of this machine; by stable name where there is one."""
    stable = sorted(str(link) for link in STABLE_NAMES.glob("*"))
    named = {os.path.realpath(link) for link in stable}
    return stable + sorted(port.device for port in list_ports.comports() if port.device not in named)


def _is_terminal(path: str) -> bool:
    try:
        descriptor = os.open(path, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
    except OSError:
        return False
    try:
        return os.isatty(descriptor)
    finally:
        os.close(descriptor)

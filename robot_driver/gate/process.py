"""The process of the last gate: receives messages of the driver, writes to the port, stops the motors.

It ends when the driver requests it or has ended; then it stops the motors first.
"""

import os
import select
import signal
import socket
import struct
import time
from contextlib import suppress

from robot_driver.gate.guard import CONFIRMING, Guard, Mounting
from robot_driver.gate.messages import (
    SECOND,
    WORD_LENGTH,
    Kind,
    Malformed,
    Reason,
    Report,
    Word,
    packed_report,
    word_in,
)
from robot_driver.gate.wire import Stop, Wire
from robot_driver.gate.wire_mbot import MBotWire
from robot_driver.gate.wire_roboclaw import RoboClawWire
from robot_driver.gate.wire_roboteq import RoboteqWire

REPORT_PERIOD = SECOND // 5  # ns; also the period of checks that the parent lives
# ns for attempts to stop the motors; after that the controller's watchdog must do it, which needs silence.
STOPPING = SECOND // 2
QUIET = 0.010  # s of silence after which a device drops a half-received packet
LONGEST_QUIET = SECOND // 20  # ns; limit, for a device that never stops sending
ANSWER = SECOND // 10  # ns that the controller has for acknowledging zero
WRITING = 0.1  # s allowed for the port to take the data
DESCRIPTOR = 4  # bytes of a descriptor that comes with a message
NONE = -1  # descriptor of no port
LOCK_CURRENT = 1  # of mlockall(2): only current memory; no more is needed


def wire_of(controller: str) -> Wire:
    """Return the protocol of a controller, by its name on the command line of cmr-driver."""
    wires: dict[str, Wire] = {
        "mbot": MBotWire(),
        "roboclaw": RoboClawWire(),
        "roboclaw-pair": RoboClawWire(2),
        "roboteq": RoboteqWire(),
    }
    return wires[controller]


def now() -> int:
    """Return the time since the computer was started, also while it was suspended (ns)."""
    return time.clock_gettime_ns(time.CLOCK_BOOTTIME)


class Gate:
    """Serves `link`, the socket to the driver, which is the process `parent`."""

    def __init__(self, link: socket.socket, guard: Guard, wire: Wire, parent: int) -> None:
        self._link, self._guard, self._wire, self._parent = link, guard, wire, parent
        self._port = NONE
        self._sequence = 0
        self._gone = False  # whether the device behind the port is gone
        self._acknowledged = False
        self._refused = [0] * len(Reason)
        self._ended = False
        self._report_due = 0
        self._events = select.poll()
        self._events.register(link, select.POLLIN)

    def run(self) -> None:
        """Serve the driver until it has ended or requests the end; then, and if this program fails, stop the motors."""
        try:
            while not self._ended:
                self._turn()
        finally:
            if self._port != NONE:
                self._stop_motors()

    def _turn(self) -> None:
        """Wait for a message, or for the time to stop the motors or to report; do what is due."""
        due = self._guard.stop_due()
        until = self._report_due if due is None else min(due, self._report_due)
        events = self._events.poll(max(until - now(), 0) / 1e6)
        if events:
            self._receive(bool(events[0][1] & select.POLLHUP))
        moment = now()
        due = self._guard.stop_due()
        if due is not None and moment >= due:
            if self._guard.is_attended(moment):
                self._send_zero(moment)
            else:
                self._stop_motors()
        if moment >= self._report_due:
            self._ended |= os.getppid() != self._parent
            self._report(moment)

    def _receive(self, hung_up: bool) -> None:
        """Take one message."""
        try:
            message, extra, _, _ = self._link.recvmsg(WORD_LENGTH + 1, socket.CMSG_SPACE(DESCRIPTOR))
        except OSError:
            message, extra, hung_up = b"", [], True
        descriptors = [number for _, _, data in extra for number in struct.unpack(f"{len(data) // 4}i", data)]
        if not message and hung_up:
            self._ended = True
            return
        try:
            word = word_in(message)
            if word.sequence <= self._sequence or len(descriptors) != (word.kind is Kind.OPEN):
                raise Malformed
        except Malformed:
            self._refuse(Reason.MALFORMED)
            for descriptor in descriptors:
                os.close(descriptor)
            return
        self._sequence = word.sequence
        self._obey(word, descriptors[0] if descriptors else NONE)

    def _obey(self, word: Word, descriptor: int) -> None:
        """Execute the request of a message, as far as it is permitted."""
        moment = now()
        if (reason := self._guard.take(word, moment)) is not None:
            self._refuse(reason)
        if word.kind is Kind.WRITE:
            reason = Reason.NO_PORT if self._port == NONE else self._guard.judge(word, moment)
            if reason is None:
                self._write(word.data)
            else:
                self._refuse(reason)
        elif word.kind is not Kind.FEED:
            if self._port != NONE and self._guard.moving:
                self._stop_motors()
            self._change_port(descriptor)
            self._ended = word.kind is Kind.END
            self._report(moment)

    def _change_port(self, descriptor: int) -> None:
        """Use another port from now on, or none."""
        if self._port != NONE:
            os.close(self._port)
        self._port, self._gone = descriptor, False
        self._guard.opened()

    def _refuse(self, reason: Reason) -> None:
        self._refused[reason] += 1
        self._report_due = 0

    def _report(self, moment: int) -> None:
        """Send a report; a driver that does not read misses it."""
        self._report_due = moment + REPORT_PERIOD
        report = Report(
            self._sequence,
            self._port != NONE,
            self._guard.latched,
            self._acknowledged,
            self._guard.interventions,
            tuple(self._refused),
        )
        with suppress(OSError):
            self._link.send(packed_report(report), socket.MSG_DONTWAIT)

    def _write(self, data: bytes) -> bool:
        """Write all of it; return whether the port took it. The driver detects a lost device when it reads."""
        while data:
            try:
                data = data[os.write(self._port, data) :]
            except BlockingIOError:
                if not select.select([], [self._port], [], WRITING)[1]:
                    return False
            except OSError:
                self._gone = True
                return False
        return True

    def _send_zero(self, moment: int) -> None:
        """Send zero once while the driver is active, which must check itself that the motors stand."""
        for stop in self._wire.stops(time.monotonic_ns()):
            self._write(stop.data)
        self._note_intervention(moment + CONFIRMING)

    def _stop_motors(self) -> None:
        """Send zero until it is acknowledged, twice: the first answer may belong to an earlier request."""
        give_up = now() + STOPPING
        wanted = 2 * self._wire.stops(time.monotonic_ns())
        while wanted and not self._gone and now() < give_up:
            if self._is_acknowledged(wanted[0]):
                wanted.pop(0)
        self._acknowledged = not wanted
        self._note_intervention()

    def _note_intervention(self, confirm_by: int | None = None) -> None:
        """Note that the motors were stopped, unless the device is gone."""
        if self._gone:
            self._guard.opened()
        else:
            self._guard.note_intervention(confirm_by)
        self._report_due = 0

    def _is_acknowledged(self, stop: Stop) -> bool:
        """Send a packet that stops motors; return whether it is acknowledged."""
        quiet_by = now() + LONGEST_QUIET
        while self._read(0.0 if self._wire.streams else QUIET) and now() < quiet_by:
            pass
        if not self._write(stop.data):
            return False
        reply, end = b"", now() + ANSWER
        while not stop.acknowledged(reply):
            data = self._read((end - now()) / 1e9)
            if not data:
                return False
            reply += data
        return True

    def _read(self, timeout: float) -> bytes:
        """Return the bytes received from the controller, after `timeout` (s) at the latest."""
        with suppress(OSError):
            if select.select([self._port], [], [], max(timeout, 0.0))[0]:
                return os.read(self._port, 4096)
        return b""


def keep_its_promises() -> None:
    """Ignore signals that end or stop the driver; get high priority and locked memory, as far as permitted."""
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGTSTP, signal.SIGQUIT, signal.SIGPIPE):
        signal.signal(number, signal.SIG_IGN)
    with suppress(OSError):
        os.sched_setscheduler(0, os.SCHED_RR, os.sched_param(os.sched_get_priority_min(os.SCHED_RR)))
    with suppress(ImportError, OSError, AttributeError):
        import ctypes

        ctypes.CDLL(None).mlockall(LOCK_CURRENT)


def main(arguments: list[str]) -> None:
    """Run the last gate: socket, controller, three flags of its mounting, cycle (ns), path of the latch, parent."""
    link, controller, flags, cycle, latch, parent = arguments
    keep_its_promises()
    wire = wire_of(controller)
    mounting = Mounting(*(flag == "1" for flag in flags))
    guard = Guard(wire, mounting, int(cycle), lambda: bool(latch) and os.path.exists(latch))  # noqa: PTH110
    Gate(socket.socket(fileno=int(link)), guard, wire, int(parent)).run()

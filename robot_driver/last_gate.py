"""The driver's end of the last gate: all writes to the motors go through it, as does the command in force.

The gate (robot_driver/gate) runs in a process of its own; in simulated time, in this one.
"""

import math
import os
import select
import socket
import struct
import subprocess
import sys
import threading
from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType

from robot_driver import gate
from robot_driver.command_gate import CommandGate
from robot_driver.encoders import Wiring
from robot_driver.gate.guard import Guard
from robot_driver.gate.messages import (
    REPORT_LENGTH,
    SECOND,
    Kind,
    Malformed,
    Reason,
    Report,
    Word,
    packed_word,
    report_in,
)
from robot_driver.gate.process import wire_of
from robot_driver.host import Host, Line, LineLost, Terminal

WHO = "The last gate, the process that writes to the motors' port,"
FED = 0.05  # s between messages to the gate while nothing changes; its limit is 0.25 s
CLOSING = 0.6  # s allowed for the gate to close the port: it may have to stop the motors first
ENDING = 1.0  # s allowed for it to end
HANGING = 0.8  # s without a report; one is due each 0.2 s, and stopping the motors takes up to 0.5 s
AWAY = 0.4  # s without checking reports: the computer may have been suspended, and the gate gets this much more time
STARTING = 5.0  # s allowed for it to start, on a busy computer
LOOK = 0.002  # s between polls of its reports while waiting for one


@dataclass(frozen=True)
class Plan:
    """Configuration of the gate: kind of controller, mounting, rate of service, file of the emergency stop."""

    controller: str
    wiring: Wiring
    rate: float
    latch: Path | None

    @property
    def cycle(self) -> int:
        """Duration of a cycle (ns)."""
        return round(SECOND / self.rate)


class LastGate(ABC):
    """The gate, as the driver sees it; a context manager. The command of the motors is the one in force in `commands`.

    `guard` takes an opened line and returns the line to use in its place. `refused` counts what the gate refused, by
    reason, and `interventions` how often it stopped the motors by itself.
    """

    def __init__(self, plan: Plan, commands: CommandGate, host: Host) -> None:
        self.refused = [0] * len(Reason)
        self.interventions = 0
        self.latched = False
        self.news: list[str] = []
        self._plan, self._commands, self._host = plan, commands, host
        self._sequence = 0
        self._noted = 0
        self._last_fed: tuple[float, ...] = ()
        self._feed_due = -math.inf

    def __enter__(self) -> "LastGate":
        return self

    def __exit__(
        self, _kind: type[BaseException] | None, _error: BaseException | None, _trace: TracebackType | None
    ) -> None:
        return

    @abstractmethod
    def guard(self, line: Line) -> Line:
        """Return a line that writes only through the gate. Raises LineLost if there is no gate."""

    def feed(self) -> None:
        """Send the gate the command in force and a sign of life; to be called often."""
        order = self._commands.in_force(self._host.seconds_since_boot())
        now = self._host.monotonic()
        if order != self._last_fed or now >= self._feed_due:
            self._last_fed, self._feed_due = order, now + FED
            self._hand_over(Kind.FEED)

    def has_intervened(self) -> bool:
        """Return whether the gate has stopped the motors since the last call."""
        self._look()
        before, self._noted = self._noted, self.interventions
        if self._noted > before:
            self.news.append("the last gate stopped the motors: the driver had not done it in time")
        return self._noted > before

    def remarks(self) -> list[str]:
        """Return, in sentences, refusals and interventions of the gate."""
        counts = [f"{Reason(number).name.lower()} {count}" for number, count in enumerate(self.refused) if count]
        remarks = [f"Refused by the last gate: {', '.join(counts)}."] if counts else []
        if self.latched and not self._commands.in_force(self._host.seconds_since_boot()).engaged:
            remarks.append("The last gate holds the motors because of an emergency stop on the disk.")
        if self.interventions:
            remarks.append(f"Stopped by the last gate: {self.interventions}.")
        return remarks

    def _word(self, kind: Kind, data: bytes) -> Word:
        self._sequence += 1
        now = self._host.seconds_since_boot()
        left, right, expires, held, engaged = self._commands.in_force(now)
        until = round(SECOND * expires) if expires > 0.0 else 0
        return Word(kind, self._sequence, round(SECOND * now), held, engaged, left, right, until, data)

    @abstractmethod
    def _hand_over(self, kind: Kind, data: bytes = b"") -> None:
        """Send the gate a message."""

    @abstractmethod
    def _look(self) -> None:
        """Read the gate's reports."""


class GateInProcess(LastGate):
    """The gate for simulated time, in which no other process runs: the same guard, called directly."""

    def __init__(self, plan: Plan, commands: CommandGate, host: Host) -> None:
        super().__init__(plan, commands, host)
        latch = plan.latch
        wire, mounting = wire_of(plan.controller), plan.wiring.mounting
        self._guard = Guard(wire, mounting, plan.cycle, lambda: bool(latch and latch.exists()))
        self._line: Line | None = None

    def guard(self, line: Line) -> Line:
        """Return a line that writes through the guard."""
        self._line = line
        self._guard.opened()
        return _LineInProcess(line, lambda data: self._hand_over(Kind.WRITE, data))

    def _look(self) -> None:
        """Do nothing: the guard's actions are recorded when it is called."""

    def _hand_over(self, kind: Kind, data: bytes = b"") -> None:
        word = self._word(kind, data)
        now = round(SECOND * self._host.seconds_since_boot())
        reason = self._guard.take(word, now)
        if reason is None and kind is Kind.WRITE:
            reason = self._guard.judge(word, now)
            if reason is None and self._line is not None:
                self._line.write(data)
        if reason is not None:
            self.refused[reason] += 1


@dataclass(frozen=True)
class _LineInProcess:
    line: Line
    write: Callable[[bytes], object]

    def read(self, most: int, timeout: float) -> bytes:
        return self.line.read(most, timeout)

    def close(self) -> None:
        self.line.close()


class GateProcess(LastGate):
    """The gate in a process of its own, which is started when a port is opened, and again if it has ended by then."""

    def __init__(self, plan: Plan, commands: CommandGate, host: Host) -> None:
        super().__init__(plan, commands, host)
        self.process: subprocess.Popen[bytes] | None = None
        self._link: socket.socket | None = None
        self._lock = threading.Lock()  # for sending
        self._reports = threading.Lock()
        self._report: Report | None = None  # the last one of this process
        self._reported = math.inf  # when that arrived (s)
        self._looked = -math.inf  # when reports were last checked (s)
        self._is_excused = False  # its missing reports are ignored once, as they were not checked
        self._before = self.refused  # by processes before this one
        self._interventions_before = 0

    def __exit__(
        self, _kind: type[BaseException] | None, _error: BaseException | None, _trace: TracebackType | None
    ) -> None:
        if self.process is None:
            return
        try:
            self.send(Kind.END)
            self.process.wait(ENDING)
        except (LineLost, subprocess.TimeoutExpired):
            pass
        self._kill()

    def guard(self, line: Line) -> Line:
        """Pass the port to the gate; this process only reads from the returned line."""
        assert isinstance(line, Terminal), "only ports of this computer can be handed to another process"
        try:
            self._start()
            self.send(Kind.OPEN, descriptor=line.fileno())
            return _GatedLine(self, line.reader())
        finally:
            line.close()

    def send(self, kind: Kind, data: bytes = b"", descriptor: int | None = None) -> int:
        """Send a message; return its number. Raises LineLost."""
        descriptors = [] if descriptor is None else [descriptor]
        with self._lock:
            if self._link is None:
                raise LineLost(f"{WHO} is not running.")
            if self._hangs():
                raise LineLost(f"{WHO} hangs. It is started again.")
            try:
                message = packed_word(self._word(kind, data))
                socket.send_fds(self._link, [message], descriptors, socket.MSG_DONTWAIT)
            except BlockingIOError as error:
                raise LineLost(f"{WHO} takes nothing.") from error
            except OSError as error:
                raise LineLost(f"{WHO} has ended ({error.strerror}). It is started again.") from error
            except struct.error as error:
                raise LineLost(f"The last gate takes no such request: {error}") from error
            return self._sequence

    def close_port(self) -> None:
        """Make the gate close the port, so that it can be opened again; kill a gate that does not."""
        try:
            if self._has_reported(self.send(Kind.CLOSE), CLOSING):
                return
        except LineLost:
            pass
        self._kill()

    def _has_reported(self, sequence: int, seconds: float) -> bool:
        """Wait for the gate's report on a message, or on a later one; return whether it arrived within this many
        seconds.
        """
        end = self._host.monotonic() + seconds
        while self._host.monotonic() < end and self.process is not None and self.process.poll() is None:
            self._look()
            if self._report is not None and self._report.sequence >= sequence:
                return True
            self._host.sleep(LOOK)
        return False

    def _hand_over(self, kind: Kind, data: bytes = b"") -> None:
        try:
            self.send(kind, data)
        except LineLost:
            return  # the next write to the port shows it

    def _start(self) -> None:
        """Start the process, if it does not run. Raises LineLost."""
        if self.process is not None and self.process.poll() is None and not self._hangs():
            return
        again = self.process is not None
        self._kill()
        ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        flags = "".join(str(int(flag)) for flag in self._plan.wiring.mounting)
        latch = "" if self._plan.latch is None else str(self._plan.latch.absolute())
        number = str(theirs.fileno())
        command = [sys.executable, "-I", "-S", str(Path(gate.__file__).with_name("__main__.py"))]
        command += [number, self._plan.controller, flags, str(self._plan.cycle), latch, str(os.getpid())]
        try:
            self.process = subprocess.Popen(
                command, stdin=subprocess.DEVNULL, pass_fds=[theirs.fileno()], start_new_session=True
            )
        except OSError as error:
            ours.close()
            raise LineLost(f"{WHO} cannot be started: {error}") from error
        finally:
            theirs.close()
        ours.setblocking(False)
        with self._lock:
            self._link, self._sequence = ours, 0
        if not self._has_reported(0, STARTING):
            self._kill()
            raise LineLost(f"{WHO} does not start.")
        if again:
            self.news.append("the last gate was started again")

    def _kill(self) -> None:
        """End the process, if it runs, and discard it."""
        with self._lock:
            link, self._link = self._link, None
        if link is not None:
            link.close()
        if self.process is not None and self.process.poll() is None:
            self.process.kill()
            self.process.wait()
        with self._reports:
            self._before, self._interventions_before = list(self.refused), self.interventions
            self._report, self._reported = None, math.inf

    def _hangs(self) -> bool:
        """Return whether it has not reported for so long that it must have failed."""
        self._look()
        return self._host.monotonic() > self._reported + HANGING

    def _look(self) -> None:
        with self._reports:
            self._excuse()
            link = self._link
            while link is not None:
                try:
                    report = report_in(link.recv(REPORT_LENGTH + 1))
                except (OSError, Malformed):
                    return
                self._report, self._reported, self._is_excused = report, self._host.monotonic(), False
                self.latched = report.latched
                self.interventions = self._interventions_before + report.interventions
                self.refused = [before + now for before, now in zip(self._before, report.refused, strict=True)]

    def _excuse(self) -> None:
        """Extend its deadline once if its reports have not been checked for long."""
        now, before = self._host.monotonic(), self._looked
        if now - before > AWAY and not self._is_excused:
            self._reported, self._is_excused = max(self._reported, now - HANGING + AWAY), True
        self._looked = now


class _GatedLine:
    """An opened port whose write descriptor is with the gate."""

    def __init__(self, process: GateProcess, reader: int) -> None:
        self._process = process
        self._reader = reader

    def fileno(self) -> int:
        return self._reader

    def write(self, data: bytes) -> None:
        self._process.send(Kind.WRITE, data)

    def read(self, most: int, timeout: float) -> bytes:
        if not select.select([self._reader], [], [], max(timeout, 0.0))[0]:
            return b""
        data = os.read(self._reader, most)
        if not data:
            raise OSError("it hung up")
        return data

    def close(self) -> None:
        self._process.close_port()
        os.close(self._reader)


def gate_of(plan: Plan, commands: CommandGate, host: Host) -> LastGate:
    """Return the gate for a computer."""
    return GateProcess(plan, commands, host) if host.runs_processes else GateInProcess(plan, commands, host)

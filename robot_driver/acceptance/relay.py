"""Moves bytes between a real port and a pseudo-terminal that the driver opens in its place, through a filter."""

import heapq
import os
import select
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from types import TracebackType

import serial

from cmr.priority import go_first
from robot_driver.acceptance.filter import Line, Piece
from robot_driver.host import PORT_ERRORS, Terminal
from robot_driver.serial_port import PSEUDO_TERMINALS, PortLost, why_not_open
from robot_driver.terminals.pseudo_terminal import PseudoTerminal

CLOSED_PERIOD = 0.005  # s between checks of a port that no driver has open; such a port cannot be waited on
LONGEST_WAIT = 0.1  # s
READ_SIZE = 4096  # bytes


class Relay:
    """Between the port at `path` and a pseudo-terminal behind `link`; a context manager, with a thread inside.

    Raises PortLost on entry if the port cannot be opened. `problem` describes a later loss.
    """

    def __init__(self, path: str, baud_rate: int, link: Path, line: Line) -> None:
        self.problem = ""
        self.late = 0  # ns, largest delay of a piece
        self._path, self._baud_rate, self._link, self._line = path, baud_rate, link, line
        self._due: list[tuple[int, int, Piece]] = []
        self._number = 0
        self._lock = threading.Lock()
        self._plugged_in = True
        self._terminal: PseudoTerminal | None = None
        self._wake_reader, self._wake_writer = os.pipe()
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name=f"relay of {path}", daemon=True)

    def __enter__(self) -> "Relay":
        lock_out = not os.path.realpath(self._path).startswith(PSEUDO_TERMINALS)
        try:
            self._device = Terminal(self._path, self._baud_rate, lock_out=lock_out)
        except (*PORT_ERRORS, ValueError) as error:
            raise PortLost(why_not_open(self._path, error)) from error
        self._terminal = PseudoTerminal(self._link)
        self._thread.start()
        return self

    def __exit__(
        self, _kind: type[BaseException] | None, _error: BaseException | None, _trace: TracebackType | None
    ) -> None:
        self._stop.set()
        self._wake()
        self._thread.join()
        if self._terminal is not None:
            self._terminal.close()
        self._device.close()
        os.close(self._wake_reader)
        os.close(self._wake_writer)

    def unplug(self) -> None:
        """Remove the driver's port, as if the cable were pulled."""
        self._plugged_in = False
        self._wake()

    def plug_in(self) -> None:
        """Bring the port back."""
        self._plugged_in = True
        self._wake()

    def hand_over(self, make: Callable[[int], list[Piece]]) -> None:
        """Pass on what `make` returns, given the time."""
        self._schedule(make(time.monotonic_ns()))
        self._wake()

    def _wake(self) -> None:
        os.write(self._wake_writer, b"x")

    def _schedule(self, pieces: list[Piece]) -> None:
        with self._lock:
            for piece in pieces:
                self._number += 1
                heapq.heappush(self._due, (piece.due, self._number, piece))

    def _run(self) -> None:
        go_first()
        try:
            while not self._stop.is_set():
                self._follow_plug()
                self._turn()
        except PORT_ERRORS as error:
            self.problem = f"The device at {self._path} is gone ({error})."
            self._plugged_in = False
            self._follow_plug()

    def _follow_plug(self) -> None:
        if self._plugged_in and self._terminal is None:
            self._terminal = PseudoTerminal(self._link)
        elif not self._plugged_in and self._terminal is not None:
            self._terminal.close()
            self._terminal = None

    def _turn(self) -> None:
        terminal = self._terminal if self._terminal is not None and self._terminal.is_open else None
        waited_on = [self._device.fileno(), self._wake_reader]
        longest = CLOSED_PERIOD
        if terminal is not None:
            waited_on.append(terminal.fileno())
            longest = LONGEST_WAIT
        if self._due:
            longest = min(longest, max((self._due[0][0] - time.monotonic_ns()) / 1e9, 0.0))
        ready, _, _ = select.select(waited_on, [], [], longest)
        if self._wake_reader in ready:
            os.read(self._wake_reader, READ_SIZE)
        if terminal is not None and terminal.fileno() in ready and (data := terminal.read()):
            self._schedule(self._line.from_driver(data, time.monotonic_ns()))
        self._pass_on()
        if self._device.fileno() in ready and (data := self._device.read(READ_SIZE, 0.0)):
            self._schedule(self._line.from_device(data, time.monotonic_ns()))
            self._pass_on()

    def _pass_on(self) -> None:
        """Pass on the pieces that are due."""
        while self._due and (now := time.monotonic_ns()) >= self._due[0][0]:
            with self._lock:
                due, _, piece = heapq.heappop(self._due)
            self.late = max(self.late, now - due)
            if piece.to_device:
                with suppress(serial.SerialTimeoutException):  # lost, as on a line that accepts nothing
                    self._device.write(piece.data)
            elif self._terminal is not None:
                self._terminal.write(piece.data)

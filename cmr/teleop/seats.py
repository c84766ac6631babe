"""Combinations of input and display for an operator: a terminal, a gamepad alone, a page, or a script."""

import json
import os
import sys
from contextlib import suppress
from typing import Protocol

from cmr.teleop.drive import Drive
from cmr.teleop.hands import END, Hands, Source
from cmr.teleop.keyboard import HELP, Keyboard
from cmr.teleop.remote import Remote
from cmr.teleop.scripted import Scripted
from cmr.teleop.showing import feedback, frame, measured
from cmr.teleop.terminal import Terminal

SHOW_PERIOD = 0.1  # s
BEAT_PERIOD = 0.03  # s; at every second turn
STDIN, STDOUT = 0, 1
MOST_READ = 65_536  # bytes at once
RELEASES = "This terminal reports releases: keys may be held together."
REPEATS = (
    "This terminal reports no releases: hold a key. The robot moves once the key repeats, and stops when that ends. "
    "After a change of keys, the new one has to repeat first."
)
HOLD = "Hold the dead-man button (an upper button at the back) and move the left stick; its right button (B) stops all."


class Seat(Protocol):
    """What cmr-teleop needs of an operator's seat in each cycle. `now` is in seconds of a monotonic clock."""

    def look(self, now: float, ready: bool) -> None:
        """Process what has arrived; `ready` tells whether the robot would move."""

    def hands(self, now: float) -> Hands:
        """Return the demand."""

    def requests(self) -> list[str]:
        """Return the requests since the last call."""

    def problem(self, now: float) -> str:
        """Return why the input is not available; empty if it is."""

    def show(self, drive: Drive, utime: int, now: float) -> None:
        """Show the state of the drive, if it is time to."""

    def is_over(self, now: float) -> bool:
        """Return whether the operator has left."""


class TerminalSeat:
    """A terminal: its keys drive, or another `driver` does; its keys are also used for everything else."""

    def __init__(self, terminal: Terminal, driver: Source | None = None) -> None:
        self._terminal = terminal
        self._keyboard = Keyboard(terminal.read, terminal.write)
        self._driver = driver
        self._due = 0.0

    def look(self, now: float, _ready: bool) -> None:
        """Process what was typed, and the reports of the other source."""
        self._keyboard.look(now)
        if self._driver is not None:
            self._driver.look(now)

    def hands(self, now: float) -> Hands:
        """Return the demand."""
        return (self._driver or self._keyboard).hands(now)

    def requests(self) -> list[str]:
        """Return the requests by key or button."""
        return self._keyboard.requests() + (self._driver.requests() if self._driver is not None else [])

    def problem(self, now: float) -> str:
        """Return why the input is not available."""
        return (self._driver or self._keyboard).problem(now)

    def show(self, drive: Drive, utime: int, now: float) -> None:
        """Show the drive ten times a second."""
        if now >= self._due:
            self._due = now + SHOW_PERIOD
            how = HOLD if self._driver is not None else RELEASES if self._keyboard.reports_releases else REPEATS
            self._terminal.show(frame(drive, f"{HELP}\n{how}", utime, self._terminal.size()))

    def is_over(self, _now: float) -> bool:
        """Return whether the terminal was closed."""
        return self._terminal.gone


class BareSeat:
    """A gamepad without a terminal, or a script, which begins when the robot is ready."""

    def __init__(self, source: Source) -> None:
        self._source = source

    def look(self, now: float, ready: bool) -> None:
        """Process what is reported."""
        if ready or not isinstance(self._source, Scripted):
            self._source.look(now)

    def hands(self, now: float) -> Hands:
        """Return the demand."""
        return self._source.hands(now)

    def requests(self) -> list[str]:
        """Return the requests."""
        return self._source.requests()

    def problem(self, now: float) -> str:
        """Return why the input is not available."""
        return self._source.problem(now)

    def show(self, drive: Drive, utime: int, now: float) -> None:
        """Do nothing: there is no display."""

    def is_over(self, now: float) -> bool:
        """Return whether a script has ended."""
        return isinstance(self._source, Scripted) and self._source.is_over(now)


class PageSeat:
    """A page's joystick, behind standard input and output; never blocks on the page's server."""

    def __init__(self) -> None:
        self._remote = Remote(self._read)
        self._due = 0.0
        self._over = False
        for file in (STDIN, STDOUT):
            os.set_blocking(file, False)

    def look(self, now: float, _ready: bool) -> None:
        """Process the messages of the page."""
        self._remote.look(now)

    def hands(self, now: float) -> Hands:
        """Return the position of the joystick."""
        return self._remote.hands(now)

    def requests(self) -> list[str]:
        """Return the requests made on the page."""
        requests = self._remote.requests()
        self._over |= END in requests
        return requests

    def problem(self, now: float) -> str:
        """Return that the page does not answer."""
        return self._remote.problem(now)

    def show(self, drive: Drive, utime: int, now: float) -> None:
        """Send the next beat with the state of the drive."""
        if now < self._due:
            return
        self._due = now + BEAT_PERIOD
        line = json.dumps({"beat": self._remote.beat(now), **shown(drive, utime)}) + "\n"
        with suppress(BlockingIOError):  # a server that does not read gets no beat, and the robot stops
            try:
                os.write(STDOUT, line.encode())
            except BrokenPipeError:
                self._over = True

    def is_over(self, _now: float) -> bool:
        """Return whether the page was closed."""
        return self._over

    def _read(self) -> bytes | None:
        try:
            return os.read(STDIN, MOST_READ) or None
        except BlockingIOError:
            return b""


def shown(drive: Drive, utime: int) -> dict[str, object]:
    """Return the data for the page; unknown values are None."""
    report, speeds = feedback(drive, utime), measured(drive, utime)
    voltage = report.battery_voltage if report is not None else None
    return {
        "robot": drive.pilot.robot_id,
        "wanted": [round(value, 3) for value in drive.hand.wanted],
        "measured": [round(value, 3) for value in speeds] if speeds else None,
        "duties": [round(duty, 3) for duty in drive.duties],
        "stop": drive.button.text or drive.pilot.estop_reason,
        "waiting": drive.pilot.left_fence or drive.waiting_for,
        "battery": round(voltage, 1) if voltage is not None and voltage == voltage else None,
    }


def has_terminal() -> bool:
    """Return whether this process was started in a terminal."""
    return sys.stdin.isatty()

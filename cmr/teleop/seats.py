"""From where a person drives: a terminal, a gamepad alone, a page, or nowhere, by a script. Each sees and shows."""

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
    """What the process of cmr-teleop asks at each turn. `now` is in seconds of a clock that nobody sets."""

    def look(self, now: float, ready: bool) -> None:
        """Take what has come; `ready` is whether the robot would move."""

    def hands(self, now: float) -> Hands:
        """Return what is asked for."""

    def wishes(self) -> list[str]:
        """Return what was wished since the last call."""

    def problem(self, now: float) -> str:
        """Return why the hands are not seen; empty if they are."""

    def show(self, drive: Drive, utime: int, now: float) -> None:
        """Show what becomes of it, if it is time to."""

    def is_over(self, now: float) -> bool:
        """Return whether nobody sits there any more."""


class TerminalSeat:
    """A terminal: its keys drive, or those of `driver` do, and its keys are for all else."""

    def __init__(self, terminal: Terminal, driver: Source | None = None) -> None:
        self._terminal = terminal
        self._keyboard = Keyboard(terminal.read, terminal.write)
        self._driver = driver
        self._due = 0.0

    def look(self, now: float, _ready: bool) -> None:
        """Take what was typed, and what the other source reports."""
        self._keyboard.look(now)
        if self._driver is not None:
            self._driver.look(now)

    def hands(self, now: float) -> Hands:
        """Return what is asked for."""
        return (self._driver or self._keyboard).hands(now)

    def wishes(self) -> list[str]:
        """Return what was wished by a key or a button."""
        return self._keyboard.wishes() + (self._driver.wishes() if self._driver is not None else [])

    def problem(self, now: float) -> str:
        """Return why the hands are not seen."""
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
        """Take what is reported."""
        if ready or not isinstance(self._source, Scripted):
            self._source.look(now)

    def hands(self, now: float) -> Hands:
        """Return what is asked for."""
        return self._source.hands(now)

    def wishes(self) -> list[str]:
        """Return what was wished."""
        return self._source.wishes()

    def problem(self, now: float) -> str:
        """Return why the hands are not seen."""
        return self._source.problem(now)

    def show(self, drive: Drive, utime: int, now: float) -> None:
        """There is nothing to show it on."""

    def is_over(self, now: float) -> bool:
        """Return whether a script is done."""
        return isinstance(self._source, Scripted) and self._source.is_over(now)


class PageSeat:
    """A page's joystick, behind standard input and output; nothing here waits for the server of the page."""

    def __init__(self) -> None:
        self._remote = Remote(self._read)
        self._due = 0.0
        self._over = False
        for file in (STDIN, STDOUT):
            os.set_blocking(file, False)

    def look(self, now: float, _ready: bool) -> None:
        """Take what the page said."""
        self._remote.look(now)

    def hands(self, now: float) -> Hands:
        """Return where the joystick is."""
        return self._remote.hands(now)

    def wishes(self) -> list[str]:
        """Return what was wished on the page."""
        wishes = self._remote.wishes()
        self._over |= END in wishes
        return wishes

    def problem(self, now: float) -> str:
        """Return that the page is not heard."""
        return self._remote.problem(now)

    def show(self, drive: Drive, utime: int, now: float) -> None:
        """Send the next beat with how the drive goes."""
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
    """Return what a page shows of a drive; what is not known is None."""
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

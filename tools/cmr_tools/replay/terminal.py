"""Keys for a command that plays: each is handled at once, without Return."""

import os
import select
import signal
import termios
import time
import tty
from contextlib import suppress
from types import TracebackType

ARROWS = {b"A": "up", b"B": "down", b"C": "right", b"D": "left"}
READ_BYTES = 1024


def parse_keys(data: bytes) -> list[str]:
    """Return the names of the keys that a terminal sent: left, right, up, down, or the character itself."""
    keys: list[str] = []
    while data:
        if data[:2] in (b"\x1b[", b"\x1bO") and data[2:3] in ARROWS:
            keys.append(ARROWS[data[2:3]])
            data = data[3:]
        else:
            keys.append(chr(data[0]))
            data = data[1:]
    return keys


class Keys:
    """The keys of the terminal at the file `descriptor`; none if it is not a terminal, or belongs to another program.

    A context manager, which restores the terminal.
    """

    def __init__(self, descriptor: int) -> None:
        self._file = descriptor
        self._before: list[int | list[bytes | int]] | None = None

    @property
    def available(self) -> bool:
        """Whether there are keys."""
        return self._before is not None

    def __enter__(self) -> "Keys":
        if os.isatty(self._file) and self._is_ours():
            self._before = termios.tcgetattr(self._file)
            self._listen()
            signal.signal(signal.SIGCONT, lambda _number, _frame: self._listen())  # after Ctrl-Z and fg
        return self

    def __exit__(self, _kind: type | None, _error: BaseException | None, _trace: TracebackType | None) -> None:
        if self._before is not None:
            signal.signal(signal.SIGCONT, signal.SIG_DFL)
            with suppress(termios.error):  # the terminal was closed
                termios.tcsetattr(self._file, termios.TCSADRAIN, self._before)

    def wait(self, seconds: float) -> list[str]:
        """Wait this long, or until keys are pressed; return them."""
        if not self.available:
            time.sleep(seconds)
            return []
        if not select.select([self._file], [], [], seconds)[0]:
            return []
        try:
            data = os.read(self._file, READ_BYTES)
        except OSError:
            data = b""
        if not data:  # the terminal was closed
            self._before = None
        return parse_keys(data)

    def _is_ours(self) -> bool:
        """Return whether this program is in the foreground of the terminal."""
        try:
            return os.tcgetpgrp(self._file) == os.getpgrp()
        except OSError:  # no shell controls programs by this terminal
            return True

    def _listen(self) -> None:
        """Make the terminal send each key at once; earlier input is kept."""
        tty.setcbreak(self._file, termios.TCSANOW)

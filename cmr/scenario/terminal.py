"""Progress on the terminal: one line that is written anew; without a terminal, a line now and then."""

import shutil
import sys
import time
from typing import TextIO

AMBER, PLAIN = "\x1b[33m", "\x1b[0m"
CLEAR = "\r\x1b[2K"
WITHOUT_TERMINAL = 10.0  # s between lines
WITH_TERMINAL = 0.2  # s between rewritings


class Terminal:
    """Where a run tells how it goes."""

    def __init__(self, stream: TextIO = sys.stdout) -> None:
        self._stream = stream
        self._is_terminal = stream.isatty()
        self._period = WITH_TERMINAL if self._is_terminal else WITHOUT_TERMINAL
        self._due = 0.0

    def progress(self, text: str) -> None:
        """Show how it goes, if it is time to."""
        now = time.monotonic()
        if now < self._due:
            return
        self._due = now + self._period
        if self._is_terminal:
            width = shutil.get_terminal_size().columns - 1
            self._write(f"{CLEAR}{text[:width]}")
        else:
            self._write(f"{text}\n")

    def say(self, text: str) -> None:
        """Write a line that stays."""
        self._write(f"{CLEAR if self._is_terminal else ''}{text}\n")
        if self._is_terminal:
            self._due = 0.0

    def warn(self, text: str) -> None:
        """Write a line that stays, in amber on a terminal."""
        self.say(f"{AMBER}{text}{PLAIN}" if self._is_terminal else text)

    def end(self) -> None:
        """Take the progress away."""
        if self._is_terminal:
            self._write(CLEAR)

    def _write(self, text: str) -> None:
        self._stream.write(text)
        self._stream.flush()

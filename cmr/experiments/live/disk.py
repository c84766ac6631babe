"""Whether a run can go on being recorded: how much room the disk has, and whether what is written arrives there."""

import shutil
import time
from pathlib import Path

WARN_BELOW = 1e9  # bytes that are left
CALM_ABOVE = 1.1e9  # bytes; it warns again when it was calm in between
END_BELOW = 100e6  # bytes that are left for the end of the log, and for the report
END_SHARE = 0.1  # of a small disk
LOOK_EVERY = 1.0  # s


class Disk:
    """Watches the disk on which a folder lies."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._due = 0.0
        self._is_short = False
        self._full = ""

    @property
    def full(self) -> str:
        """Why nothing more can be recorded; empty while it can."""
        return self._full

    @property
    def shortage(self) -> str:
        """How little room is left; empty while there is enough."""
        return f"The disk of {self._folder} is nearly full." if self._is_short else ""

    def look(self) -> str:
        """Look once a second; return a sentence when little room is left, once."""
        now = time.monotonic()
        if now < self._due:
            return ""
        self._due = now + LOOK_EVERY
        total, _used, free = shutil.disk_usage(self._folder)
        end = min(END_BELOW, END_SHARE * total)
        if free < end:
            self._full = f"the disk of {self._folder} is full: {_size(free)} are left"
        was_short = self._is_short
        self._is_short = free < (CALM_ABOVE if was_short else WARN_BELOW)
        if not self._is_short or was_short:
            return ""
        return f"Only {_size(free)} are left on the disk of {self._folder}; the run ends when {_size(end)} are."

    def note(self, error: OSError) -> None:
        """Take to the fact that something could not be written."""
        self._full = f"{self._folder} cannot be written: {error.strerror or error}"


def _size(count: float) -> str:
    return f"{count / 1e9:.1f} GB" if count >= 1e9 else f"{count / 1e6:.0f} MB"

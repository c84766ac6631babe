"""Watch the disk while recording: its free space, and failed writes."""

import os
import shutil
import tempfile
import time
from contextlib import suppress
from pathlib import Path
from typing import IO

WARN_BELOW = 1e9  # bytes of free space
CALM_ABOVE = 1.1e9  # bytes; the warning can repeat after free space was above this
END_BELOW = 100e6  # bytes reserved for the end of the log and the report
END_SHARE = 0.1  # of a small disk
LOOK_EVERY = 1.0  # s
FOR_REPORT = 20e6  # bytes reserved for the report, on a disk that others may fill at any time
SHARE_FOR_REPORT = 0.05  # of a small disk


class Disk:
    """Watches the disk of a folder, and reserves space for a report."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._held: IO[bytes] | None = None
        self._due = 0.0
        self._is_short = False
        self._full = ""

    @property
    def full(self) -> str:
        """Why recording is no longer possible; empty while it is."""
        return self._full

    @property
    def shortage(self) -> str:
        """A sentence on low disk space; empty if there is enough."""
        return f"The disk of {self._folder} is nearly full." if self._is_short else ""

    def hold_room(self) -> None:
        """Reserve space for the report in an unnamed file, which disappears with this process."""
        with suppress(OSError):  # no space left, or not supported
            self._held = tempfile.TemporaryFile(dir=self._folder)  # noqa: SIM115 - `give_room` closes it
            size = min(FOR_REPORT, SHARE_FOR_REPORT * shutil.disk_usage(self._folder).total)
            os.posix_fallocate(self._held.fileno(), 0, int(size))

    def give_room(self) -> None:
        """Release the space reserved for the report."""
        if self._held is not None:
            self._held.close()

    def look(self) -> str:
        """Check once a second; return a sentence when space becomes low, once."""
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
        """Record that a write failed."""
        self._full = f"{self._folder} cannot be written: {error.strerror or error}"


def _size(count: float) -> str:
    return f"{count / 1e9:.1f} GB" if count >= 1e9 else f"{count / 1e6:.0f} MB"

"""Logs that visitors bring: what is taken, in words for those whose file is not, and where it is kept meanwhile."""

import tempfile
from itertools import count
from pathlib import Path
from typing import NamedTuple

from cmr.recordings.events import HEADER, SYNC, EventReader

LARGEST_LOG = 200_000_000  # bytes; while a log arrives, it is held in memory twice
MOST_ARRIVING = 2 * LARGEST_LOG  # bytes of all visitors together
MOST_OPENED = 4  # logs; the process plays them beside its own task
LONGEST_NAME = 80  # characters that are shown


class RefusedLog(Exception):  # noqa: N818 - it is a finding, not a failure of the program
    """A file that is not opened, with a sentence for the visitor that says why and what to do."""


class OpenedLog(NamedTuple):
    """A log that a visitor brought: its name there, and the file here."""

    name: str
    path: Path

    def remove(self) -> None:
        """Delete the file."""
        self.path.unlink(missing_ok=True)


def check_size(size: int, arriving: int) -> None:
    """Raise RefusedLog for a file of `size` bytes that is too large, or too much beside what is `arriving` already."""
    if size > LARGEST_LOG:
        raise RefusedLog(too_large())
    if size + arriving > MOST_ARRIVING:
        raise RefusedLog("Other logs are being sent to this page. Wait a moment, then try again.")


def too_large() -> str:
    """Return what is said of a file that is too large."""
    return f"The file is larger than {LARGEST_LOG / 1e6:.0f} MB. Run `cmr-view FILE` in a terminal to open it."


class LogFolder:
    """Where logs of visitors are kept until they are closed; the folder goes with the process."""

    def __init__(self) -> None:
        self._folder = tempfile.TemporaryDirectory(prefix="cmr-view-")
        self._numbers = count()

    def keep(self, name: str, content: bytes) -> OpenedLog:
        """Keep a log. Raises RefusedLog for what is none, OSError where it cannot be written."""
        shown = Path(name).name[:LONGEST_NAME] or "log"
        log = OpenedLog(shown, Path(self._folder.name) / f"{next(self._numbers)}.lcm")
        log.path.write_bytes(content)
        # The reader looks at each sync word. More of them than events have room for are none, and would keep it busy.
        is_crowded = content.count(SYNC) * HEADER.size > len(content)
        if is_crowded or next(iter(EventReader(log.path)), None) is None:
            log.remove()
            raise RefusedLog(
                f"{shown} is not an LCM event log. Expected is a file such as run.lcm, as cmr-run or lcm-logger "
                "writes it. Use cmr-import for recordings in other formats."
            )
        return log

    def clean(self) -> None:
        """Delete all that is left."""
        self._folder.cleanup()

"""Logs uploaded by visitors: limits, error messages, and temporary storage."""

import shutil
import tempfile
from contextlib import suppress
from itertools import count
from pathlib import Path
from typing import BinaryIO, NamedTuple

from cmr.litter import temporary_beside
from cmr.recordings.events import HEADER, SYNC, EventReader

LARGEST_LOG = 200_000_000  # bytes
MOST_ARRIVING = 2 * LARGEST_LOG  # bytes of all visitors together
MOST_OPENED = 4  # logs; the process plays them beside its own task
LEFT_FREE = 100_000_000  # bytes of disk space left free
LONGEST_NAME = 80  # characters that are shown
CHUNK = 1 << 20  # bytes


class RefusedLog(Exception):  # noqa: N818 - it is a finding, not a failure of the program
    """A file is refused, with a sentence for the visitor on why and what to do."""


class OpenedLog(NamedTuple):
    """An uploaded log: its original name, and its file here."""

    name: str
    path: Path

    def remove(self) -> None:
        """Delete the file."""
        self.path.unlink(missing_ok=True)


def check_size(size: int, arriving: int) -> None:
    """Raise RefusedLog for a file of `size` bytes that is too large, alone or together with uploads that are
    `arriving`.
    """
    if size > LARGEST_LOG:
        raise RefusedLog(too_large())
    if size + arriving > MOST_ARRIVING:
        raise RefusedLog("Other logs are being sent to this page. Wait a moment, then try again.")


def too_large() -> str:
    """Return the message for a file that is too large."""
    return f"The file is larger than {LARGEST_LOG / 1e6:.0f} MB. Run `cmr-view FILE` in a terminal to open it."


class LogFolder:
    """Temporary folder of uploaded logs, deleted with the process."""

    def __init__(self) -> None:
        self._folder = temporary_beside(Path(tempfile.gettempdir()) / "cmr-view")
        self._folder.mkdir(mode=0o700)
        self._numbers = count()

    def check_room(self, size: int) -> None:
        """Raise RefusedLog if the disk has no space for a file of `size` bytes."""
        if shutil.disk_usage(self._folder).free < size + LEFT_FREE:
            raise RefusedLog(
                "The disk of the computer running cmr-view is nearly full. Free some space there, then try again."
            )

    def begin(self) -> BinaryIO:
        """Create a file for an upload. Raises OSError."""
        return (self._folder / f"{next(self._numbers)}.lcm").open("xb")

    def drop(self, stream: BinaryIO) -> None:
        """Delete an incomplete upload."""
        with suppress(OSError):  # of a full disk, on which buffered data cannot be written
            stream.close()
        Path(stream.name).unlink(missing_ok=True)

    def keep(self, name: str, stream: BinaryIO) -> OpenedLog:
        """Keep a complete upload. Raises RefusedLog if it is not a log, OSError if it cannot be written."""
        shown = Path(name).name[:LONGEST_NAME] or "log"
        log = OpenedLog(shown, Path(stream.name))
        try:
            stream.close()
            is_log = not _is_crowded(log.path) and next(iter(EventReader(log.path)), None) is not None
        except OSError:
            log.remove()
            raise
        if not is_log:
            log.remove()
            raise RefusedLog(
                f"{shown} is not an LCM event log. Expected is a file such as run.lcm, as cmr-run or lcm-logger "
                "writes it. Use cmr-import for recordings in other formats."
            )
        return log

    def clean(self) -> None:
        """Delete all that is left."""
        shutil.rmtree(self._folder, ignore_errors=True)


def _is_crowded(path: Path) -> bool:
    """Return whether there are more sync words than events fit: each would cost the reader time."""
    words, size, tail = 0, 0, b""
    with path.open("rb") as stream:
        while chunk := stream.read(CHUNK):
            words += (tail + chunk).count(SYNC)
            size += len(chunk)
            tail = chunk[1 - len(SYNC) :]
    return words * HEADER.size > size

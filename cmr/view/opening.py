"""Logs that visitors bring: what is taken, in words for those whose file is not, and where it is kept meanwhile."""

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
LEFT_FREE = 100_000_000  # bytes of the disk that logs of visitors do not take
LONGEST_NAME = 80  # characters that are shown
CHUNK = 1 << 20  # bytes


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
    """Return the message for a file that is too large."""
    return f"The file is larger than {LARGEST_LOG / 1e6:.0f} MB. Run `cmr-view FILE` in a terminal to open it."


class LogFolder:
    """Where logs of visitors are kept until they are closed; the folder goes with the process."""

    def __init__(self) -> None:
        self._folder = temporary_beside(Path(tempfile.gettempdir()) / "cmr-view")
        self._folder.mkdir(mode=0o700)
        self._numbers = count()

    def check_room(self, size: int) -> None:
        """Raise RefusedLog where the disk has no room for a file of `size` bytes."""
        if shutil.disk_usage(self._folder).free < size + LEFT_FREE:
            raise RefusedLog(
                "The disk of the computer running cmr-view is nearly full. Free some space there, then try again."
            )

    def begin(self) -> BinaryIO:
        """Open a file for a log that is arriving. Raises OSError where there can be none."""
        return (self._folder / f"{next(self._numbers)}.lcm").open("xb")

    def drop(self, stream: BinaryIO) -> None:
        """Delete a log of which not everything has come."""
        with suppress(OSError):  # of a full disk, to which the rest of it could not be written
            stream.close()
        Path(stream.name).unlink(missing_ok=True)

    def keep(self, name: str, stream: BinaryIO) -> OpenedLog:
        """Keep a log that has come. Raises RefusedLog for what is none, OSError where it cannot be written."""
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
    """Return whether there are more sync words than events have room for: the reader would look at each of them."""
    words, size, tail = 0, 0, b""
    with path.open("rb") as stream:
        while chunk := stream.read(CHUNK):
            words += (tail + chunk).count(SYNC)
            size += len(chunk)
            tail = chunk[1 - len(SYNC) :]
    return words * HEADER.size > size

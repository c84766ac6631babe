"""Write an LCM event log to disk in chunks of whole events."""

import os
import time
from contextlib import suppress
from itertools import count
from pathlib import Path
from types import TracebackType

from cmr.recordings.events import Event, event_bytes

PIECE = 1 << 16  # bytes buffered before writing
OLDEST = 0.2  # s after which they are written anyway


class LogFile:
    """Appends events to a new file. If the disk is full, the file ends with a whole event.

    A context manager that closes it. Everything raises OSError when the file cannot be written.
    """

    def __init__(self, path: Path) -> None:
        self._descriptor = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_TRUNC | os.O_CLOEXEC, 0o666)
        self._numbers = count()
        self._kept: list[bytes] = []
        self._bytes = 0  # that are kept
        self._written = 0  # bytes, of whole events
        self._due = 0.0

    def __enter__(self) -> "LogFile":
        return self

    def __exit__(
        self, _kind: type[BaseException] | None, _error: BaseException | None, _trace: TracebackType | None
    ) -> None:
        self.close()

    def write(self, utime: int, channel: str, data: bytes) -> None:
        """Append a message that came on a channel at `utime` [us]."""
        event = event_bytes(Event(next(self._numbers), utime, channel, data))
        if not self._kept:
            self._due = time.monotonic() + OLDEST
        self._kept.append(event)
        self._bytes += len(event)
        if self._bytes >= PIECE:
            self.flush()
        else:
            self.flush_if_due()

    def flush_if_due(self) -> None:
        """Write the buffer if it is old enough."""
        if self._kept and time.monotonic() >= self._due:
            self.flush()

    def flush(self) -> None:
        """Write the buffer."""
        piece = memoryview(b"".join(self._kept))
        self._kept, self._bytes = [], 0
        done = 0
        try:
            while done < len(piece):
                done += os.write(self._descriptor, piece[done:])
        except OSError:
            with suppress(OSError):  # not a regular file
                os.ftruncate(self._descriptor, self._written)
                os.lseek(self._descriptor, self._written, os.SEEK_SET)
            raise
        self._written += done

    def close(self) -> None:
        """Write the buffer and close the file."""
        try:
            self.flush()
        finally:
            os.close(self._descriptor)

"""Open event logs for the commands that look at logs: with errors in one line, a choice of channels, and progress."""

import sys
import time
from collections.abc import Callable, Iterator, Sequence
from fnmatch import fnmatchcase
from functools import lru_cache
from pathlib import Path
from types import TracebackType

from cmr.bus.older import as_of_today
from cmr.commands.command_line import CommandError
from cmr.recordings.events import Event, EventReader

__all__ = ["Event", "EventReader", "Progress", "channel_chooser", "damage_sentence", "open_log", "reading"]

BAR_WIDTH = 30  # characters
BETWEEN_REDRAWINGS = 0.2  # s
EVENTS_BETWEEN_LOOKS_AT_THE_CLOCK = 1000
CLEAR = "\r\x1b[2K"


def open_log(path: Path) -> EventReader:
    """Open an event log.

    Raises CommandError when it cannot be read.
    """
    try:
        if path.exists() and not path.is_file():
            raise CommandError(f"{path} is no file. Name an event log, as lcm-logger writes it")
        return EventReader(path)
    except OSError as error:
        raise CommandError(f"{path}: {error.strerror or error}") from error


def channel_chooser(patterns: Sequence[str], without: Sequence[str] = ()) -> Callable[[str], bool]:
    """Return what tells whether a channel fits one of the shell patterns, or any if there are none, and none of
    `without`.
    """

    @lru_cache(maxsize=10_000)
    def is_chosen(channel: str) -> bool:
        is_wanted = not patterns or any(fnmatchcase(channel, pattern) for pattern in patterns)
        return is_wanted and not any(fnmatchcase(channel, pattern) for pattern in without)

    return is_chosen


def damage_sentence(log: EventReader) -> str:
    """Return what was damaged in a log that has been read; empty if nothing was."""
    if not log.damaged_bytes:
        return ""
    places = "1 place" if log.damaged_places == 1 else f"{log.damaged_places} places"
    return f"{log.path}: {log.damaged_bytes} of {log.size} bytes, in {places}, are damaged; the intact events are used."


def reading(log: EventReader, progress: "Progress") -> Iterator[Event]:
    """Yield the events of a log, messages of older types as those of today, and show how much of it has been read."""
    before = 0
    for count, event in enumerate(log):
        if count % EVENTS_BETWEEN_LOOKS_AT_THE_CLOCK == 0:
            progress.show(log.position - before)
            before = log.position
        data = as_of_today(event.data)
        yield event if data is event.data else event._replace(data=data)
    progress.show(log.position - before)


class Progress:
    """A bar on stderr while `total` bytes are read; nothing where stderr is no terminal. A context manager."""

    def __init__(self, total: int) -> None:
        self._total = max(total, 1)
        self._done = 0
        self._is_terminal = sys.stderr.isatty()
        self._began = time.monotonic()
        self._due = self._began + BETWEEN_REDRAWINGS

    def __enter__(self) -> "Progress":
        return self

    def __exit__(self, _kind: type | None, _error: BaseException | None, _trace: TracebackType | None) -> None:
        if self._is_terminal:
            print(CLEAR, end="", file=sys.stderr, flush=True)

    def show(self, more: int) -> None:
        """Show that so many bytes more have been read."""
        self._done += more
        now = time.monotonic()
        if not self._is_terminal or now < self._due:
            return
        self._due = now + BETWEEN_REDRAWINGS
        share = min(self._done / self._total, 1.0)
        left = (now - self._began) * (1.0 - share) / max(share, 1e-3)
        filled = round(BAR_WIDTH * share)
        bar = "#" * filled + "." * (BAR_WIDTH - filled)
        text = f"[{bar}] {share:4.0%} of {self._total / 1e6:.0f} MB, {left:.0f} s left"
        print(f"{CLEAR}{text}", end="", file=sys.stderr, flush=True)

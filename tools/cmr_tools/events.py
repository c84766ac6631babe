"""Open event logs for log commands: one-line errors, a selection of channels, and progress."""

from collections.abc import Callable, Iterator, Sequence
from fnmatch import fnmatchcase
from functools import lru_cache
from pathlib import Path

from cmr.bus.older import as_of_today
from cmr.cli.errors import CommandError
from cmr.cli.progress import BYTES, Progress
from cmr.recordings.events import Event, EventReader

__all__ = ["Event", "EventReader", "channel_chooser", "damage_sentence", "open_log", "progress_of", "reading"]

EVENTS_BETWEEN_SHOWINGS = 1000


def open_log(path: Path) -> EventReader:
    """Open an event log.

    Raises CommandError if it cannot be read.
    """
    try:
        if path.exists() and not path.is_file():
            raise CommandError(f"{path} is no file. Name an event log, as lcm-logger writes it")
        return EventReader(path)
    except OSError as error:
        raise CommandError(f"{path}: {error.strerror or error}") from error


def channel_chooser(patterns: Sequence[str], without: Sequence[str] = ()) -> Callable[[str], bool]:
    """Return a function that tells whether a channel matches one of the shell patterns (any if there are none) and none
    of `without`.
    """

    @lru_cache(maxsize=10_000)
    def is_chosen(channel: str) -> bool:
        is_wanted = not patterns or any(fnmatchcase(channel, pattern) for pattern in patterns)
        return is_wanted and not any(fnmatchcase(channel, pattern) for pattern in without)

    return is_chosen


def damage_sentence(log: EventReader) -> str:
    """Return a sentence on the damage found while reading a log; empty if there was none."""
    if not log.damaged_bytes:
        return ""
    places = "1 place" if log.damaged_places == 1 else f"{log.damaged_places} places"
    return f"{log.path}: {log.damaged_bytes} of {log.size} bytes, in {places}, are damaged; the intact events are used."


def progress_of(logs: Sequence[EventReader]) -> Progress:
    """Return the progress bar for reading these logs."""
    return Progress(sum(log.size for log in logs), BYTES)


def reading(log: EventReader, progress: Progress) -> Iterator[Event]:
    """Yield the events of a log, with messages of older types converted, and show the progress."""
    before = 0
    for count, event in enumerate(log):
        if count % EVENTS_BETWEEN_SHOWINGS == 0:
            progress.advance(log.position - before)
            before = log.position
        data = as_of_today(event.data)
        yield event if data is event.data else event._replace(data=data)
    progress.advance(log.position - before)

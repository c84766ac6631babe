"""Cut a piece out of an event log, and merge several logs, event by event."""

import heapq
import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path

from cmr.recordings.events import Event, event_bytes
from cmr.recordings.log_clock import utime_after
from cmr_tools.writing import complete_or_none


def cut(events: Iterable[Event], first: float, last: float, is_chosen: Callable[[str], bool]) -> Iterator[Event]:
    """Yield the events from `first` until before `last` [s since the log's first event] on the channels chosen.

    The order is kept. Both times are rounded to microseconds, so that consecutive pieces neither share nor lose an
    event.
    """
    begin: int | None = None
    from_utime, to_utime = 0.0, 0.0
    for event in events:
        if begin is None:
            begin = event.utime
            from_utime = -math.inf if first <= 0.0 else utime_after(begin, first)
            to_utime = math.inf if math.isinf(last) else utime_after(begin, last)
        if from_utime <= event.utime < to_utime and is_chosen(event.channel):
            yield event


def merge(logs: Sequence[Iterable[Event]]) -> Iterator[Event]:
    """Yield the events of all logs by logging time; events of one log keep their order.

    Among events of equal time, those of the log named first come first.
    """
    return heapq.merge(*logs, key=lambda event: event.utime)


def write_events(path: Path, events: Iterable[Event]) -> int:
    """Write the events, numbered again, to a log that gets its name when it is complete; return how many there were.

    Without events nothing is written. Raises OSError if the file cannot be written, KeyboardInterrupt on a signal.
    """
    iterator = iter(events)
    first = next(iterator, None)
    if first is None:
        return 0
    with complete_or_none(path) as temporary, temporary.open("wb", buffering=1 << 20) as stream:
        stream.write(event_bytes(first._replace(number=0)))
        number = 0
        for number, event in enumerate(iterator, start=1):
            stream.write(event_bytes(Event(number, event.utime, event.channel, event.data)))
    return number + 1

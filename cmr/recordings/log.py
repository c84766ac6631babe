"""Read LCM event logs message by message; damaged parts are passed over."""

from collections import Counter
from collections.abc import Iterator
from pathlib import Path

from cmr.bus.messages import Received, RejectedMessage, decode
from cmr.bus.streams import SELF_TESTS
from cmr.recordings.events import EventReader


class LogReader:
    """The messages of an event log at `path`, in the order in which they were logged.

    `rejected` counts by (channel, reason) what was not taken while iterating; what processes send to test the bus is
    passed over. A truncated log yields its intact events. Raises OSError when the file cannot be opened.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.rejected: Counter[tuple[str, str]] = Counter()
        self._events = EventReader(path)

    def __iter__(self) -> Iterator[Received]:
        for event in self._events:
            if event.channel in SELF_TESTS:
                continue
            try:
                yield decode(event.channel, event.data)
            except RejectedMessage as rejected:
                self.rejected[event.channel, rejected.reason] += 1

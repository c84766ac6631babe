"""Read LCM event logs message by message; damaged parts are counted and passed over."""

from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import lcm

from cmr.bus.messages import Received, RejectedMessage, decode
from cmr.bus.streams import SELF_TESTS

EVENT_HEADER_BYTES = 28  # sync word, event number, time stamp, lengths of channel name and of data


class LogReader:
    """The messages of an event log at `path`, in the order in which they were logged.

    `rejected` counts by (channel, reason) what was not taken while iterating; what processes send to test the bus is
    passed over. A truncated log yields its intact events. Raises OSError when the file cannot be opened.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.rejected: Counter[tuple[str, str]] = Counter()
        with path.open("rb"):
            pass  # LCM's own error does not say why a file cannot be opened

    def __iter__(self) -> Iterator[Received]:
        log = lcm.EventLog(str(self.path), "r")
        try:
            for event in intact_events(log):
                if event.channel in SELF_TESTS:
                    continue
                try:
                    yield decode(event.channel, event.data)
                except RejectedMessage as rejected:
                    self.rejected[event.channel, rejected.reason] += 1
        finally:
            log.close()


def intact_events(log: lcm.EventLog) -> Iterator[lcm.Event]:
    """Yield the intact events of an open log.

    LCM ends its iteration at the first damaged event, but finds the next intact one when it is asked again; only
    when nothing more is read is it the end.
    """
    position = -1
    while log.tell() > position:
        position = log.tell()
        try:
            event = log.read_next_event()
        except UnicodeDecodeError:  # the channel name is damaged
            continue
        if event is not None:
            yield event

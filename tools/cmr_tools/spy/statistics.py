"""Statistics of all channels on a bus, and checks that messages belong to their channel."""

from functools import cache

from cmr.bus.channel_statistics import ChannelStatistics, Line
from cmr.bus.message import FINGERPRINT_BYTES
from cmr.bus.older import as_of_today
from cmr.bus.wire import TYPES, channel_of

WINDOW = 5_000_000  # us over which rates and jitter are computed


class Statistics:
    """Counts messages as they arrive; errors are messages of another type than the channel's, of another robot, or too
    short. `lines` returns the state of all channels.
    """

    def __init__(self) -> None:
        self._statistics = ChannelStatistics(WINDOW)
        self.lines = self._statistics.lines

    def handle(self, utime: int, channel: str, data: bytes) -> None:
        """Process a message that arrived at `utime` [us]."""
        data = as_of_today(data)
        self._statistics.take(utime, channel, data)
        known = channel_of(channel)
        if known is not None and known.fault(data):
            self._statistics.reject(channel)


def type_name(line: Line) -> str:
    """Return the name of the type of a channel's last message, if it is one of CMR's."""
    return _name_of(line.data[:FINGERPRINT_BYTES])


@cache
def _name_of(fingerprint: bytes) -> str:
    message_type = TYPES.get(fingerprint)
    return message_type.__name__ if message_type is not None else "unknown"

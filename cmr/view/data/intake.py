"""Convert messages to state: count everything, decode only what will be shown."""

from collections.abc import Callable

from cmr.bus.messages import RejectedMessage, decode
from cmr.bus.possible import screened
from cmr.bus.streams import CAMERA_IMAGE, PROCESS_STATUS, SELF_TESTS, WORLD_STATE
from cmr.view.data.state import ViewState

MOST_KEPT = 100  # messages kept per channel between two pictures, for channels on which every one counts


class Intake:
    """Collects encoded messages, and passes the relevant ones to a state on `flush`.

    For channels of one robot the last message counts; for those with several senders or parts, the last hundred. Every
    message is also passed to `record`, undecoded.
    """

    def __init__(self, state: ViewState, record: Callable[[int, str, bytes], None] = lambda *_message: None) -> None:
        self.state = state
        self._record = record
        self._last: dict[str, tuple[int, bytes]] = {}
        shared = (WORLD_STATE, PROCESS_STATUS, CAMERA_IMAGE)
        self._every: dict[str, list[tuple[int, bytes]]] = {stream.name: [] for stream in shared}

    def take(self, utime: int, channel: str, data: bytes) -> None:
        """Add a message that arrived at `utime` [us]."""
        if channel in SELF_TESTS:
            return
        self.state.traffic.take(utime, channel, data)
        self._record(utime, channel, data)
        if channel in self._every:
            self._every[channel].append((utime, data))
        else:
            self._last[channel] = utime, data

    def flush(self) -> None:
        """Decode the relevant messages since the last call."""
        for channel, (utime, data) in self._last.items():
            self._decode(utime, channel, data)
        for channel, messages in self._every.items():
            for utime, data in messages[-MOST_KEPT:]:
                self._decode(utime, channel, data)
            messages.clear()
        self._last.clear()

    def _decode(self, utime: int, channel: str, data: bytes) -> None:
        try:
            message, impossible = screened(decode(channel, data).message)
        except RejectedMessage:
            self.state.traffic.reject(channel)
            return
        if impossible:
            self.state.traffic.reject(channel)
        if message is not None:
            self.state.handle(utime, channel, message)

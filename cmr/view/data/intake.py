"""From bytes to what is shown: counts everything, decodes only what will be seen."""

from collections.abc import Callable

from cmr.bus.messages import RejectedMessage, decode
from cmr.bus.possible import screened
from cmr.bus.streams import CAMERA_IMAGE, PROCESS_STATUS, SELF_TESTS, WORLD_STATE
from cmr.view.data.state import ViewState

MOST_KEPT = 100  # messages between two pictures of a channel of which every one counts


class Intake:
    """Takes encoded messages, and hands those that count to a state when `flush` is called.

    Of a channel of one robot the last message counts; of those on which several processes speak, or which come in
    parts, the last hundred. Every message is handed to `record` besides, undecoded.
    """

    def __init__(self, state: ViewState, record: Callable[[int, str, bytes], None] = lambda *_message: None) -> None:
        self.state = state
        self._record = record
        self._last: dict[str, tuple[int, bytes]] = {}
        shared = (WORLD_STATE, PROCESS_STATUS, CAMERA_IMAGE)
        self._every: dict[str, list[tuple[int, bytes]]] = {stream.name: [] for stream in shared}

    def take(self, utime: int, channel: str, data: bytes) -> None:
        """Take a message that came at `utime` [us]."""
        if channel in SELF_TESTS:
            return
        self.state.traffic.take(utime, channel, data)
        self._record(utime, channel, data)
        if channel in self._every:
            self._every[channel].append((utime, data))
        else:
            self._last[channel] = utime, data

    def flush(self) -> None:
        """Decode what came since the last time and counts."""
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

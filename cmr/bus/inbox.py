"""What has arrived on a bus, decoded and checked, until it is received."""

from collections import deque

from cmr.bus.messages import Received, RejectedMessage, decode
from cmr.bus.rejections import Rejections
from cmr.bus.signing import RefusedSignature, Verifier
from cmr.bus.streams import WORLD_STATE
from cmr.bus.texts import make_plain

MOST_OWN = 64  # messages of a process that it knows again when the bus brings them back


class Inbox:
    """Messages in the order of their arrival. `rejected` counts what was not taken, by (channel, reason)."""

    def __init__(self, verifier: Verifier) -> None:
        self.rejected = Rejections()
        self._verifier = verifier
        self._arrived: list[Received] = []
        self._own: deque[bytes] = deque(maxlen=MOST_OWN)

    def pass_over(self, data: bytes) -> None:
        """Do not take this WORLD_STATE when the bus brings it back to its sender."""
        self._own.append(data)

    def take(self, channel: str, data: bytes) -> None:
        """Take the bytes of a message, as LCM hands them over."""
        if channel == WORLD_STATE.name and data in self._own:
            self._own.remove(data)
            return
        try:
            signed = self._verifier.verify(channel, data)
            received = decode(channel, signed.data)
        except (RejectedMessage, RefusedSignature) as rejected:
            self.rejected.note(channel, rejected.reason)
        else:
            make_plain(received.message)
            self._arrived.append(received._replace(sender=signed.sender))

    def emptied(self) -> list[Received]:
        """Return what has arrived since the last call, oldest first."""
        arrived, self._arrived = self._arrived, []
        return arrived

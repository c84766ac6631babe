"""Queue of messages that have arrived on the bus, decoded and checked."""

from collections import deque

from cmr.bus.messages import Received, RejectedMessage, decode
from cmr.bus.rejections import Rejections
from cmr.bus.signing import RefusedSignature, Verifier
from cmr.bus.streams import WORLD_STATE
from cmr.bus.texts import make_plain

MOST_OWN = 64  # own messages that a process recognises when the bus returns them


class Inbox:
    """Messages in the order of their arrival. `rejected` counts rejected messages by (channel, reason)."""

    def __init__(self, verifier: Verifier) -> None:
        self.rejected = Rejections()
        self._verifier = verifier
        self._arrived: list[Received] = []
        self._own: deque[bytes] = deque(maxlen=MOST_OWN)

    def pass_over(self, data: bytes) -> None:
        """Skip this WORLD_STATE, encoded, when the bus returns it to its sender."""
        self._own.append(data)

    def take(self, channel: str, data: bytes) -> None:
        """Decode, check and queue the bytes of a message; called by LCM."""
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

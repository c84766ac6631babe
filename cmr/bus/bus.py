"""One connection to the bus: subscribe, publish, and receive what has arrived, decoded and checked."""

import select
import time
from collections import Counter

from cmr.bus.inbox import Inbox
from cmr.bus.message import Message
from cmr.bus.messages import Received, now_utime
from cmr.bus.preflight import handled, key_of, open_lcm, resolve_url, self_test, verifier_of, warnings
from cmr.bus.signing import Signer
from cmr.bus.streams import WORLD_STATE, Stream

DRAIN_SECONDS = 0.05  # longest time spent on messages at once, so that a flood of them does not stall the process


class Bus:
    """A connection to the LCM bus at `url` (None: environment, then this host only).

    `rejected` counts refused messages by (channel, reason), `unsent` counts messages that could not be sent by the
    system's error text. `warnings` are sentences about losses to expect. A process that subscribes also receives its
    own messages; its own WORLD_STATE, which is large, is skipped. If this computer has a key, every message is signed,
    and the only unsigned message accepted is an engaged emergency stop. The socket opens with the first `subscribe`:
    the kernel copies each message to every listening socket, at the sender's cost, and LCM's thread then reads it. A
    bus that is no longer referenced is closed. Raises BusError when the bus cannot be used, KeyFileError when the key
    cannot.
    """

    def __init__(self, url: str | None = None) -> None:
        self.url = resolve_url(url)
        self.warnings = warnings(self.url)
        self.unsent: Counter[str] = Counter()
        self._signer, self._inbox = Signer(key_of(self.url)), Inbox(verifier_of(self.url))
        self.rejected = self._inbox.rejected
        self_test(open_lcm(self.url), self.url)  # another connection, as a test listens
        self._lcm = open_lcm(self.url)
        self._every: set[str] = set()
        self._listens = self._hears_worlds = False
        self._repeated: dict[str, _Repeated] = {}

    @property
    def sender(self) -> int:
        """The name of this process under its commands; it is another one after the clock was set back."""
        return self._signer.sender

    def fileno(self) -> int:
        """Return the file descriptor that becomes readable when a message has arrived, for use in `select`."""
        return int(self._lcm.fileno())

    def subscribe(self, stream: Stream[Message], robot_id: int | None = None, *, every: bool = False) -> None:
        """Subscribe to a stream, of one robot or (`robot_id` None) of all robots.

        `every` keeps every message; otherwise only the latest message of each channel is returned, which is what a
        controller needs after a delay.
        """
        pattern = stream.pattern if robot_id is None else stream.channel(robot_id)
        # A bound method would create a reference cycle through LCM, which the garbage collector cannot free.
        subscription = self._lcm.subscribe(pattern, self._inbox.take)
        # unlimited: LCM's default of 30 loses messages whenever this process is delayed
        subscription.set_queue_capacity(0)
        if every:
            self._every.add(stream.name)
        self._listens = True
        self._hears_worlds |= stream is WORLD_STATE

    def publish(self, stream: Stream[Message], message: Message, robot_id: int | None = None) -> None:
        """Send a message once. If the network is down the message is lost and counted."""
        self._send(stream.channel(robot_id), message)

    def repeat(self, stream: Stream[Message], message: Message, robot_id: int | None = None, *, period: float) -> None:
        """Have `publish_repeated` send a message every `period` seconds, until another one replaces it.

        LCM stores nothing for late joiners. `utime` is updated at each repetition. A message that replaces another
        keeps its schedule.
        """
        repeated = self._repeated.setdefault(stream.channel(robot_id), _Repeated(message, period))
        repeated.message, repeated.period = message, period

    def publish_repeated(self) -> None:
        """Send every repeated message that is due."""
        now = time.monotonic()
        for channel, repeated in self._repeated.items():
            if now >= repeated.due:
                repeated.due = now + repeated.period
                repeated.message.utime = now_utime()
                self._send(channel, repeated.message)

    def receive(self, timeout: float) -> list[Received]:
        """Wait up to `timeout` seconds for a message; return all that have arrived, oldest first."""
        if not self._listens:
            if timeout > 0.0:
                time.sleep(timeout)
            return []
        if timeout <= 0.0 or select.select([self._lcm.fileno()], [], [], timeout)[0]:
            enough = time.monotonic() + DRAIN_SECONDS
            while handled(self._lcm) and time.monotonic() < enough:
                pass
        return self.latest(self._inbox.emptied())

    def latest(self, arrived: list[Received]) -> list[Received]:
        """Return the last message of each channel, and all of those subscribed to with `every`, in order."""
        if not arrived:
            return []
        last = {received.channel: index for index, received in enumerate(arrived)}
        return [
            received
            for index, received in enumerate(arrived)
            if received.stream.name in self._every or last[received.channel] == index
        ]

    def _send(self, channel: str, message: Message) -> None:
        data = self._signer.sign(channel, message.encode())
        if channel == WORLD_STATE.name and self._hears_worlds:
            self._inbox.pass_over(data)
        try:
            self._lcm.publish(channel, data)
        except OSError as error:  # when Wi-Fi drops out, the route disappears until it reconnects
            self.unsent[error.strerror or str(error)] += 1


class _Repeated:
    """A message to send again and again."""

    def __init__(self, message: Message, period: float) -> None:
        self.message = message
        self.period = period
        self.due = 0.0

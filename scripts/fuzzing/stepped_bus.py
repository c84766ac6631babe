"""A bus without a network: in place of LCM in `cmr.bus.preflight`, with the same bytes and callbacks."""

import os
import re
import traceback
from collections import deque
from collections.abc import Callable
from typing import NamedTuple
from weakref import ReferenceType, ref

Handler = Callable[[str, bytes], object]
LOOK = 0.001  # s
HERE = ("fuzzing", "threading.py", "bus/bus.py", "bus\\bus.py", "stepped_bus.py")


class Subscription(NamedTuple):
    """A subscription: to which channels, and who takes the messages."""

    pattern: re.Pattern[str]
    handler: Handler

    def set_queue_capacity(self, _count: int) -> None:
        """As LCM has it; nothing is lost here."""


class Network:
    """All buses. `subscribed` has, by URL and pattern, where in the code it was subscribed to."""

    def __init__(self, sleep: Callable[[float], None]) -> None:
        self.sleep = sleep
        self._buses: dict[str, list[ReferenceType[SteppedLcm]]] = {}  # some are opened and given up again and again
        self.subscribed: dict[tuple[str, str], tuple[str, int]] = {}
        self.published: deque[tuple[str, bytes]] = deque(maxlen=10_000)
        self.ready, write = os.pipe()  # always has something to be read
        os.write(write, b"x")
        self._write = write

    def LCM(self, url: str) -> "SteppedLcm":  # noqa: N802 - the name is LCM's
        """Return a connection to the bus at a URL."""
        bus = SteppedLcm(self, url)
        others = self._buses.get(url, [])
        self._buses[url] = [*(one for one in others if one() is not None), ref(bus)]
        return bus

    def bring(self, url: str, channel: str, data: bytes) -> None:
        """Have a message arrive at all that are on a bus."""
        for one in self._buses.get(url, ()):
            bus = one()
            if bus is not None:
                bus.arrive(channel, data)

    def close(self) -> None:
        """Give up what the system gave."""
        os.close(self.ready)
        os.close(self._write)


class SteppedLcm:
    """A connection to a bus, as lcm.LCM is one."""

    def __init__(self, network: Network, url: str) -> None:
        self._network, self._url = network, url
        self._subscriptions: list[Subscription] = []
        self._arrived: deque[tuple[str, bytes]] = deque()

    def subscribe(self, pattern: str, handler: Handler) -> Subscription:
        """Receive what comes on these channels."""
        subscription = Subscription(re.compile(pattern), handler)
        self._subscriptions.append(subscription)
        caller = next(f for f in reversed(traceback.extract_stack()) if not any(part in f.filename for part in HERE))
        self._network.subscribed.setdefault((self._url, pattern), (caller.filename, caller.lineno or 0))
        return subscription

    def unsubscribe(self, subscription: Subscription) -> None:
        """Receive nothing more by a subscription."""
        self._subscriptions.remove(subscription)

    def publish(self, channel: str, data: bytes) -> None:
        """Send a message, also to oneself."""
        self._network.published.append((channel, data))
        self._network.bring(self._url, channel, data)

    def fileno(self) -> int:
        """Return a file that can always be read."""
        return self._network.ready

    def arrive(self, channel: str, data: bytes) -> None:
        """Have a message arrive; those that nobody subscribed to are thrown away."""
        if any(subscription.pattern.fullmatch(channel) for subscription in self._subscriptions):
            self._arrived.append((channel, data))

    def handle_timeout(self, milliseconds: int) -> int:
        """Hand on a message; return how many there were."""
        if not self._arrived:  # to look takes time, or who looks until it is late would look for ever
            self._network.sleep(max(milliseconds / 1000.0, LOOK))
            return 0
        channel, data = self._arrived.popleft()
        for subscription in list(self._subscriptions):
            if subscription.pattern.fullmatch(channel):
                subscription.handler(channel, data)
        return 1

    def handle(self) -> None:
        """Wait for a message and hand it on."""
        self.handle_timeout(10)

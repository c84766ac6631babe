"""An in-memory bus that replaces LCM in `cmr.bus.preflight`, with the same bytes and callbacks."""

import os
import re
import traceback
from collections import deque
from collections.abc import Callable
from typing import NamedTuple
from weakref import ReferenceType, ref

Handler = Callable[[str, bytes], object]
POLL_PERIOD = 0.001  # s
BUS_FILES = ("fuzzing", "threading.py", "bus/bus.py", "bus\\bus.py", "stepped_bus.py")


class Subscription(NamedTuple):
    """A subscription: the pattern of channels, and the handler of their messages."""

    pattern: re.Pattern[str]
    handler: Handler

    def set_queue_capacity(self, _count: int) -> None:
        """Do nothing: this queue is unbounded (LCM's interface)."""


class Network:
    """All buses. `subscribed` maps URL and pattern to the place in the code that subscribed."""

    def __init__(self, sleep: Callable[[float], None]) -> None:
        self.sleep = sleep
        self._buses: dict[str, list[ReferenceType[SteppedLcm]]] = {}  # weak: processes may open and drop many
        self.subscribed: dict[tuple[str, str], tuple[str, int]] = {}
        self.published: deque[tuple[str, bytes]] = deque(maxlen=10_000)
        self.ready, write = os.pipe()  # always readable
        os.write(write, b"x")
        self._write = write

    def LCM(self, url: str) -> "SteppedLcm":  # noqa: N802 - the name is LCM's
        """Return a connection to the bus at a URL."""
        bus = SteppedLcm(self, url)
        others = self._buses.get(url, [])
        self._buses[url] = [*(each for each in others if each() is not None), ref(bus)]
        return bus

    def deliver(self, url: str, channel: str, data: bytes) -> None:
        """Deliver a message to every connection to a bus."""
        for connection in self._buses.get(url, ()):
            bus = connection()
            if bus is not None:
                bus.arrive(channel, data)

    def close(self) -> None:
        """Close the pipe."""
        os.close(self.ready)
        os.close(self._write)


class SteppedLcm:
    """A connection to a bus, with the interface of lcm.LCM."""

    def __init__(self, network: Network, url: str) -> None:
        self._network, self._url = network, url
        self._subscriptions: list[Subscription] = []
        self._arrived: deque[tuple[str, bytes]] = deque()

    def subscribe(self, pattern: str, handler: Handler) -> Subscription:
        """Subscribe to all channels that match the pattern."""
        subscription = Subscription(re.compile(pattern), handler)
        self._subscriptions.append(subscription)
        caller = next(
            f for f in reversed(traceback.extract_stack()) if not any(part in f.filename for part in BUS_FILES)
        )
        self._network.subscribed.setdefault((self._url, pattern), (caller.filename, caller.lineno or 0))
        return subscription

    def unsubscribe(self, subscription: Subscription) -> None:
        """Cancel a subscription."""
        self._subscriptions.remove(subscription)

    def publish(self, channel: str, data: bytes) -> None:
        """Send a message to all connections, including this one."""
        self._network.published.append((channel, data))
        self._network.deliver(self._url, channel, data)

    def fileno(self) -> int:
        """Return a file descriptor that is always readable."""
        return self._network.ready

    def arrive(self, channel: str, data: bytes) -> None:
        """Queue a message, if a subscription matches its channel."""
        if any(subscription.pattern.fullmatch(channel) for subscription in self._subscriptions):
            self._arrived.append((channel, data))

    def handle_timeout(self, milliseconds: int) -> int:
        """Handle one message, if there is one; return the number handled."""
        if not self._arrived:  # time must pass, or a caller that polls until a deadline would poll for ever
            self._network.sleep(max(milliseconds / 1000.0, POLL_PERIOD))
            return 0
        channel, data = self._arrived.popleft()
        for subscription in list(self._subscriptions):
            if subscription.pattern.fullmatch(channel):
                subscription.handler(channel, data)
        return 1

    def handle(self) -> None:
        """Wait up to 10 ms for a message, and handle it."""
        self.handle_timeout(10)

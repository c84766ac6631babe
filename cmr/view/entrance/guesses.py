"""Rate limit on guesses of the token."""

import ipaddress
import threading
import time
from collections import OrderedDict

from cmr.view.entrance.refusals import Refusals

FREE = 5  # wrong tokens from an address before it has to wait
LONGEST_WAIT = 60.0  # s; it doubles from 1 s
FORGOTTEN = 3600.0  # s after which wrong tokens of an address are forgotten
MOST_ADDRESSES = 1000  # that are remembered


class Guesses:
    """Counts wrong tokens by address, so that additional connections do not allow more guesses.

    An IPv6 address counts as its /64 network, which belongs to one customer.
    """

    def __init__(self, refusals: Refusals | None = None) -> None:
        self._refusals = refusals or Refusals()
        self._lock = threading.Lock()
        self._wrong = OrderedDict[str, tuple[int, float]]()  # number, and time of the last [s]

    def wait(self, address: str) -> float:
        """Return the waiting time of this address [s]."""
        with self._lock:
            count, last = self._wrong.get(_network(address), (0, 0.0))
        pause = min(2.0 ** min(count - FREE, 30), LONGEST_WAIT) if count >= FREE else 0.0
        return max(last + pause - time.monotonic(), 0.0)

    def count(self, address: str, right: bool) -> None:
        """Count a comparison."""
        network, now = _network(address), time.monotonic()
        with self._lock:
            count, last = self._wrong.pop(network, (0, now))
            if right:
                return
            self._refusals.count("wrong tokens", address)
            self._wrong[network] = (1 if now - last > FORGOTTEN else count + 1), now
            while len(self._wrong) > MOST_ADDRESSES:
                self._wrong.popitem(last=False)


def _network(address: str) -> str:
    try:
        parsed = ipaddress.ip_address(address.split("%", 1)[0])
    except ValueError:
        return address
    if isinstance(parsed, ipaddress.IPv6Address) and parsed.ipv4_mapped is None:
        return str(ipaddress.ip_network((parsed, 64), strict=False))
    return str(parsed)

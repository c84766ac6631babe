"""Count refused requests, and report them occasionally."""

import threading
import time
from collections import Counter

EVERY = 10.0  # s between reports
MOST_ADDRESSES = 5  # that a sentence names


class Refusals:
    """Counts by kind and address; the server's threads count, the process reports."""

    def __init__(self) -> None:
        self.total = 0
        self.latest = ""  # the last sentence
        self._lock = threading.Lock()
        self._new = Counter[str]()
        self._addresses = Counter[str]()
        self._due = 0.0

    def count(self, kind: str, address: str) -> None:
        """Count a refusal."""
        with self._lock:
            self.total += 1
            self._new[kind] += 1
            if address in self._addresses or len(self._addresses) <= MOST_ADDRESSES:
                self._addresses[address] += 1

    def news(self) -> str:
        """Return a sentence about refusals since the last one; empty if none, or not yet due."""
        now = time.monotonic()
        with self._lock:
            if not self._new or now < self._due:
                return ""
            self._due = now + EVERY
            kinds = ", ".join(f"{count} {kind}" for kind, count in self._new.items())
            named = [address or "who has left" for address, _ in self._addresses.most_common(MOST_ADDRESSES)]
            more = " and others" if len(self._addresses) > MOST_ADDRESSES else ""
            self._new.clear()
            self._addresses.clear()
        self.latest = f"Refused: {kinds}; from {', '.join(named)}{more}."
        return self.latest

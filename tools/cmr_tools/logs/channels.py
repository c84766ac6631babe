"""Counts of messages that are left out when a log is converted to other formats, by channel and reason."""

from collections import Counter

from cmr.bus.wire import MOST_CHANNELS

FOREIGN_CHANNEL = "unknown_channel"
SHOWN = 5  # names of other channels
OTHERS = "(other channels)"


class LeftOut:
    """Counts by channel and reason the messages that are left out."""

    def __init__(self) -> None:
        self._counts: Counter[tuple[str, str]] = Counter()

    def add(self, channel: str, reason: str) -> None:
        """Count a message."""
        key = (channel, reason)
        if key not in self._counts and len(self._counts) >= MOST_CHANNELS:
            key = (OTHERS, reason)
        self._counts[key] += 1

    def sentences(self) -> list[str]:
        """Return the counts in sentences: CMR's messages first, then other channels."""
        foreign = sorted(channel for channel, reason in self._counts if reason == FOREIGN_CHANNEL)
        lines = [
            f"{channel}: {count} x {reason}, left out."
            for (channel, reason), count in sorted(self._counts.items())
            if reason != FOREIGN_CHANNEL
        ]
        if foreign:
            count = sum(self._counts[channel, FOREIGN_CHANNEL] for channel in foreign)
            shown = ", ".join(foreign[:SHOWN]) + (f" and {len(foreign) - SHOWN} more" if len(foreign) > SHOWN else "")
            lines.append(f"{count} x a channel that is none of CMR's, left out: {shown}.")
        return lines

"""Count rejected messages by channel and reason, with a limit, since senders may use any number of channels."""

from collections import Counter

from cmr.plain_text import plain

MOST_NAMED = 16  # pairs of channel and reason that are counted individually
OTHERS = "other channels"
LONGEST_CHANNEL = 63  # characters, as LCM allows


class Rejections(Counter[tuple[str, str]]):
    """Counts by (channel, reason); beyond a limit, further channels are counted together as OTHERS."""

    def note(self, channel: str, reason: str, count: int = 1) -> None:
        """Count rejected messages."""
        key = plain(channel, LONGEST_CHANNEL), reason
        if key not in self and len(self) >= MOST_NAMED:
            key = OTHERS, reason
        self[key] += count

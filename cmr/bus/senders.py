"""What each of many senders said last; senders say themselves who they are, so that strangers may be any number."""

from typing import TypeVar

MOST_SENDERS = 1_000
Key = TypeVar("Key")
Said = TypeVar("Said")


def keep(senders: dict[Key, Said], sender: Key, said: Said) -> None:
    """Note what a sender said; where there are too many, the one that was heard of first is let go."""
    if sender not in senders and len(senders) >= MOST_SENDERS:
        del senders[next(iter(senders))]
    senders[sender] = said

"""Keep the last message of each sender, with a limit: senders name themselves, so there may be any number."""

from typing import TypeVar

MOST_SENDERS = 1_000
Key = TypeVar("Key")
Said = TypeVar("Said")


def keep(senders: dict[Key, Said], sender: Key, said: Said) -> None:
    """Store the latest item of a sender; beyond the limit, drop the sender that was first heard longest ago."""
    if sender not in senders and len(senders) >= MOST_SENDERS:
        del senders[next(iter(senders))]
    senders[sender] = said

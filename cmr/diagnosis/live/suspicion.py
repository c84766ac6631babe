"""What is suspected of a robot, and when it is said."""

from collections.abc import Mapping
from dataclasses import dataclass

GROWN = 1.5  # times; what has grown by as much is said again
SAID_AGAIN = 60_000_000  # us; nothing is said more often


@dataclass(frozen=True)
class Suspicion:
    """What is suspected. `title` names it for when it is over; empty for an event, which is not said to be over.

    `size` says how far it has come, if it can grow.
    """

    title: str
    sentence: str
    size: float = 0.0


class Announcer:
    """Says what is suspected once, again when it has grown, and when it is over; each at most once a minute.

    `present` are the sentences on what is suspected, by key: as they were said last, not with the newest numbers, so
    that what has been said does not look like news.
    """

    def __init__(self) -> None:
        self.present: dict[str, str] = {}
        self._said: dict[str, tuple[int, float]] = {}  # when, and of what size, by key
        self._open: dict[str, str] = {}  # titles of what was said and is not over, by key

    def news(self, utime: int, suspicions: Mapping[str, Suspicion]) -> list[str]:
        """Return what is to be said at utime."""
        news = []
        for key, suspicion in suspicions.items():
            when, size = self._said.get(key, (utime - SAID_AGAIN, 0.0))
            if (key not in self._open or suspicion.size > GROWN * size) and utime - when >= SAID_AGAIN:
                news.append(suspicion.sentence)
                self._said[key] = (utime, suspicion.size)
                self._open[key] = suspicion.title
                self.present[key] = suspicion.sentence
        over = [title for key in self._open if key not in suspicions and (title := self._open[key])]
        self._open = {key: title for key, title in self._open.items() if key in suspicions}
        self.present = {key: self.present.get(key, suspicion.sentence) for key, suspicion in suspicions.items()}
        # What has got another explanation is not over.
        if news or not over:
            return news
        return [f"No longer: {', '.join(over)}." + ("" if suspicions else " Everything is as at the start again.")]

"""Suspicions about a robot, and when to report them."""

from collections.abc import Mapping
from dataclasses import dataclass

GROWN = 1.5  # factor of growth after which a suspicion is reported again
SAID_AGAIN = 60_000_000  # us; shortest time between reports of a suspicion


@dataclass(frozen=True)
class Suspicion:
    """A suspicion. `title` names it in the report that it is over; empty for events, which do not end.

    `size` measures it, if it can grow.
    """

    title: str
    sentence: str
    size: float = 0.0


class Announcer:
    """Reports suspicions once, again when they have grown, and when they are over; each at most once a minute.

    `present` are the sentences on current suspicions, by key, as last reported rather than with current numbers, so
    that repeated text does not look new.
    """

    def __init__(self) -> None:
        self.present: dict[str, str] = {}
        self._said: dict[str, tuple[int, float]] = {}  # time and size of the last report, by key
        self._open: dict[str, str] = {}  # titles of reported suspicions that are not over, by key

    def news(self, utime: int, suspicions: Mapping[str, Suspicion]) -> list[str]:
        """Return the sentences to report at utime."""
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
        # A suspicion replaced by another explanation is not over.
        if news or not over:
            return news
        return [f"No longer: {', '.join(over)}." + ("" if suspicions else " Everything is as at the start again.")]

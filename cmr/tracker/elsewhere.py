"""Detect other programs that publish poses of the same robots: of two trackers, the later one yields."""

from collections.abc import Callable, Iterable

FIRST_LOOK = 1.0  # s; long enough to receive others that send 5 poses a second
NAMED = 8  # robots in a sentence
GONE = 2.0  # s without a pose after which the other program is gone


class Elsewhere:
    """Watches for poses of these robots from other programs: `heard` returns the robots with such poses since the last
    call.

    `others` are the robots that other programs publish poses of; `yielded` those of them that did so at the beginning.
    """

    def __init__(self, heard: Callable[[], Iterable[int]], robots: Iterable[int]) -> None:
        self.others: frozenset[int] = frozenset()
        self.yielded: frozenset[int] = frozenset()
        self.is_decided = False  # whether the initial check is over; before, nothing is published
        self._heard, self._robots = heard, frozenset(robots)
        self._latest: dict[int, float] = {}
        self._begin: float | None = None

    def look(self, now: float) -> None:
        """Check for such poses; called some times a second, with the monotonic time [s]."""
        self._begin = now if self._begin is None else self._begin
        self._latest |= {robot_id: now for robot_id in self._heard() if robot_id in self._robots}
        self.others = frozenset(robot_id for robot_id, when in self._latest.items() if now - when < GONE)
        if self.is_decided:
            self.yielded &= self.others
        elif now - self._begin >= FIRST_LOOK:
            self.is_decided, self.yielded = True, self.others

    def problem(self) -> str:
        """Return a sentence that names the robots with poses from another program; empty if there are none."""
        if not self.others:
            return ""
        yields = ""
        if self.yielded:
            which = "these" if self.yielded == self.others else f"those of {_named(self.yielded)}"
            yields = f"; {which} are not published here"
        return f"Another program publishes poses of robot {_named(self.others)}: only one may{yields}."


def _named(robots: frozenset[int]) -> str:
    return ", ".join(map(str, sorted(robots)[:NAMED]))

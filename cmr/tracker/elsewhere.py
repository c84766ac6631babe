"""Whether another program publishes poses of the same robots: of two trackers at once, the one that came later yields.

Who listens to all poses all the time decodes its own, too, which takes as long as making them. So at first, while none
are published here, the bus is listened to for a while; later for a moment now and then, to the poses of one robot after
another, on a connection of its own.
"""

from collections.abc import Callable, Iterable

from cmr.bus.bus import Bus
from cmr.bus.streams import POSE

PERIOD, LOOK = 1.0, 0.4  # s between two looks, and of a look
FIRST_LOOK = 1.0  # s; others that send 5 poses a second are surely heard


class Elsewhere:
    """Looks for poses of these robots that are not `sent` here.

    `others` are the robots that other programs publish poses of; `yielded` those of them that did so at the beginning.
    """

    def __init__(self, open_bus: Callable[[], Bus], robots: Iterable[int]) -> None:
        self.others: frozenset[int] = frozenset()
        self.yielded: frozenset[int] = frozenset()
        self.is_decided = False  # whether the first look is over; before, nothing is published
        self._open_bus, self._robots = open_bus, sorted(robots)
        self._bus: Bus | None = None
        self._sent: set[tuple[int, int]] = set()
        self._looked_at: list[int] = []
        self._found: set[int] = set()
        self._due = self._end = 0.0

    def note(self, robot_id: int, utime: int) -> None:
        """Note that a pose was published here."""
        if self._bus is not None:
            self._sent.add((robot_id, utime))

    def look(self, now: float) -> None:
        """Begin or go on to listen, if it is time: called some times a second, with the monotonic time [s]."""
        if self._bus is None and now >= self._due:
            self._bus = self._open_bus()
            self._looked_at = self._robots[:1] if self.is_decided else self._robots
            if self.is_decided:
                self._robots = [*self._robots[1:], *self._robots[:1]]
            for robot_id in self._looked_at:
                self._bus.subscribe(POSE, robot_id, every=True)
            self._sent.clear()
            self._found.clear()
            self._end = now + (LOOK if self.is_decided else FIRST_LOOK)
        if self._bus is None:
            return
        for received in self._bus.receive(0.0):
            pose = received.message_of(POSE)
            if pose is not None and (pose.robot_id, pose.utime) not in self._sent:
                self._found.add(int(pose.robot_id))
        if now >= self._end:
            self._decide(now)

    def problem(self) -> str:
        """Return, as a sentence, which robots have poses from elsewhere; empty if none has."""
        if not self.others:
            return ""
        named = ", ".join(map(str, sorted(self.others)[:8]))
        yields = "; these are not published here" if self.yielded else ""
        return f"Another program publishes poses of robot {named}: only one may{yields}."

    def _decide(self, now: float) -> None:
        self.others = (self.others - {*self._looked_at}) | self._found
        self.yielded = self.others & self.yielded if self.is_decided else self.others
        self.is_decided = True
        self._bus, self._due = None, now + PERIOD

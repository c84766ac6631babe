"""What the page can order on the bus: the emergency stop, its release, and a figure-eight."""

from cmr.bus.estop import EmergencyStop
from cmr.bus.message import Message
from cmr.bus.messages import make
from cmr.bus.process import Outgoing
from cmr.bus.streams import ESTOP, WAYPOINTS
from cmr.msg import estop_latch_t, estop_t, waypoints_t

SOURCE = "cmr-view"
RELEASES = 6  # messages, as one can be lost
FIGURE_EIGHT = 0.7  # m from its crossing to each tip


class Orders:
    """Turns orders into messages. `handle` hears ESTOP and ESTOP_LATCH, `due` returns what is to be sent at each turn.

    A stop is repeated until anybody releases it. `stopped` says whether the emergency stop is engaged, and `reason`
    by whom and why. Drivers hold robots by it until they take its release, as `latched_reason` says.
    """

    def __init__(self) -> None:
        self.stopped = False
        self.reason = ""
        self._drivers = EmergencyStop()
        self._engaged_at: int | None = None  # us; None while no stop of ours is in force
        self._releases = 0  # that are still to be sent
        self._released_at = 0  # us; when the first of them was sent
        self._outgoing: list[Outgoing] = []

    def handle(self, utime: int, channel: str, message: Message) -> None:
        """Take a message from the bus, our own among them."""
        if isinstance(message, estop_latch_t):
            self._drivers.handle(utime, channel, message)
        if channel != ESTOP.name or not isinstance(message, estop_t):
            return
        if message.engaged:
            # Our own repetitions come back even after we have released; they engage nothing again.
            if message.source != SOURCE or self._engaged_at is not None:
                self.stopped, self.reason = True, f"{message.source}: {message.reason}"
            return
        if self._engaged_at is None or message.utime >= self._engaged_at:
            self.stopped, self.reason, self._engaged_at = False, "", None

    @property
    def latched_reason(self) -> str:
        """By whom, why and since when drivers hold which robots; empty if none does."""
        return self._drivers.latched_reason

    def must_stand(self, robot_id: int) -> bool:
        """Return whether the emergency stop is engaged, or a robot's driver holds it still."""
        return self.stopped or self._drivers.holds(robot_id)

    def stop(self, utime: int) -> None:
        """Engage the emergency stop."""
        self._engaged_at, self._releases = utime, 0
        self.stopped, self.reason = True, f"{SOURCE}: the button on the page"

    def release(self) -> None:
        """Release the emergency stop, whoever engaged it.

        Each repetition has the moment of the first, so that a stop that is engaged after it stays engaged.
        """
        self._engaged_at, self._releases = None, RELEASES
        self.stopped, self.reason = False, ""

    def figure_eight(self, utime: int, robot_id: int, place: tuple[float, float, float]) -> None:
        """Tell a robot to drive a figure-eight from where it is: x, y [m], theta [rad]."""
        from cmr.geometry.figures import figure_eight

        x, y = figure_eight(*place, FIGURE_EIGHT)
        self._outgoing.append((WAYPOINTS, robot_id, make(waypoints_t, utime=utime, robot_id=robot_id, x=x, y=y)))

    def due(self, utime: int) -> list[Outgoing]:
        """Return what is to be sent now."""
        outgoing, self._outgoing = self._outgoing, []
        if self._engaged_at is not None:
            outgoing.append(_estop(utime, True))
        elif self._releases:
            self._released_at = utime if self._releases == RELEASES else self._released_at
            self._releases -= 1
            outgoing.append(_estop(self._released_at, False))
        return outgoing


def _estop(utime: int, engaged: bool) -> Outgoing:
    reason = "the button on the page" if engaged else "released on the page"
    return ESTOP, None, make(estop_t, utime=utime, engaged=engaged, source=SOURCE, reason=reason)

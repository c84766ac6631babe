"""What the page can order on the bus: the emergency stop, its release, and a figure-eight."""

from cmr.bus.estop import EmergencyStop, StopButton
from cmr.bus.message import Message
from cmr.bus.messages import make
from cmr.bus.process import Outgoing
from cmr.bus.streams import ESTOP, WAYPOINTS
from cmr.msg import estop_latch_t, waypoints_t

SOURCE = "cmr-view"
FIGURE_EIGHT = 0.7  # m from its crossing to each tip


class Orders:
    """Turns orders into messages. `handle` hears ESTOP and ESTOP_LATCH, `due` returns what is to be sent at each turn.

    A stop is repeated until anybody releases it. `stopped` says whether the emergency stop is engaged, and `reason`
    by whom and why. Drivers hold robots by it until they take its release, as `latched_reason` says.
    """

    def __init__(self) -> None:
        self._button = StopButton(SOURCE, "the button on the page", "released on the page")
        self._drivers = EmergencyStop()
        self._outgoing: list[Outgoing] = []

    @property
    def stopped(self) -> bool:
        """Whether the emergency stop is asked for."""
        return self._button.stopped

    @property
    def reason(self) -> str:
        """By whom it is asked for, and why."""
        return self._button.text

    def handle(self, utime: int, channel: str, message: Message) -> None:
        """Take a message from the bus, our own among them."""
        if isinstance(message, estop_latch_t):
            self._drivers.handle(utime, channel, message)
        self._button.handle(utime, channel, message)

    @property
    def latched_reason(self) -> str:
        """By whom, why and since when drivers hold which robots; empty if none does."""
        return self._drivers.latched_reason

    def must_stand(self, robot_id: int) -> bool:
        """Return whether the emergency stop is engaged, or a robot's driver holds it still."""
        return self.stopped or self._drivers.holds(robot_id)

    def stop(self, utime: int) -> None:
        """Engage the emergency stop."""
        self._button.stop(utime)

    def release(self) -> None:
        """Release the emergency stop, whoever engaged it."""
        self._button.release()

    def figure_eight(self, utime: int, robot_id: int, place: tuple[float, float, float]) -> None:
        """Tell a robot to drive a figure-eight from where it is: x, y [m], theta [rad]."""
        from cmr.geometry.figures import figure_eight

        x, y = figure_eight(*place, FIGURE_EIGHT)
        self._outgoing.append((WAYPOINTS, robot_id, make(waypoints_t, utime=utime, robot_id=robot_id, x=x, y=y)))

    def due(self, utime: int) -> list[Outgoing]:
        """Return what is to be sent now."""
        outgoing, self._outgoing = self._outgoing, []
        estop = self._button.due(utime)
        return outgoing if estop is None else [*outgoing, (ESTOP, None, estop)]

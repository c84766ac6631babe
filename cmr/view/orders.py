"""Orders from the page on the bus: emergency stop, its release, and a figure-eight."""

from cmr.bus.estop import EmergencyStop, StopButton
from cmr.bus.message import Message
from cmr.bus.messages import make
from cmr.bus.process import Outgoing
from cmr.bus.streams import ESTOP, WAYPOINTS
from cmr.msg import estop_latch_t, waypoints_t

SOURCE = "cmr-view"
FIGURE_EIGHT = 0.7  # m from its crossing to each tip


class Orders:
    """Turns orders into messages. `handle` receives ESTOP and ESTOP_LATCH, `due` returns the messages to send at each
    turn.

    A stop is repeated until anybody releases it. `stopped` is whether the emergency stop is engaged, and `reason` by
    whom and why. Drivers hold robots until they accept its release; see `latched_reason`.
    """

    def __init__(self) -> None:
        self._button = StopButton(SOURCE, "the button on the page", "released on the page")
        self._drivers = EmergencyStop()
        self._outgoing: list[Outgoing] = []

    @property
    def stopped(self) -> bool:
        """Whether an emergency stop is requested."""
        return self._button.stopped

    @property
    def reason(self) -> str:
        """Who requested it, and why."""
        return self._button.text

    def handle(self, utime: int, channel: str, message: Message) -> None:
        """Handle a message from the bus, including our own."""
        if isinstance(message, estop_latch_t):
            self._drivers.handle(utime, channel, message)
        self._button.handle(utime, channel, message)

    @property
    def latched_reason(self) -> str:
        """Who stopped which robots, why and since when; empty if no driver holds one."""
        return self._drivers.latched_reason

    def must_stand(self, robot_id: int) -> bool:
        """Return whether the emergency stop is engaged, or still held by a robot's driver."""
        return self.stopped or self._drivers.holds(robot_id)

    def stop(self, utime: int) -> None:
        """Engage the emergency stop."""
        self._button.stop(utime)

    def release(self) -> None:
        """Release the emergency stop, whoever engaged it."""
        self._button.release()

    def figure_eight(self, utime: int, robot_id: int, place: tuple[float, float, float]) -> None:
        """Order a robot to drive a figure-eight from its current pose: x, y [m], theta [rad]."""
        from cmr.geometry.figures import figure_eight

        x, y = figure_eight(*place, FIGURE_EIGHT)
        self._outgoing.append((WAYPOINTS, robot_id, make(waypoints_t, utime=utime, robot_id=robot_id, x=x, y=y)))

    def due(self, utime: int) -> list[Outgoing]:
        """Return the messages to send now."""
        outgoing, self._outgoing = self._outgoing, []
        estop = self._button.due(utime)
        return outgoing if estop is None else [*outgoing, (ESTOP, None, estop)]

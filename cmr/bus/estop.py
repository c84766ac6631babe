"""The emergency stop as every process obeys it: latched until it is released."""

from cmr.bus.message import Message
from cmr.bus.streams import ESTOP
from cmr.msg import estop_t


class EmergencyStop:
    """Whether the emergency stop is engaged, and by whom and why."""

    def __init__(self) -> None:
        self.engaged = False
        self.reason = ""

    def handle(self, _utime: int, channel: str, message: Message) -> None:
        """Take an estop_t; other messages are passed over."""
        if channel == ESTOP.name and isinstance(message, estop_t):
            self.engaged = bool(message.engaged)
            self.reason = f"{message.source}: {message.reason}" if self.engaged else ""

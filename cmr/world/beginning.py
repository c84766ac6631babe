"""Synchronised start: robots of a run begin together, when the leading program reports that all are ready."""

from cmr.bus.message import Message
from cmr.msg import process_status_t

BEGUN = (process_status_t.RUNNING, process_status_t.DEGRADED)


class Beginning:
    """Whether robots may begin: once PROCESS_STATUS says that `leader`, such as cmr-run, is ready; at once without a
    leader.

    A process restarted during the run learns it within a second, since every process reports once a second.
    """

    def __init__(self, leader: str) -> None:
        self.begun = not leader
        self._leader = leader

    def handle(self, _utime: int, _channel: str, message: Message) -> None:
        """Handle a process_status_t; ignore other messages."""
        if isinstance(message, process_status_t) and message.process == self._leader and message.state in BEGUN:
            self.begun = True

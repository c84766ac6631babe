"""When robots of a run begin: together, once the program that leads the run says that all are ready."""

from cmr.bus.message import Message
from cmr.msg import process_status_t

BEGUN = (process_status_t.RUNNING, process_status_t.DEGRADED)


class Beginning:
    """Whether robots may begin: from when `leader`, such as cmr-run, is ready by PROCESS_STATUS; at once without one.

    A process that is started again during the run hears it within a second, as every process reports that often.
    """

    def __init__(self, leader: str) -> None:
        self.begun = not leader
        self._leader = leader

    def handle(self, _utime: int, _channel: str, message: Message) -> None:
        """Take a process_status_t; other messages are passed over."""
        if isinstance(message, process_status_t) and message.process == self._leader and message.state in BEGUN:
            self.begun = True

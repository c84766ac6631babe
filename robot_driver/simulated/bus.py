"""The bus of a simulated computer: what is published is in the log, and with those who listen."""

from pathlib import Path
from types import TracebackType

import lcm

from cmr.bus.message import Message
from cmr.bus.streams import Stream
from robot_driver.simulated.host import SimulatedHost

Inbox = list[tuple[str, Message]]  # channel, message


class SimulatedBus:
    """Passes messages on at once and writes them to an LCM event log at `path`; a context manager."""

    def __init__(self, path: Path, host: SimulatedHost) -> None:
        self._host = host
        self._path = path
        self._inboxes: dict[str, list[Inbox]] = {}
        self._channels: dict[tuple[str, int], str] = {}  # by name of the stream and robot

    def __enter__(self) -> "SimulatedBus":
        self._log = lcm.EventLog(str(self._path), "w", overwrite=True)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._log.close()

    def subscribe(self, *channels: str) -> Inbox:
        """Return a list to which messages on these channels are appended."""
        inbox: Inbox = []
        for channel in channels:
            self._inboxes.setdefault(channel, []).append(inbox)
        return inbox

    def publish(self, stream: Stream[Message], message: Message, robot_id: int) -> None:
        """Send a message to all subscribers and to the log."""
        channel = self._channels.get((stream.name, robot_id))
        if channel is None:
            channel = stream.channel(robot_id if stream.per_robot else None)
            self._channels[stream.name, robot_id] = channel
        self._log.write_event(self._host.utime(), channel, message.encode())
        for inbox in self._inboxes.get(channel, ()):
            inbox.append((channel, message))


def taken(inbox: Inbox) -> Inbox:
    """Return what is in an inbox, and empty it."""
    messages = inbox[:]
    inbox.clear()
    return messages

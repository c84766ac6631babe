"""Read an event log into arrays: all messages of a channel are decoded at once."""

from array import array
from collections import defaultdict
from collections.abc import Callable
from pathlib import Path

import numpy as np

from cmr.bus.messages import RejectedMessage, decode
from cmr.bus.older import as_of_today
from cmr.bus.rejections import Rejections
from cmr.bus.streams import PARAMETERS, SELF_TESTS, identify
from cmr.bus.wire import layout_of
from cmr.recordings.arrivals import KEPT, Announcements, Arrivals, Kept, RobotMessages
from cmr.recordings.events import EventReader


class SignalGatherer:
    """Collects the messages of a channel that becomes a signal, and decodes them at the end."""

    def __init__(self, channel: str, kept: Kept, robot_id: int, rejected: Rejections) -> None:
        self._channel, self._kept, self._robot_id = channel, kept, robot_id
        self._rejected = rejected
        self._layout = layout_of(kept.stream.message_type)
        self._fingerprint = kept.stream.message_type._get_packed_fingerprint()
        self._numbers = array("q")
        self._data = bytearray()

    def take(self, number: int, data: bytes) -> None:
        """Add one encoded message; as in the generated decoder, extra bytes are ignored."""
        size, data = self._layout.itemsize, as_of_today(data)
        if not data.startswith(self._fingerprint):
            self._rejected.note(self._channel, "foreign")
        elif len(data) < size:
            self._rejected.note(self._channel, "corrupt")
        else:
            self._numbers.append(number)
            self._data += data if len(data) == size else data[:size]

    def arrivals(self) -> Arrivals:
        """Decode the collected messages, and free their bytes."""
        messages = np.frombuffer(self._data, self._layout)
        own = messages["robot_id"] == self._robot_id
        if not own.all():
            self._rejected.note(self._channel, "wrong_robot", int(np.count_nonzero(~own)))
            messages = messages[own]
        number = np.array(self._numbers, np.int64)[own]
        columns = {name: messages[name].astype(np.float64) for name in self._kept.columns}
        arrivals = Arrivals(messages["utime"].astype(np.int64), number, columns)
        self._data, self._numbers = bytearray(), array("q")
        return arrivals


class AnnouncementGatherer:
    """Gathers the parameter files announced on a channel."""

    def __init__(self, channel: str, rejected: Rejections) -> None:
        self.announcements = Announcements()
        self._channel = channel
        self._rejected = rejected

    def take(self, number: int, data: bytes) -> None:
        """Decode one encoded message."""
        try:
            message = decode(self._channel, data).message_of(PARAMETERS)
        except RejectedMessage as rejected:
            self._rejected.note(self._channel, rejected.reason)
        else:
            if message is not None:
                self.announcements.take(number, self._channel, message)


class LogGatherer:
    """Collects the contents of a log, event by event; `rejected` counts rejected messages by (channel, reason)."""

    def __init__(self) -> None:
        self.rejected = Rejections()
        self._takers: dict[str, Callable[[int, bytes], None]] = {}
        self._signals: dict[int, dict[str, SignalGatherer]] = defaultdict(dict)
        self._announced: dict[int, AnnouncementGatherer] = {}

    def take(self, number: int, channel: str, data: bytes) -> None:
        """Add one event; `number` counts them."""
        taker = self._takers.get(channel)
        if taker is None:
            taker = self._takers[channel] = self._taker(channel)
        taker(number, data)

    def robots(self, damaged_bytes: int) -> dict[int, RobotMessages]:
        """Decode the collected messages, by robot id."""
        robots = {}
        for robot_id in sorted(self._signals.keys() | self._announced.keys()):
            signals, announced = self._signals[robot_id], self._announced.get(robot_id)
            robots[robot_id] = RobotMessages(
                robot_id,
                {n: signals[n].arrivals() if n in signals else Arrivals.none(kept) for n, kept in KEPT.items()},
                announced.announcements if announced else Announcements(),
                self.rejected,
                damaged_bytes,
            )
        return robots

    def _taker(self, channel: str) -> Callable[[int, bytes], None]:
        """Return the handler for messages of a channel."""
        if channel in SELF_TESTS:
            return lambda _number, _data: None
        stream, robot_id = identify(channel) or (None, None)
        if stream is None:
            return lambda _number, _data: self.rejected.note(channel, "unknown_channel")
        if robot_id is not None and stream is PARAMETERS:
            announced = self._announced[robot_id] = AnnouncementGatherer(channel, self.rejected)
            return announced.take
        name = next((name for name, kept in KEPT.items() if kept.stream is stream), None)
        if robot_id is None or name is None:
            return lambda _number, _data: None  # a recording does not keep this stream
        signal = self._signals[robot_id][name] = SignalGatherer(channel, KEPT[name], robot_id, self.rejected)
        return signal.take


def read_robots(path: Path | str) -> dict[int, RobotMessages]:
    """Read the messages of each robot from an event log, by robot id.

    A truncated or damaged log yields its intact events. `rejected` of the robots counts, by cmr.bus.messages.REASONS,
    undecodable messages on the channels of a recording, and messages on unknown channels; bus tests are ignored. Raises
    OSError when the file cannot be opened.
    """
    gatherer = LogGatherer()
    log = EventReader(path)
    for number, event in enumerate(log):
        gatherer.take(number, event.channel, event.data)
    return gatherer.robots(log.damaged_bytes)

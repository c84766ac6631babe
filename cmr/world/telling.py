"""Messages that behaviours of virtual robots publish besides commands."""

from collections.abc import Iterator, Mapping

from cmr.bus.message import Message
from cmr.bus.streams import Stream
from cmr.world.behaviours import AnyBehaviour, Behaviour


class Telling:
    """Collects messages of `behaviours`, by robot id, asking only those that override `tell`: there may be
    thousands.
    """

    def __init__(self, behaviours: Mapping[int, AnyBehaviour]) -> None:
        own = ((robot_id, one) for robot_id, one in behaviours.items() if isinstance(one, Behaviour))
        self._own = [(robot_id, one) for robot_id, one in own if type(one).tell is not Behaviour.tell]

    def messages(self, utime: int) -> Iterator[tuple[Stream[Message], int, Message]]:
        """Yield the messages to publish at `utime` [us], with stream and robot."""
        for robot_id, behaviour in self._own:
            for stream, message in behaviour.tell(utime):
                yield stream, robot_id, message

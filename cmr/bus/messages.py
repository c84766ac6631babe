"""Make, encode and decode messages. Foreign or damaged messages are rejected with a reason."""

import time
from collections.abc import Callable, Sized
from contextlib import suppress
from functools import cache
from operator import attrgetter
from typing import NamedTuple

from cmr.bus.message import M, Message
from cmr.bus.older import as_of_today
from cmr.bus.streams import Stream, identify
from cmr.msg import world_state_t

ROBOT_OF = attrgetter("robot_id")  # of the messages whose channel belongs to one robot


class RejectedMessage(Exception):  # noqa: N818 - it is a finding, not a failure of the program
    """A message was rejected; `reason` is one of `REASONS`."""

    def __init__(self, reason: str, detail: str) -> None:
        super().__init__(f"{reason}: {detail}")
        self.reason = reason


# unknown_channel: not one of our streams. foreign: another message type's fingerprint. corrupt: the right fingerprint,
# but the bytes do not decode. wrong_robot: robot_id contradicts the channel name.
REASONS = ("unknown_channel", "foreign", "corrupt", "wrong_robot")


class Received(NamedTuple):
    """One decoded message: the channel it came on, the stream that channel belongs to, and the robot (None: all).

    `sender` is the random name of the sending process, None if unknown: see cmr.bus.signing.
    """

    channel: str
    stream: Stream[Message]
    robot_id: int | None
    message: Message
    sender: int | None = None

    def message_of(self, stream: Stream[M]) -> M | None:
        """Return the message if it came on a channel of this stream; None otherwise."""
        return self.message if isinstance(self.message, stream.message_type) else None


MICROSECONDS = 1e6  # in a second; a `utime` counts them since the Unix epoch


def now_utime() -> int:
    """Return the time of day in microseconds since the Unix epoch."""
    return time.time_ns() // 1000


def make(message_type: type[M], **fields: object) -> M:
    """Make a message of `message_type` with these fields; `n` is set from the length of the arrays.

    The generated classes accept any attribute and truncate arrays silently; this function does neither. Raises
    TypeError for a field that is missing or unknown, ValueError for arrays of unequal length.
    """
    message = message_type()
    names, counted = _fields(message_type)
    if counted or fields.keys() != names:
        wrong = (fields.keys() ^ names) - set(counted.values())
        if wrong:
            raise TypeError(f"{message_type.__name__}: fields missing or unknown: {', '.join(sorted(wrong))}")
    for count_field in set(counted.values()):
        arrays = {name: fields[name] for name, field in counted.items() if field == count_field}
        lengths = {name: len(array) for name, array in arrays.items() if isinstance(array, Sized)}
        if len(lengths) < len(arrays):
            raise TypeError(f"{message_type.__name__}: no arrays: {', '.join(arrays.keys() - lengths.keys())}")
        if len(set(lengths.values())) > 1:
            raise ValueError(f"{message_type.__name__}: arrays differ in length: {lengths}")
        fields[count_field] = next(iter(lengths.values()))
    for name, value in fields.items():
        setattr(message, name, value)
    return message


@cache
def _fields(message_type: type[Message]) -> tuple[frozenset[str], dict[str, str]]:
    """Return the names of all fields, and of those that are arrays with the field that counts their entries."""
    dimensions = dict(zip(message_type.__slots__, message_type.__dimensions__, strict=True))
    return frozenset(dimensions), {name: str(length[0]) for name, length in dimensions.items() if length is not None}


def decode(channel: str, data: bytes) -> Received:
    """Decode one message from the bus or from a log.

    Raises RejectedMessage when the channel is not ours, the type is not the channel's, the bytes are damaged,
    or the robot id in the message is not the one in the channel name.
    """
    identity = identify(channel)
    if identity is None:
        raise RejectedMessage("unknown_channel", f"{channel} is not a channel of CMR")
    stream, robot_id = identity
    data = as_of_today(data)
    if data[:8] != stream.message_type._get_packed_fingerprint():
        raise RejectedMessage("foreign", f"{channel} carries a type other than {stream.message_type.__name__}")
    try:
        message = _decoder_of(stream.message_type)(data)
    except Exception as error:  # on damaged bytes the generated decoder can raise anything
        raise RejectedMessage("corrupt", f"{channel}: {error}") from error
    if robot_id is not None and ROBOT_OF(message) != robot_id:
        raise RejectedMessage("wrong_robot", f"{channel} carries a message of robot {ROBOT_OF(message)}")
    return Received(channel, stream, robot_id, message)


@cache
def _decoder_of(message_type: type[Message]) -> Callable[[bytes], Message]:
    """Return the class that decodes this message type: the generated one, or a faster one based on NumPy.

    NumPy is imported at the first WORLD_STATE: a driver receives none and runs without NumPy.
    """
    if message_type is world_state_t:
        with suppress(ModuleNotFoundError):
            from cmr.bus.world_state import WorldState

            return WorldState.decode
    return message_type.decode

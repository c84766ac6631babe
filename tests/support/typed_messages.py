"""Messages of the type that a test expects."""

from collections.abc import Iterable

from cmr.bus.message import M
from cmr.bus.messages import Received
from cmr.bus.streams import Stream


def as_a(message_type: type[M], message: object) -> M:
    """The message, which is of this type."""
    assert isinstance(message, message_type)
    return message


def all_of(stream: Stream[M], received: Iterable[Received]) -> list[M]:
    """The messages of a stream, in the order in which they came."""
    return [message for one in received if (message := one.message_of(stream)) is not None]

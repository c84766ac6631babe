"""What all message classes have in common; the build generates them, with their stubs, from lcmtypes/."""

from collections.abc import Sequence
from typing import ClassVar, Protocol, TypeVar

FINGERPRINT_BYTES = 8  # at the beginning of each message, of its type


class Message(Protocol):
    """A message of any type. `isinstance` with a class of `cmr.msg` says of which type it is."""

    __slots__: ClassVar[Sequence[str]]
    __typenames__: ClassVar[list[str]]
    __dimensions__: ClassVar[list[list[str | int] | None]]
    utime: int

    def __init__(self) -> None: ...

    def encode(self) -> bytes:
        """Return the bytes of the message."""

    @staticmethod
    def decode(data: bytes) -> "Message":
        """Return the message in these bytes."""

    @staticmethod
    def _get_packed_fingerprint() -> bytes: ...


M = TypeVar("M", bound=Message)
M_co = TypeVar("M_co", bound=Message, covariant=True)

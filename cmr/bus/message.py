"""The interface common to all message classes, which the build generates with their stubs from lcmtypes/."""

from collections.abc import Sequence
from typing import ClassVar, Protocol, TypeVar

FINGERPRINT_BYTES = 8  # at the start of each message; identifies its type


class Message(Protocol):
    """A message of any type. Use `isinstance` with a class of `cmr.msg` to tell types apart."""

    __slots__: ClassVar[Sequence[str]]
    __typenames__: ClassVar[list[str]]
    __dimensions__: ClassVar[list[list[str | int] | None]]
    utime: int

    def __init__(self) -> None: ...

    def encode(self) -> bytes:
        """Return the bytes of the message."""

    @staticmethod
    def decode(data: bytes) -> "Message":
        """Decode a message from bytes."""

    @staticmethod
    def _get_packed_fingerprint() -> bytes: ...


M = TypeVar("M", bound=Message)
M_co = TypeVar("M_co", bound=Message, covariant=True)

"""Make decisions from a fuzzer's or random bytes; the same bytes give the same decisions."""

import struct
from collections.abc import Sequence
from typing import TypeVar

One = TypeVar("One")


class Draws:
    """Draws values from the bytes of `data` in turn; when they are used up, it draws from zeros.

    The bytes alone reproduce all decisions, and similar bytes give similar decisions.
    """

    def __init__(self, data: bytes) -> None:
        self._data, self._at = data, 0

    @property
    def are_left(self) -> bool:
        """Whether unused bytes are left."""
        return self._at < len(self._data)

    def take(self, count: int) -> bytes:
        """Return the next `count` bytes, padded with zeros."""
        drawn = self._data[self._at : self._at + count]
        self._at += count
        return drawn.ljust(count, b"\0")

    def below(self, count: int) -> int:
        """Return an integer from 0 to count - 1; count is at most 65,536."""
        return int.from_bytes(self.take(1 if count <= 256 else 2), "big") % count

    def choice(self, choices: Sequence[One]) -> One:
        """Return one of the choices."""
        return choices[self.below(len(choices))]

    def one_in(self, count: int) -> bool:
        """Return True with probability 1 / count; False if no bytes are left."""
        return self.below(count) == count - 1

    def fraction(self) -> float:
        """Return a number from 0 to 1."""
        return int.from_bytes(self.take(2), "big") / 65535.0

    def whole(self) -> int:
        """Return any int64."""
        number: int = struct.unpack(">q", self.take(8))[0]
        return number

    def real(self) -> float:
        """Return any double, NaN and infinities included."""
        number: float = struct.unpack(">d", self.take(8))[0]
        return number

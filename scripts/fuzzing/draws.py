"""Decisions that are read from bytes, which a fuzzer or chance chose: the same bytes decide the same."""

import struct
from collections.abc import Sequence
from typing import TypeVar

One = TypeVar("One")


class Draws:
    """Decides by the bytes of `data`, one after the other; at their end, each decision is the first there is.

    So whoever has the bytes can have all decisions again, and bytes that are nearly the same decide nearly the same.
    """

    def __init__(self, data: bytes) -> None:
        self._data, self._at = data, 0

    @property
    def are_left(self) -> bool:
        """Whether there are bytes that nothing was decided by."""
        return self._at < len(self._data)

    def take(self, count: int) -> bytes:
        """Return so many bytes, zeros where there are no more."""
        drawn = self._data[self._at : self._at + count]
        self._at += count
        return drawn.ljust(count, b"\0")

    def below(self, count: int) -> int:
        """Return a whole number from 0 to count - 1, for up to 65,536."""
        return int.from_bytes(self.take(1 if count <= 256 else 2), "big") % count

    def choice(self, choices: Sequence[One]) -> One:
        """Return one of these."""
        return choices[self.below(len(choices))]

    def one_in(self, count: int) -> bool:
        """Return True once in so many times; not where there are no bytes left."""
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

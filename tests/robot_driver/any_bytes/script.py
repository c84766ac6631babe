"""Bytes read as a script of what comes down a line: any bytes are a script, and small changes make small changes."""

import struct
from collections.abc import Callable, Iterator, Sequence
from itertools import cycle
from typing import Any, TypeVar

from robot_driver.controllers import BadReply, Request

T = TypeVar("T")

FILLER = bytes(256)  # what comes when a reply is over but the driver waits for more; longer than any reply
LONGEST_NOISE = 64  # bytes in a row


class Script:
    """Choices, one after another; all 0 and b"" when the bytes are used up."""

    def __init__(self, data: bytes) -> None:
        self._data = data
        self._position = 0

    @property
    def is_over(self) -> bool:
        """Tell whether there is nothing left."""
        return self._position >= len(self._data)

    def number(self, below: int) -> int:
        """Return a number from 0 to `below` - 1, of which there are at most 256."""
        return (self.take(1) or b"\0")[0] % below

    def one_of(self, choices: Sequence[T]) -> T:
        """Return one of the choices."""
        return choices[self.number(len(choices))]

    def take(self, count: int) -> bytes:
        """Return as many bytes, fewer at the end."""
        taken = self._data[self._position : self._position + count]
        self._position += count
        return taken

    def numbers(self, layout: str) -> tuple[Any, ...]:
        """Return numbers laid out as for `struct`, any that can be."""
        size = struct.calcsize(layout)
        return struct.unpack(layout, self.take(size).ljust(size, b"\0"))

    def sizes(self) -> Iterator[int]:
        """Return the sizes of the pieces in which everything comes."""
        return cycle([1 + self.number(256) for _ in range(4)])

    def damaged(self, data: bytes) -> bytes:
        """Return what may be left of `data` on its way: all, its beginning, all with a lost, changed or added byte."""
        damage, place, byte = self.number(8), self.number(len(data)), self.take(1)
        changed = {1: b"", 2: byte, 3: data[place : place + 1] + byte}
        if damage in changed:
            return data[:place] + changed[damage] + data[place + 1 :]
        return data[:place] if damage == 4 else data

    def stream(self, whole: "Callable[[Script], bytes]") -> bytes:
        """Return noise, and messages as `whole` makes them, damaged or not; all that is left of the script."""
        parts = []
        while not self.is_over:
            noise = self.number(4) == 0
            parts.append(self.take(self.number(LONGEST_NOISE)) if noise else self.damaged(whole(self)))
        return b"".join(parts)


def in_pieces(feed: Callable[[bytes], list[T]], stream: bytes, sizes: Iterator[int]) -> Iterator[tuple[int, T]]:
    """Feed a stream in pieces; yield what is found, each with how many bytes had come by then."""
    position = 0
    while position < len(stream):
        piece = stream[position : position + next(sizes)]
        position += len(piece)
        yield from ((position, found) for found in feed(piece))


def taken_as_reply(request: Request[Any], stream: bytes, sizes: Iterator[int]) -> bytes:
    """Return what is read as the reply to a request from a stream that comes in pieces, as the port reads it."""
    reply = b""
    while (missing := request.missing(reply)) > 0 and len(reply) < len(stream):
        reply = stream[: len(reply) + min(missing, next(sizes))]
    return reply


def understood(request: Request[T], reply: bytes) -> tuple[T] | None:
    """Return what a reply says; None if it is refused."""
    try:
        return (request.parse(reply),)
    except BadReply:
        return None

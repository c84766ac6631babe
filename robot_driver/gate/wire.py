"""The last gate's interface to motor controllers: the effect of each request, and how to stop the motors."""

from collections.abc import Callable
from typing import NamedTuple, Protocol


class Request(NamedTuple):
    """Effect of a packet that may be sent: the duty that it sets, first channel first, and the units that it arms.

    Arming is giving a controller the watchdog that stops the motors when it receives nothing; units are bits.
    """

    duty: tuple[float, float] | None = None
    arms: int = 0


class Stop(NamedTuple):
    """A packet that stops motors, and the check whether the bytes received since acknowledge it."""

    data: bytes
    acknowledged: Callable[[bytes], bool]


class Wire(Protocol):
    """The protocol of one kind of controller.

    `units` are the bits of all units that must be armed. `streams`: it sends without being asked.
    """

    units: int
    streams: bool

    def read(self, data: bytes) -> list[Request] | None:
        """Return the requests in the data to write; None if they contain anything that the driver never sends."""

    def stops(self, now: int) -> list[Stop]:
        """Return the packets that stop all motors at `now` (ns, steady clock), one for each unit."""

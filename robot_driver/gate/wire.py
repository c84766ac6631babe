"""What the last gate knows of a motor controller: which requests do what, and how to stop the motors."""

from collections.abc import Callable
from typing import NamedTuple, Protocol


class Request(NamedTuple):
    """What a packet that may be sent does: the duty that it sets, first channel first, and which units it arms.

    Arming is giving a controller the watchdog that stops the motors when it hears nothing; units are bits.
    """

    duty: tuple[float, float] | None = None
    arms: int = 0


class Stop(NamedTuple):
    """A packet that stops motors, and whether what came since acknowledges it."""

    data: bytes
    acknowledged: Callable[[bytes], bool]


class Wire(Protocol):
    """The protocol of one kind of controller.

    `units` are the bits of all units that have to be armed. `streams`: it talks without being asked.
    """

    units: int
    streams: bool

    def read(self, data: bytes) -> list[Request] | None:
        """Return the requests in what is to be written; None if there is anything that the driver never sends."""

    def stops(self, now: int) -> list[Stop]:
        """Return what stops all motors at `now` (ns, steady clock), each for itself."""

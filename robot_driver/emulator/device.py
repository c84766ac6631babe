"""Interface of emulated serial devices to the engine: bytes and time in, bytes and time out, no I/O."""

from collections import Counter
from typing import NamedTuple, Protocol

MOST_KINDS, OTHERS = 300, "others"
BITS_PER_BYTE = 10  # start bit, eight data bits, stop bit


class Transmission(NamedTuple):
    """Bytes that a device sends; `time` (s since the start) is when the last of them has left the wire."""

    time: float
    data: bytes


class Device(Protocol):
    """A device at the end of a serial line. Times are s since the start and never go back.

    The plant is at the given time whenever a method is called. `byte_time` (s) is the duration of one byte on the wire.
    `wake_time` (s) is when the device next acts on its own; infinity for never.
    """

    byte_time: float

    @property
    def wake_time(self) -> float:
        """When the device next acts on its own."""

    def receive(self, data: bytes, time: float) -> list[Transmission]:
        """Process bytes, the last of which arrived at `time`."""

    def wake(self, time: float) -> list[Transmission]:
        """Act; called when `wake_time` has come."""


class NotUnderstood(Counter[str]):
    """Counts of input that a device did not understand, by kind; of many kinds, the last are counted as OTHERS."""

    def note(self, what: str) -> None:
        """Count one."""
        self[what if what in self or len(self) < MOST_KINDS else OTHERS] += 1


def not_understood(device: Device) -> Counter[str]:
    """Return the counts of input that a device did not understand, by kind; empty if it does not count."""
    counted = getattr(device, "not_understood", None)
    return counted if isinstance(counted, Counter) else Counter()


def byte_time(baud: int) -> float:
    """Return the duration of one byte on a line at `baud` bit/s, in s; 0 if baud is 0."""
    return BITS_PER_BYTE / baud if baud else 0.0

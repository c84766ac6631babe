"""The USB adapter between an emulated device's wire and the driver, which delays bytes."""

from dataclasses import dataclass
from random import Random

PACKET = 62  # bytes that an adapter sends at once, regardless of its timer
FRAME = 0.001  # s; USB sends once in a frame


@dataclass(frozen=True)
class Lateness:
    """Delays on the driver's computer.

    `usb_latency` (s) is how long an adapter collects bytes before it sends them; 0: none, as in devices with their own
    USB. A thread that has been waited for runs after `waking` (s) on average; a `busy` share of the times it is
    `held_up` (s) on average on top of that.
    """

    usb_latency: float = 0.001
    waking: float = 50e-6
    busy: float = 0.0
    held_up: float = 0.004

    def of_waking(self, random: Random) -> int:
        """Draw the delay of a thread (ns)."""
        draw = random.random
        late = self.waking * (0.5 + draw())
        if self.busy and draw() < self.busy:
            late += random.expovariate(1.0 / self.held_up)
        return int(1e9 * late)


class UsbAdapter:
    """Sends the bytes of the wire whenever its timer of `latency` (s) ends, and whenever a packet is full."""

    def __init__(self, latency: float, random: Random) -> None:
        self._latency = latency
        self._phase = random.random() * latency
        self._random = random
        self._tick = 0.0  # when the collected bytes are sent
        self._held = 0

    def pieces(self, begin: float, end: float, data: bytes) -> list[tuple[float, bytes]]:
        """Return when bytes that are on the wire from `begin` to `end` reach the computer, piece by piece."""
        pieces = []
        tick, held, left = self._tick, self._held, len(data)
        byte_time = (end - begin) / left
        while left:
            first = begin + byte_time
            if first > tick:
                tick = self._phase + self._latency * (int((first - self._phase) / self._latency) + 1)
                held = 0
            count = min(left, PACKET - held)
            if byte_time:
                count = min(count, max(1, int((tick - begin) / byte_time + 1e-6)))
            held = (held + count) % PACKET
            begin += count * byte_time
            pieces.append((tick if held else begin, data[-left : count - left or None]))
            left -= count
        self._tick, self._held = tick, held
        return pieces

    def way_down(self) -> float:
        """Draw the delay until written bytes are on the wire (s)."""
        return self._random.random() * FRAME


class OwnUsb:
    """A device with its own USB."""

    def pieces(self, begin: float, end: float, data: bytes) -> list[tuple[float, bytes]]:
        """Return one piece, at the end."""
        del begin
        return [(end, data)]

    def way_down(self) -> float:
        """Return 0."""
        return 0.0

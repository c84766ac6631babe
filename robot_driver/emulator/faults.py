"""A line with faults: slow adapters, noise, lost packets, a silent device."""

from collections import Counter
from dataclasses import dataclass
from random import Random

from robot_driver.emulator.device import Device, Transmission

DELAY = 0.030  # s; longer than a client should wait for an answer


@dataclass
class Faults:
    """The faults of a line; may be changed at any time.

    `latency` (s) is added to every answer, `byte_gap` (s) separates the bytes of an answer. Then follow shares of
    answers: lost whole, late by DELAY; and shares of packets, either way: lost whole, with one bit flipped, one byte
    dropped, one byte inserted. `silent`: nothing comes back at all. `deaf`: bytes reach the device, but are corrupted.
    """

    latency: float = 0.0
    byte_gap: float = 0.0
    lose_answer: float = 0.0
    delay_answer: float = 0.0
    lose: float = 0.0
    flip: float = 0.0
    drop: float = 0.0
    insert: float = 0.0
    silent: bool = False
    deaf: bool = False


class FaultyLine:
    """`device` at the end of a line with `faults`.

    `truth` holds the requests and the device's answers before any damage; `damaged` counts faults by kind.
    """

    def __init__(self, device: Device, faults: Faults, seed: int = 0) -> None:
        self.device = device
        self.faults = faults
        self.truth: list[tuple[bytes, bytes]] = []
        self.damaged: Counter[str] = Counter()
        self.byte_time = device.byte_time
        self._random = Random(seed)

    @property
    def wake_time(self) -> float:
        """When the device next acts on its own."""
        return self.device.wake_time

    def receive(self, data: bytes, time: float) -> list[Transmission]:
        """Process bytes, possibly damaged in transmission."""
        arriving = bytes(len(data)) if self.faults.deaf else self._damage(data)
        answers = self.device.receive(arriving, time)
        self.truth += [(data, answer.data) for answer in answers]
        return self._back(answers)

    def wake(self, time: float) -> list[Transmission]:
        """Act; bytes sent may be damaged in transmission."""
        return self._back(self.device.wake(time))

    def _back(self, answers: list[Transmission]) -> list[Transmission]:
        faults, arriving = self.faults, []
        for answer in answers:
            data = b"" if faults.silent or self._happens("lose_answer") else self._damage(answer.data)
            began = answer.time + faults.latency + (DELAY if self._happens("delay_answer") else 0.0)
            if faults.byte_gap:
                arriving += [Transmission(began + i * faults.byte_gap, data[i : i + 1]) for i in range(len(data))]
            elif data:
                arriving.append(Transmission(began, data))
        return arriving

    def _damage(self, data: bytes) -> bytes:
        if not data:
            return data
        place, byte = self._random.randrange(len(data)), self._random.randrange(256)
        damaged = {
            "lose": b"",
            "flip": data[:place] + bytes((data[place] ^ 1 << byte % 8,)) + data[place + 1 :],
            "drop": data[:place] + data[place + 1 :],
            "insert": data[:place] + bytes((byte,)) + data[place:],
        }
        for kind, result in damaged.items():
            if self._happens(kind):
                return result
        return data

    def _happens(self, kind: str) -> bool:
        """Draw whether this fault happens now, and count it."""
        share: float = getattr(self.faults, kind)
        happens = self._random.random() < share
        self.damaged[kind] += happens
        return happens

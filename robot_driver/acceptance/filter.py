"""The filter between driver and device: forwards bytes, records them, and degrades the line on request.

It has no I/O and no clock: bytes and times go in, pieces of bytes with their due times come out.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field
from random import Random
from typing import NamedTuple, Protocol

from robot_driver.acceptance.dialects import COUNTER_RANGE, Dialect, Kind, Pair

SECOND = 10**9  # ns; all times are ns of the monotonic clock
BITS_PER_BYTE = 10  # 8N1
ADAPTER = 4_000_000  # ns for which a slow adapter delays a reply
EIGHTH_BIT = 0x80
VALID_LINE, INVALID_LINE = b"1\r\n", b"0\r\n"  # ends of a DSP-3000's lines
NO_COUNTS = 0, 0


class Piece(NamedTuple):
    """Bytes to be passed on at `due`, to the device or to the driver."""

    due: int
    to_device: bool
    data: bytes


class Line(Protocol):
    """The interface of a line for a relay."""

    def from_driver(self, data: bytes, now: int) -> list[Piece]:
        """Handle bytes from the driver."""

    def from_device(self, data: bytes, now: int) -> list[Piece]:
        """Handle bytes from the device."""


@dataclass
class Exchange:
    """A request, made by the driver and passed on to the device; a reply of the device, delivered to the driver."""

    asked: int
    request: bytes
    passed: bytes
    reply: bytes = b""
    answered: int = 0
    delivered: bytes = b""


@dataclass
class Faults:
    """Faults of the line; may be changed at any time.

    `gap` (ns) separates the bytes of a reply; `latency` (ns) is added to it. `lose`, `damage`, `delay` are shares of
    replies: lost completely; with a bit flipped, or a byte dropped or inserted; delayed by `delay_by` (ns). `silent`:
    no reply comes. `deaf`: the device receives meaningless bytes. `baud`: apparent rate of the line; 0 for the real
    one. `withheld` are kinds of requests without replies; the next zero or reply of the kind `lose_next` is lost once.
    """

    gap: int = 0
    latency: int = 0
    lose: float = 0.0
    damage: float = 0.0
    damage_requests: float = 0.0
    delay: float = 0.0
    delay_by: int = 35_000_000
    silent: bool = False
    deaf: bool = False
    baud: int = 0
    withheld: frozenset[Kind] = frozenset()
    lose_next_zero: bool = False


@dataclass
class Forgery:
    """False statements of the device: counts increased by `offset`, a lost watchdog, a voltage (V).

    It reports a watchdog again as soon as one is set, unless that is `refused`.
    """

    offset: Pair = NO_COUNTS
    watchdog_lost: bool = False
    watchdog_refused: bool = False
    voltage: float | None = None


@dataclass
class Filter:
    """The line to a motor controller that speaks `dialect`."""

    dialect: Dialect
    seed: int = 0
    faults: Faults = field(default_factory=Faults)
    forgery: Forgery = field(default_factory=Forgery)
    exchanges: list[Exchange] = field(default_factory=list)

    def __post_init__(self) -> None:
        self._random = Random(self.seed)
        self._held = b""
        self._last_due = 0  # due time of the last bytes passed on to the driver

    def from_driver(self, data: bytes, now: int) -> list[Piece]:
        """Take a request."""
        faults = self.faults
        passed = data
        if faults.deaf:
            passed = bytes(len(data))
        elif self._happens(faults.damage_requests):
            passed = self._damaged(data)
        due = now + self._wire_time(data)
        if self.dialect.kind(passed) is Kind.SET_WATCHDOG:
            self.forgery.watchdog_lost = self.forgery.watchdog_refused
        self.exchanges.append(Exchange(due, data, passed))
        self._held = b""
        return [Piece(due, True, passed)] if passed else []

    def from_device(self, data: bytes, now: int) -> list[Piece]:
        """Take a reply, or a part of one."""
        if not self.exchanges:
            return [Piece(now, False, data)]
        exchange = self.exchanges[-1]
        exchange.reply += data
        exchange.answered = now
        self._held += data
        if self.dialect.is_whole(exchange.request, exchange.reply) is False and self._needs_all():
            return []
        held, self._held = self._held, b""
        return list(self._passed_on(exchange, held, now))

    def own_request(self, data: bytes, now: int) -> list[Piece]:
        """Make a request of our own, after the driver has ended."""
        self.exchanges.append(Exchange(now, data, data))
        return [Piece(now, True, data)]

    def _needs_all(self) -> bool:
        return self.faults != Faults() or self.forgery != Forgery()

    def _passed_on(self, exchange: Exchange, data: bytes, now: int) -> Iterator[Piece]:
        """Yield the parts of a reply that reach the driver, with their times."""
        faults = self.faults
        kind = self.dialect.kind(exchange.request)
        data = self._forged(kind, exchange.reply, data)
        lost = faults.silent or kind in faults.withheld or self._happens(faults.lose)
        if faults.lose_next_zero and self.dialect.duty(exchange.request) == (0.0, 0.0):
            faults.lose_next_zero, lost = False, True
        if lost:
            return
        if self._happens(faults.damage):
            data = self._damaged(data)
        exchange.delivered += data
        due = now + faults.latency + self._wire_time(data)
        due += ADAPTER if faults.baud else 0
        due += faults.delay_by if self._happens(faults.delay) else 0
        due = max(due, self._last_due)  # replies cannot overtake each other
        parts = [data[number : number + 1] for number in range(len(data))] if faults.gap else [data]
        for number, part in enumerate(parts):
            self._last_due = due + number * faults.gap
            yield Piece(self._last_due, False, part)

    def _forged(self, kind: Kind, reply: bytes, data: bytes) -> bytes:
        forgery = self.forgery
        if kind is Kind.COUNTS and forgery.offset != NO_COUNTS:
            counts = self.dialect.counts(reply)
            return data if counts is None else self.dialect.saying_counts(shifted(counts, forgery.offset))
        if kind is Kind.WATCHDOG and forgery.watchdog_lost:
            return self.dialect.saying_watchdog(0.0)
        if kind is Kind.VOLTAGE and forgery.voltage is not None:
            return self.dialect.saying_voltage(forgery.voltage)
        return data

    def _damaged(self, data: bytes) -> bytes:
        place, byte = self._random.randrange(len(data)), self._random.randrange(256)
        flipped = bytes((data[place] ^ 1 << byte % 8,))
        before, after = data[:place], data[place + 1 :]
        return self._random.choice((before + flipped + after, before + after, before + bytes((byte,)) + data[place:]))

    def _happens(self, share: float) -> bool:
        return share > 0.0 and self._random.random() < share

    def _wire_time(self, data: bytes) -> int:
        return len(data) * BITS_PER_BYTE * SECOND // self.faults.baud if self.faults.baud else 0


@dataclass
class GyroFaults:
    """Faults of a gyro's line: held back for `hold` (ns) at a time; a share of bytes damaged; off; not valid.

    Damage sets the eighth bit of a byte: a text protocol without checksum cannot detect a changed digit.
    """

    hold: int = 0
    damage: float = 0.0
    off: bool = False
    invalid: bool = False


@dataclass
class GyroFilter:
    """The line to a gyro that sends by itself; `heard` are its true readings with times."""

    seed: int = 0
    faults: GyroFaults = field(default_factory=GyroFaults)
    heard: list[tuple[int, bytes]] = field(default_factory=list)

    def __post_init__(self) -> None:
        self._random = Random(self.seed)

    def from_driver(self, data: bytes, now: int) -> list[Piece]:
        """Handle bytes sent to the gyro."""
        return [] if self.faults.off else [Piece(now, True, data)]

    def from_device(self, data: bytes, now: int) -> list[Piece]:
        """Handle bytes from the gyro."""
        faults = self.faults
        if faults.off:
            return []
        self.heard.append((now, data))
        if faults.damage:
            data = bytes(byte ^ EIGHTH_BIT if self._happens() else byte for byte in data)
        if faults.invalid:
            data = data.replace(VALID_LINE, INVALID_LINE)
        due = (now // faults.hold + 1) * faults.hold if faults.hold else now
        return [Piece(due, False, data)]

    def _happens(self) -> bool:
        return self._random.random() < self.faults.damage


def shifted(counts: Pair, offset: Pair) -> Pair:
    """Return counts increased by an offset, modulo 2^32."""
    return (counts[0] + offset[0]) % COUNTER_RANGE, (counts[1] + offset[1]) % COUNTER_RANGE

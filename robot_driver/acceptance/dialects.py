"""Interpret and forge the bytes between driver and motor controller.

The last gate (`robot_driver.gate`) knows the requests. This module adds the length and contents of replies, and the
construction of false ones.
"""

import re
import struct
from abc import ABC, abstractmethod
from enum import Enum, auto
from typing import ClassVar

from robot_driver.gate import wire_roboclaw as claw
from robot_driver.gate.wire import Wire
from robot_driver.gate.wire_roboteq import DONE, END, RoboteqWire

Pair = tuple[int, int]
COUNTER_RANGE = 2**32


class Kind(Enum):
    """The subject of a request."""

    DRIVE = auto()
    COUNTS = auto()
    SET_WATCHDOG = auto()
    WATCHDOG = auto()
    VOLTAGE = auto()
    OTHER = auto()


class Dialect(ABC):
    """The protocol of one kind of controller. `wire` is the last gate's part of it."""

    wire: Wire
    ask_counts: bytes  # the request for both encoder counts

    def duty(self, request: bytes) -> tuple[float, float] | None:
        """Return the duty of each channel that a request sets."""
        for part in self.wire.read(request) or ():
            if part.duty is not None:
                return part.duty
        return None

    @abstractmethod
    def kind(self, request: bytes) -> Kind:
        """Return the subject of a request."""

    @abstractmethod
    def is_whole(self, request: bytes, reply: bytes) -> bool | None:
        """Return whether this is a whole reply; None if its length is not known."""

    @abstractmethod
    def acknowledged(self, request: bytes, reply: bytes) -> bool:
        """Return whether the device acknowledged a request."""

    @abstractmethod
    def counts(self, reply: bytes) -> Pair | None:
        """Return the counts in a reply (modulo 2^32); None without any."""

    @abstractmethod
    def watchdog(self, reply: bytes) -> float | None:
        """Return the watchdog timeout in a reply (s)."""

    @abstractmethod
    def watchdog_set(self, request: bytes) -> float:
        """Return the watchdog timeout that a request sets (s)."""

    @abstractmethod
    def saying_counts(self, counts: Pair) -> bytes:
        """Return a reply that reports these counts."""

    @abstractmethod
    def saying_watchdog(self, seconds: float) -> bytes:
        """Return a reply that reports this watchdog timeout [s]."""

    @abstractmethod
    def saying_voltage(self, volt: float) -> bytes:
        """Return a reply that reports this battery voltage."""


class RoboClawDialect(Dialect):
    """One RoboClaw at the first address."""

    wire = claw.RoboClawWire()
    ask_counts = bytes((claw.FIRST_ADDRESS, claw.READ_ENCODERS))
    _KINDS: ClassVar = {
        claw.DRIVE_BOTH: Kind.DRIVE,
        claw.READ_ENCODERS: Kind.COUNTS,
        claw.SET_WATCHDOG: Kind.SET_WATCHDOG,
        claw.READ_WATCHDOG: Kind.WATCHDOG,
        claw.READ_BATTERY: Kind.VOLTAGE,
    }
    _LENGTHS: ClassVar = {
        claw.READ_ENCODERS: 10,
        claw.READ_WATCHDOG: 3,
        claw.READ_BATTERY: 4,
        claw.READ_CURRENTS: 6,
        claw.READ_TEMPERATURE: 4,
        claw.DRIVE_BOTH: 1,
        claw.SET_WATCHDOG: 1,
    }

    def kind(self, request: bytes) -> Kind:
        """Return the subject of a request."""
        return self._KINDS.get(request[1], Kind.OTHER) if len(request) > 1 else Kind.OTHER

    def is_whole(self, request: bytes, reply: bytes) -> bool | None:
        """Return whether this is a whole reply; that of the status may have three lengths."""
        length = self._LENGTHS.get(request[1]) if len(request) > 1 else None
        return None if length is None else len(reply) >= length

    def acknowledged(self, request: bytes, reply: bytes) -> bool:
        """Return whether the device acknowledged a request."""
        del request
        return reply == claw.ACKNOWLEDGED

    def counts(self, reply: bytes) -> Pair | None:
        """Return the counts in a reply."""
        data = _checked(claw.READ_ENCODERS, reply)
        if len(data) != 8:
            return None
        first, second = struct.unpack(">II", data)
        return first, second

    def watchdog(self, reply: bytes) -> float | None:
        """Return the watchdog timeout in a reply (s)."""
        data = _checked(claw.READ_WATCHDOG, reply)
        return data[0] * claw.WATCHDOG_STEP if len(data) == 1 else None

    def watchdog_set(self, request: bytes) -> float:
        """Return the watchdog timeout that a request sets (s)."""
        return request[2] * claw.WATCHDOG_STEP

    def saying_counts(self, counts: Pair) -> bytes:
        """Return a reply that reports these counts."""
        return _saying(claw.READ_ENCODERS, struct.pack(">II", *counts))

    def saying_watchdog(self, seconds: float) -> bytes:
        """Return a reply that reports this watchdog timeout [s]."""
        return _saying(claw.READ_WATCHDOG, bytes((round(seconds / claw.WATCHDOG_STEP),)))

    def saying_voltage(self, volt: float) -> bytes:
        """Return a reply that reports this battery voltage."""
        return _saying(claw.READ_BATTERY, struct.pack(">H", round(10 * volt)))


def _saying(command: int, data: bytes) -> bytes:
    return claw.packet(bytes((claw.FIRST_ADDRESS, command)), data)[2:]


def _checked(command: int, reply: bytes) -> bytes:
    """Return the data of a reply; nothing if its CRC is wrong."""
    data = reply[: -claw.CRC_BYTES]
    return data if _saying(command, data) == reply else b""


class RoboteqDialect(Dialect):
    """One Roboteq: lines of text."""

    wire = RoboteqWire()
    ask_counts = b"?C\r"
    _KINDS = ((b"!M", Kind.DRIVE), (b"?C", Kind.COUNTS), (b"^RWD", Kind.SET_WATCHDOG), (b"~RWD", Kind.WATCHDOG))

    def kind(self, request: bytes) -> Kind:
        """Return the subject of a request."""
        if request == b"?V\r":
            return Kind.VOLTAGE
        return next((kind for begin, kind in self._KINDS if request.startswith(begin)), Kind.OTHER)

    def is_whole(self, request: bytes, reply: bytes) -> bool | None:
        """Return whether this is a whole reply: a line, after the echo if there is one."""
        return reply.removeprefix(request).endswith(END)

    def acknowledged(self, request: bytes, reply: bytes) -> bool:
        """Return whether the device acknowledged a request."""
        return reply.removeprefix(request) == DONE

    def counts(self, reply: bytes) -> Pair | None:
        """Return the counts in a reply."""
        found = re.fullmatch(rb"(?:\?C\r)?C=(-?\d+):(-?\d+)\r", reply)
        return (int(found[1]) % COUNTER_RANGE, int(found[2]) % COUNTER_RANGE) if found else None

    def watchdog(self, reply: bytes) -> float | None:
        """Return the watchdog timeout in a reply (s)."""
        found = re.fullmatch(rb"(?:~RWD\r)?RWD=(\d+)\r", reply)
        return int(found[1]) / 1000 if found else None

    def watchdog_set(self, request: bytes) -> float:
        """Return the watchdog timeout that a request sets (s)."""
        return int(request.split()[1]) / 1000

    def saying_counts(self, counts: Pair) -> bytes:
        """Return a reply that reports these counts, which the device sends as signed numbers."""
        half = COUNTER_RANGE // 2
        first, second = ((count + half) % COUNTER_RANGE - half for count in counts)
        return b"C=%d:%d\r" % (first, second)

    def saying_watchdog(self, seconds: float) -> bytes:
        """Return a reply that reports this watchdog timeout [s]."""
        return b"RWD=%d\r" % round(1000 * seconds)

    def saying_voltage(self, volt: float) -> bytes:
        """Return a reply that reports this voltage, with usual ones of driver stage and logic."""
        return b"V=120:%d:5000\r" % round(10 * volt)


DIALECTS: dict[str, type[Dialect]] = {"roboclaw": RoboClawDialect, "roboteq": RoboteqDialect}

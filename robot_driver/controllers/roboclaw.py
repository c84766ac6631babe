"""RoboClaw and MCP controllers by Basicmicro: packet serial.

Written as `address command data... crc`, answered with one byte 0xFF; or asked as `address command`, answered with
`data... crc`. The CRC covers address, command and data, of a reply too. Numbers are big-endian. Invalid packets are not
answered. Source: RoboClaw user manual, chapter "Packet serial".
"""

import struct
from collections.abc import Callable
from typing import TypeVar

from cmr.msg import motor_feedback_t
from robot_driver.controllers.controller import BadReply, Controller, Request, Telemetry
from robot_driver.gate.wire_roboclaw import (
    ACKNOWLEDGED,
    CRC_BYTES,
    DRIVE_BOTH,
    FIRST_ADDRESS,
    FULL_DUTY,
    READ_BATTERY,
    READ_CURRENTS,
    READ_ENCODERS,
    READ_STATUS,
    READ_TEMPERATURE,
    READ_VERSION,
    READ_WATCHDOG,
    SET_WATCHDOG,
    WATCHDOG_STEP,
    crc,
    packet,
)

T = TypeVar("T")

LONGEST_VERSION = 48  # bytes, including the final LF and NUL
STATUS_LENGTHS = (4, 2, 1)  # bytes; newest firmware first

_ESTOP = motor_feedback_t.STATUS_ESTOP
_TEMPERATURE = motor_feedback_t.STATUS_TEMPERATURE
_BATTERY = motor_feedback_t.STATUS_BATTERY
_MOTOR_FAULT = motor_feedback_t.STATUS_MOTOR_FAULT

# Which bits of command 90 mean what, by length of the reply in bytes. The bits for homing and limit switches are
# ignored. Errors of the speed and position loops count as motor faults.
STATUS_BITS: dict[int, dict[int, int]] = {
    4: {
        _ESTOP: 0x00000001,
        _TEMPERATURE: 0x00300006,
        _BATTERY: 0x000CC038,
        _MOTOR_FAULT: 0x03033FC0,
    },
    2: {_ESTOP: 0x0004, _TEMPERATURE: 0x3018, _BATTERY: 0x0CE0, _MOTOR_FAULT: 0x0303},
    # The oldest firmware is known only from client code, not from the manual. Its e-stop bit is treated like that of
    # the others: if it were another bit, the motors would be held without need, or move at once after the release.
    1: {_ESTOP: 0x04, _TEMPERATURE: 0x08, _BATTERY: 0xF0, _MOTOR_FAULT: 0x03},
}


class RoboClaw(Controller):
    """One RoboClaw, at address 0x80 unless another is given; channel M1 is first, M2 second."""

    default_baud_rate = 115200
    other_baud_rates = (38400, 460800, 9600)  # factory setting; the fastest; 9600 is a common choice
    link = "packet serial, address 0x80,"
    essential = frozenset({"status"})

    def __init__(self, address: int = FIRST_ADDRESS) -> None:
        self._address = address
        self._status_length = STATUS_LENGTHS[0]

    def identify(self) -> Request[str]:
        """Ask for the firmware's name, for example "USB Roboclaw 2x15a v4.2.8" (command 21)."""
        return Request(
            "version",
            self._header(READ_VERSION),
            LONGEST_VERSION + CRC_BYTES,
            _missing_of_version,
            lambda reply: _version(_checked(self._header(READ_VERSION), reply)),
        )

    def learn(self) -> list[Request[None]]:
        """Find out which of three formats the status has: its length depends on the firmware (command 90)."""
        return [
            Request(
                "status format",
                self._header(READ_STATUS),
                STATUS_LENGTHS[0] + CRC_BYTES,
                lambda reply: STATUS_LENGTHS[0] + CRC_BYTES - len(reply),
                self._learn_status_length,
                ends_in_silence=True,
            )
        ]

    def set_watchdog(self, seconds: float) -> Request[None]:
        """Stop the motors after a silence of up to 25.5 s, in steps of 0.1 s (command 14). Not kept over power-off."""
        return _write(self._header(SET_WATCHDOG), struct.pack(">B", round(seconds / WATCHDOG_STEP)), None)

    def read_watchdog(self) -> Request[float]:
        """Ask for the time after which the motors stop (s, command 15)."""
        return _read(self._header(READ_WATCHDOG), ">B", lambda steps: steps * WATCHDOG_STEP)

    def drive(self, first: float, second: float) -> Request[tuple[float, float]]:
        """Set the duty of M1 and M2 (command 34).

        Raises ValueError for a duty outside [-1, 1].
        """
        steps = [round(duty * FULL_DUTY) for duty in (first, second)]
        if max(map(abs, steps)) > FULL_DUTY:
            raise ValueError(f"A duty must be between -1 and 1, not {first}, {second}.")
        return _write(
            self._header(DRIVE_BOTH), struct.pack(">hh", *steps), (steps[0] / FULL_DUTY, steps[1] / FULL_DUTY)
        )

    def read_encoders(self) -> Request[tuple[int, int]]:
        """Ask for both encoder counts (command 78)."""
        return _read(self._header(READ_ENCODERS), ">II", lambda first, second: (first, second))

    def read_telemetry(self) -> list[Request[Telemetry]]:
        """Ask for battery (command 24), motor currents (49), temperature (82) and status (90)."""
        status_format = {4: ">I", 2: ">H", 1: ">B"}[self._status_length]
        return [
            _read(self._header(READ_BATTERY), ">H", lambda tenths: Telemetry(battery_voltage=tenths / 10)),
            _read(
                self._header(READ_CURRENTS),
                ">hh",
                lambda *hundredths: Telemetry(currents=_pair_of_amperes(*hundredths)),
            ),
            _read(self._header(READ_TEMPERATURE), ">H", lambda tenths: Telemetry(temperature=tenths / 10)),
            _read(self._header(READ_STATUS), status_format, lambda word: Telemetry(status=self._status(word))),
        ]

    def _header(self, command: int) -> bytes:
        return bytes((self._address, command))

    def _learn_status_length(self, reply: bytes) -> None:
        _checked(self._header(READ_STATUS), reply)
        if len(reply) - CRC_BYTES not in STATUS_LENGTHS:
            raise BadReply(f"A status of {len(reply) - CRC_BYTES} bytes is none of the known formats.")
        self._status_length = len(reply) - CRC_BYTES

    def _status(self, word: int) -> int:
        return sum(ours for ours, theirs in STATUS_BITS[self._status_length].items() if word & theirs)


def _name(header: bytes) -> str:
    return f"command {header[1]} of unit 0x{header[0]:x}"


def _write(header: bytes, data: bytes, done: T) -> Request[T]:
    """Return a request that sets something; the answer to its acknowledgement is `done`."""

    def parse(reply: bytes) -> T:
        if reply != ACKNOWLEDGED:
            raise BadReply(f"{_name(header)} was answered with {reply.hex()} instead of ff.")
        return done

    return Request(_name(header), packet(header, data), 1, lambda reply: 1 - len(reply), parse)


def _read(header: bytes, layout: str, convert: Callable[..., T]) -> Request[T]:
    """Return a request whose answer is `convert` of the numbers in the reply, laid out as for `struct`."""
    length = struct.calcsize(layout) + CRC_BYTES

    def parse(reply: bytes) -> T:
        if len(reply) != length:
            raise BadReply(f"{_name(header)} was answered with {len(reply)} bytes instead of {length}.")
        return convert(*struct.unpack(layout, _checked(header, reply)))

    return Request(_name(header), header, length, lambda reply: length - len(reply), parse)


def _checked(header: bytes, reply: bytes) -> bytes:
    """Return the data of a reply without its CRC.

    Raises BadReply when the CRC over address, command and data does not match.
    """
    data, received = reply[:-CRC_BYTES], reply[-CRC_BYTES:]
    if struct.pack(">H", crc(header + data)) != received:
        raise BadReply(f"The reply {reply.hex()} to {_name(header)} has a wrong CRC.")
    return data


def _version(data: bytes) -> str:
    """Return the text before the NUL that ends a version.

    Raises BadReply where there is no NUL: one such reply in 65536 has a right CRC by chance.
    """
    if not data.endswith(b"\0"):
        raise BadReply(f"The version {data!r} has no end.")
    return data[:-1].decode("ascii", "replace").strip()


def _missing_of_version(reply: bytes) -> int:
    """Return how many bytes of a version are missing: it ends with NUL and CRC."""
    end = reply.find(b"\0", 0, LONGEST_VERSION)
    if end < 0:
        # Without a NUL where one must be, this is no version: take what would be its CRC, which will not match.
        return min(1 + CRC_BYTES, LONGEST_VERSION + CRC_BYTES - len(reply))
    return end + 1 + CRC_BYTES - len(reply)


def _pair_of_amperes(first: int, second: int) -> tuple[float, float]:
    """Convert currents from steps of 10 mA."""
    return first / 100, second / 100

"""RoboClaw and MCP controllers by Basicmicro, for the last gate: the packets that the driver sends.

`address command data... crc`, answered with one byte 0xFF; or `address command`, which reads something.
"""

import struct
from binascii import crc_hqx

from robot_driver.gate.wire import Request, Stop

FIRST_ADDRESS = 0x80
ACKNOWLEDGED = b"\xff"
FULL_DUTY = 32767  # -32768 is to be avoided
CRC_BYTES = 2
WATCHDOG_STEP = 0.1  # s
LONGEST_WATCHDOG = 5  # steps
SET_WATCHDOG, READ_WATCHDOG, READ_VERSION, READ_BATTERY = 14, 15, 21, 24
DRIVE_BOTH, READ_CURRENTS, READ_ENCODERS, READ_TEMPERATURE, READ_STATUS = 34, 49, 78, 82, 90

_READING = {READ_WATCHDOG, READ_VERSION, READ_BATTERY, READ_CURRENTS, READ_ENCODERS, READ_TEMPERATURE, READ_STATUS}
_DUTIES = struct.Struct(">hh")


def crc(data: bytes) -> int:
    """Return the CRC-16/XMODEM of `data`, as every packet carries it, high byte first."""
    return crc_hqx(data, 0)


def packet(header: bytes, data: bytes) -> bytes:
    """Return a packet that sets something; its header is address and command."""
    content = header + data
    return content + struct.pack(">H", crc(content))


class RoboClawWire:
    """Units at the first addresses, as many as there are."""

    streams = False

    def __init__(self, count: int = 1) -> None:
        self._addresses = [FIRST_ADDRESS + number for number in range(count)]
        self.units = 2**count - 1

    def read(self, data: bytes) -> list[Request] | None:
        """Return the one request in a packet."""
        if len(data) < 2 or data[0] not in self._addresses:
            return None
        command, content = data[1], data[2:-CRC_BYTES]
        if len(data) == 2:
            return [Request()] if command in _READING else None
        if data != packet(data[:2], content):
            return None
        if command == SET_WATCHDOG and len(content) == 1 and 0 < content[0] <= LONGEST_WATCHDOG:
            return [Request(arms=1 << data[0] - FIRST_ADDRESS)]
        if command == DRIVE_BOTH and len(content) == _DUTIES.size:
            first, second = _DUTIES.unpack(content)
            return [Request((first / FULL_DUTY, second / FULL_DUTY))]
        return None

    def stops(self, now: int) -> list[Stop]:
        """Stop each unit for itself: if one is dead, the other must still be stopped."""
        del now
        zero = _DUTIES.pack(0, 0)
        return [Stop(packet(bytes((address, DRIVE_BOTH)), zero), ACKNOWLEDGED.__eq__) for address in self._addresses]

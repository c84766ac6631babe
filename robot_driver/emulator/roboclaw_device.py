"""The device's side of RoboClaw packet serial: packets, their timing and their checksums.

Source: RoboClaw user manual, "Packet Serial Commands". Requests to read carry no CRC; requests to write and all answers
to reads end with CRC-16/XMODEM, high byte first. There is no negative answer: a request that is not understood is not
answered. The commands are in `boards.roboclaw_commands`.
"""

import binascii
import math
import struct
from collections.abc import Callable

from robot_driver.emulator.boards.roboclaw import RefusedError, RoboclawBoard
from robot_driver.emulator.boards.roboclaw_commands import COMMANDS, Read, Write
from robot_driver.emulator.device import NotUnderstood, Transmission, byte_time
from robot_driver.emulator.plant import Plant
from robot_driver.emulator.settings import Settings

PACKET_GAP = 0.010  # s; a longer silence within a packet makes the device drop it
ADDRESSES = range(0x80, 0x88)  # of the units that can share a line
ACKNOWLEDGED = b"\xff"
CRC_BYTES = 2


class RoboclawDevice:
    """A RoboClaw that drives `plant`, through `command` if that is given; it answers one address and ignores the
    others.

    `commands` are those that it knows. `not_understood` counts packets that it did not answer: unknown commands and
    refused values, by number, and packets with a wrong checksum.
    """

    def __init__(self, settings: Settings, plant: Plant, command: Callable[[float, float], None] | None = None) -> None:
        self.byte_time = byte_time(settings.roboclaw.baud)
        self.board = RoboclawBoard(settings, plant, command)
        self.commands = dict(COMMANDS)
        self.not_understood = NotUnderstood()
        self._address = settings.roboclaw.address
        self._packet = b""
        self._deaf = False
        self._last_byte_time = -math.inf

    @property
    def duty(self) -> list[int]:
        """The duties applied to the motors."""
        return self.board.duty

    @property
    def wake_time(self) -> float:
        """When the motors time out, a loop is to be stepped or the next full second ends, whichever is first."""
        return min(self.board.average_due, self.board.loop_due, self._motor_deadline())

    def wake(self, time: float) -> list[Transmission]:
        """Stop the motors if the line has been silent too long; do everything else that is due."""
        self.board.time = time
        if time >= self._motor_deadline():
            self.board.stop()
        self.board.go_on()
        return []

    def receive(self, data: bytes, time: float) -> list[Transmission]:
        """Process bytes, the last of which arrived at `time`; execute every complete packet."""
        self.board.time = time
        first_byte_start = time - len(data) * self.byte_time
        if first_byte_start - self._last_byte_time > PACKET_GAP:
            self._packet, self._deaf = b"", False
        self._last_byte_time = time
        sent: list[Transmission] = []
        for byte in data:
            reply = self._take(byte)
            if reply:
                time += len(reply) * self.byte_time
                sent.append(Transmission(time, reply))
        return sent

    def _motor_deadline(self) -> float:
        """Return when the motors stop unless a byte arrives; infinity while they rest or have no timeout."""
        timeout = self.board.timeout
        return self._last_byte_time + timeout if timeout and self.board.drives else math.inf

    def _take(self, byte: int) -> bytes:
        """Add one byte to the packet; return the answer if that completes it, else no bytes."""
        if self._deaf:
            return b""
        self._packet += bytes([byte])
        packet = self._packet
        if packet[0] not in ADDRESSES:
            self._deaf = True  # noise: its end is unknown, so wait for silence
        elif len(packet) >= 2:
            command = self.commands.get(packet[1])
            if command is None:
                self._deaf = True
                self._note(packet, f"command {packet[1]}")
            elif len(packet) == 2 + _bytes_after(command):
                self._packet = b""
                return self._answer(packet, command)
        return b""

    def _answer(self, packet: bytes, command: Read | Write) -> bytes:
        """Return the answer to a whole packet, no bytes for a packet to another unit."""
        if packet[0] != self._address:
            return b""
        if isinstance(command, Read):
            answer = command.say(self.board)
            return answer + checksum(packet + answer).to_bytes(CRC_BYTES, "big")
        if int.from_bytes(packet[-CRC_BYTES:], "big") != checksum(packet[:-CRC_BYTES]):
            self._note(packet, "wrong checksum")
            return b""
        try:
            command.do(self.board, *struct.unpack(command.layout, packet[2:-CRC_BYTES]))
        except RefusedError:
            self._note(packet, f"command {packet[1]}: value")
            return b""
        return ACKNOWLEDGED

    def _note(self, packet: bytes, what: str) -> None:
        """Count a packet that was not understood, unless it was for another unit."""
        if packet[0] == self._address:
            self.not_understood.note(what)


def checksum(data: bytes) -> int:
    """Return CRC-16/XMODEM: polynomial 0x1021, initial value 0, nothing reflected."""
    return binascii.crc_hqx(data, 0)


def _bytes_after(command: Read | Write) -> int:
    """Return the number of bytes that follow the number of a command in a request."""
    return 0 if isinstance(command, Read) else struct.calcsize(command.layout) + CRC_BYTES

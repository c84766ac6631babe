"""The device's side of RoboClaw packet serial. Motor and encoder 1 are the left side, 2 the right side.

Source: RoboClaw user manual, "Packet Serial Commands". Requests to read carry no CRC; requests to write and all
answers to reads end with CRC-16/XMODEM, high byte first. There is no negative answer: what is not understood
is met with silence.
"""

import binascii
import math
import struct
from collections.abc import Callable

from robot_driver.emulator.device import Transmission, byte_time
from robot_driver.emulator.plant import Plant
from robot_driver.emulator.settings import Settings

PACKET_GAP = 0.010  # s; a longer silence within a packet makes the device drop it
FULL_DUTY = 32767
ADDRESSES = range(0x80, 0x88)  # of the units that can share a line
ACKNOWLEDGED = b"\xff"
BUFFER_EMPTY = 0x80
TIMEOUT_UNIT = 0.1  # s
AVERAGE_PERIOD = 1.0  # s; command 108 averages over the last full second
HEALTHY = 0  # status word of command 90
BACKWARD = 1  # status byte of the speed commands
VERSION = b"USB Roboclaw 2x15a v4.2.8\n\x00"


class RoboclawDevice:
    """A RoboClaw that drives `plant`, by `command` if that is given; it answers one address and ignores the others."""

    def __init__(self, settings: Settings, plant: Plant, command: Callable[[float, float], None] | None = None) -> None:
        self._command = command or plant.command
        self.byte_time = byte_time(settings.roboclaw.baud)
        self.duty = [0, 0]
        self._plant = plant
        self._settings = settings
        self._packet = b""
        self._deaf = False
        self._last_byte_time = -math.inf
        self._timeout = 0.0
        self._encoder_zero = [0, 0]
        self._average_due = AVERAGE_PERIOD
        self._average_start = self._counts()
        self._average_speeds = (0, 0)
        self._reads = self._table_of_reads()
        self._writes = self._table_of_writes()

    @property
    def wake_time(self) -> float:
        """When the motors time out or the next full second ends, whichever is first."""
        return min(self._average_due, self._motor_deadline())

    def wake(self, time: float) -> list[Transmission]:
        """Stop the motors if the line has been silent too long; measure average speeds once a second."""
        if time >= self._motor_deadline():
            self._drive(0, 0)
        if time >= self._average_due:
            counts = self._counts()
            self._average_speeds = (counts[0] - self._average_start[0], counts[1] - self._average_start[1])
            self._average_start = counts
            self._average_due += AVERAGE_PERIOD
        return []

    def receive(self, data: bytes, time: float) -> list[Transmission]:
        """Take bytes of which the last has arrived at `time`; carry out every packet that is complete."""
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
        return self._last_byte_time + self._timeout if self._timeout and any(self.duty) else math.inf

    def _take(self, byte: int) -> bytes:
        """Add one byte to the packet; return the answer if that completes it, else nothing."""
        if self._deaf:
            return b""
        self._packet += bytes([byte])
        packet = self._packet
        if packet[0] not in ADDRESSES:
            self._deaf = True  # noise: where it ends cannot be known, so wait for silence
        elif packet[0] != self._settings.roboclaw.address:
            self._pass_over(packet)
        elif len(packet) >= 2 and packet[1] in self._reads:
            self._packet = b""
            return self._with_crc(packet, self._reads[packet[1]]())
        elif len(packet) >= 2 and packet[1] in self._writes:
            layout, action = self._writes[packet[1]]
            if len(packet) == 2 + struct.calcsize(layout) + 2:
                self._packet = b""
                return self._write(packet, layout, action)
        elif len(packet) >= 2:
            self._deaf = True
        return b""

    def _pass_over(self, packet: bytes) -> None:
        """Let another unit's packet end where its command says."""
        if len(packet) < 2:
            return
        if packet[1] in self._reads:
            self._packet = b""
        elif packet[1] not in self._writes:
            self._deaf = True
        elif len(packet) == 2 + struct.calcsize(self._writes[packet[1]][0]) + 2:
            self._packet = b""

    def _write(self, packet: bytes, layout: str, action: Callable[..., None]) -> bytes:
        if int.from_bytes(packet[-2:], "big") != checksum(packet[:-2]):
            return b""
        action(*struct.unpack(layout, packet[2:-2]))
        return ACKNOWLEDGED

    @staticmethod
    def _with_crc(request: bytes, answer: bytes) -> bytes:
        """Append the CRC, which covers address and command as sent, then the answer."""
        return answer + checksum(request + answer).to_bytes(2, "big")

    def _table_of_writes(self) -> dict[int, tuple[str, Callable[..., None]]]:
        """Return layout of the data and action by command number."""
        return {
            14: (">B", self._set_timeout),
            20: (">", self._reset_encoders),
            32: (">h", lambda duty: self._drive(duty, self.duty[1])),
            33: (">h", lambda duty: self._drive(self.duty[0], duty)),
            34: (">hh", self._drive),
        }

    def _table_of_reads(self) -> dict[int, Callable[[], bytes]]:
        """Return what composes the answer, by command number."""
        electrics = self._settings.electrics
        return {
            15: lambda: bytes([round(self._timeout / TIMEOUT_UNIT)]),
            16: lambda: self._encoder_and_status(0),
            17: lambda: self._encoder_and_status(1),
            18: lambda: self._speed_and_status(0),
            19: lambda: self._speed_and_status(1),
            21: lambda: VERSION,
            24: lambda: _tenths(self._plant.battery_voltage()),
            25: lambda: _tenths(electrics.logic_voltage),
            30: lambda: self._speed_and_status(0),
            31: lambda: self._speed_and_status(1),
            47: lambda: bytes([BUFFER_EMPTY, BUFFER_EMPTY]),
            48: lambda: struct.pack(">hh", *self.duty),
            49: lambda: struct.pack(">hh", *self._currents()),
            73: self._everything,
            78: lambda: struct.pack(">II", *self._encoders()),
            79: lambda: struct.pack(">ii", *self._speeds()),
            82: lambda: _tenths(electrics.temperature),
            83: lambda: _tenths(electrics.temperature),
            90: lambda: HEALTHY.to_bytes(self._settings.roboclaw.status_bytes, "big"),
            108: lambda: struct.pack(">ii", *self._average_speeds),
        }

    def _drive(self, left: int, right: int) -> None:
        self.duty = [left, right]
        self._command(left / FULL_DUTY, right / FULL_DUTY)

    def _set_timeout(self, tenths: int) -> None:
        self._timeout = tenths * TIMEOUT_UNIT

    def _reset_encoders(self) -> None:
        counts = self._counts()
        # The average speed of command 108 is a difference of absolute counts; it does not see the reset.
        self._encoder_zero = list(counts)

    def _counts(self) -> tuple[int, int]:
        left, right = self._plant.encoder_counts()
        return math.floor(left), math.floor(right)

    def _encoders(self) -> tuple[int, int]:
        """Return both registers: counts since the last reset, modulo 2^32."""
        left, right = self._counts()
        return (left - self._encoder_zero[0]) & 0xFFFFFFFF, (right - self._encoder_zero[1]) & 0xFFFFFFFF

    def _speeds(self) -> tuple[int, int]:
        left, right = self._plant.encoder_speeds()
        return round(left), round(right)

    def _currents(self) -> tuple[int, int]:
        """Return both currents in units of 10 mA."""
        left, right = self._plant.motor_currents()
        return round(left * 100.0), round(right * 100.0)

    def _encoder_and_status(self, motor: int) -> bytes:
        backward = self._speeds()[motor] < 0
        return struct.pack(">IB", self._encoders()[motor], 0b10 if backward else 0)

    def _speed_and_status(self, motor: int) -> bytes:
        speed = self._speeds()[motor]
        return struct.pack(">iB", speed, BACKWARD if speed < 0 else 0)

    def _everything(self) -> bytes:
        """Return the 56 bytes of command 73; no speed is ever set, so set points and errors are 0."""
        electrics = self._settings.electrics
        temperature, logic = _tenths(electrics.temperature), _tenths(electrics.logic_voltage)
        milliseconds = round(self._plant.time * 1000.0) & 0xFFFFFFFF
        return (
            struct.pack(">II", milliseconds, HEALTHY)
            + temperature * 2
            + _tenths(self._plant.battery_voltage())
            + logic
            + struct.pack(">hhhh", *self.duty, *self._currents())
            + struct.pack(">IIiiii", *self._encoders(), 0, 0, *self._speeds())
            + struct.pack(">HHHH", 0, 0, 0, 0)
        )


def checksum(data: bytes) -> int:
    """Return CRC-16/XMODEM: polynomial 0x1021, initial value 0, nothing reflected."""
    return binascii.crc_hqx(data, 0)


def _tenths(value: float) -> bytes:
    """Return a quantity in tenths of its unit as the device sends it: 16 bits, not below 0."""
    return struct.pack(">H", max(0, round(value * 10.0)))

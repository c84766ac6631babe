"""The device's side of the KVH 1725, 1750 and 1775 IMUs and the DSP-1760 gyro, data format A.

The z axis points up; the robot does not tilt. Source: KVH 1775 IMU technical manual 56-0298 Rev. B: messages in section
5, commands in sections 7 and 8, including which settings are kept in non-volatile memory.
"""

import math
import struct
import zlib

from robot_driver.emulator.device import Transmission, byte_time
from robot_driver.emulator.plant import Plant
from robot_driver.emulator.sensors import YawGyro
from robot_driver.emulator.settings import Settings

DATA_HEADER, SELF_TEST_HEADER = bytes.fromhex("FE81FF55"), bytes.fromhex("FE8100AA")
GYROS_VALID, ACCELEROMETERS_VALID = 0b0000_0111, 0b0111_0000
INVALID_AFTER_RATE_CHANGE = 2  # messages
TEMPERATURE = 25  # deg C
_FORMAT_A = struct.Struct(">6fBBh")  # what is between header and checksum
UPRIGHT = ",".join(f"{1.0 if number % 4 == 0 else 0.0:+.6E}" for number in range(9))
CHOICES = {
    "ROTFMT": ("RATE", "DELTA"),
    "ROTUNITS": ("RAD", "DEG"),
    "DR": ("1", "5", "10", "25", "50", "100", "250", "500", "750", "1000", "3600", "5000"),
    "MSYNC": ("IMU", "EXT"),
}


class KvhBinaryDevice:
    """A device bolted upright to the robot of `plant`, powered up at `time` (s).

    `kept` is the non-volatile memory: the settings, by the command that changes them. `writes` counts writes to it.
    With MSYNC EXT nothing is sent, since that input is not connected.
    """

    def __init__(self, settings: Settings, plant: Plant, time: float = 0.0) -> None:
        own = settings.kvh_binary
        self.kept = {
            "ROTFMT": "RATE" if own.sends_rate else "DELTA",
            "ROTUNITS": "DEG" if own.degrees else "RAD",
            "DR": str(own.rate),
            "MSYNC": "IMU",
            "AXES": UPRIGHT,
        }
        self.writes = 0
        self.byte_time = byte_time(own.baud)
        self._pace = 1.0 + own.clock_error
        self._valid_from = time + own.start_up
        self._gyro = YawGyro(settings, plant)
        self._powered_up = False
        self._configuring = False
        self._line = b""
        self._sequence = 0
        self._invalid_messages = 0
        self._period = 1.0 / own.rate  # nominal time between two messages (s)
        self.wake_time = time + self._period / self._pace

    def receive(self, data: bytes, time: float) -> list[Transmission]:
        """Process bytes, the last of which arrived at `time`; answer every completed command."""
        *lines, self._line = (self._line + data).replace(b"\r", b"\n").split(b"\n")
        sent = []
        for line in lines:
            reply = self._obey(line.decode("ascii", "replace").strip().upper())
            if reply:
                time += (len(reply) + 2) * self.byte_time
                sent.append(Transmission(time, reply.encode() + b"\r\n"))
        return sent

    def wake(self, time: float) -> list[Transmission]:
        """Sample, whether or not anything is to be sent; after power-up report the result of the self-test first."""
        self.wake_time += self._period / self._pace
        rate = self._gyro.rate(self._period / self._pace) / self._pace
        if self._configuring or self.kept["MSYNC"] == "EXT":
            return []
        data = self._message(rate, valid=time >= self._valid_from and self._invalid_messages == 0)
        self._invalid_messages = max(0, self._invalid_messages - 1)
        if not self._powered_up:
            self._powered_up = True
            data = self_test_message() + data
        return [Transmission(time + len(data) * self.byte_time, data)]

    def _message(self, rate: float, *, valid: bool) -> bytes:
        """Return a message of format A; `rate` is in rad/s."""
        z = math.degrees(rate) if self.kept["ROTUNITS"] == "DEG" else rate
        z *= 1.0 if self.kept["ROTFMT"] == "RATE" else self._period
        status = ACCELEROMETERS_VALID | (GYROS_VALID if valid else 0)
        data = DATA_HEADER + _FORMAT_A.pack(0.0, 0.0, z, 0.0, 0.0, 1.0, status, self._sequence, TEMPERATURE)
        self._sequence = (self._sequence + 1) % 128
        return data + checksum(data)

    def _obey(self, command: str) -> str:
        """Carry out one command; return the answer without its line end, "" if there is none."""
        if command == "=CONFIG,1":
            self._configuring = True
            return "CONFIG,1"
        if not self._configuring or not command:
            return ""
        if command == "=CONFIG,0":
            self._configuring = False
            return ""
        kind, (name, _, value) = command[0], command[1:].partition(",")
        if kind == "?" and name in self.kept and not value:
            return f"{name},{self.kept[name]}"
        if kind == "=" and value in CHOICES.get(name, ()):
            self._keep(name, value)
            return command[1:]
        return f"INVALID,{command}"

    def _keep(self, name: str, value: str) -> None:
        self.kept[name] = value
        self.writes += 1
        if name == "DR":
            self._period = 1.0 / int(value)
            self._invalid_messages = INVALID_AFTER_RATE_CHANGE


def self_test_message() -> bytes:
    """Return the result of a self-test that found nothing."""
    data = SELF_TEST_HEADER + b"\x7f" * 6
    return data + bytes([sum(data) & 0xFF])


def crc_mpeg2(data: bytes) -> int:
    """Return CRC-32/MPEG-2: polynomial 0x04C11DB7, initial value 0xFFFFFFFF, nothing reflected or inverted."""
    return int.from_bytes(checksum(data), "big")


def checksum(data: bytes) -> bytes:
    """Return CRC-32/MPEG-2 as it goes over the wire."""
    # The same polynomial as the CRC-32 of zlib, which reflects bytes and register and inverts the register.
    reflected = zlib.crc32(data.translate(_MIRRORED)) ^ 0xFFFFFFFF
    return reflected.to_bytes(4, "little").translate(_MIRRORED)


_MIRRORED = bytes(int(f"{byte:08b}"[::-1], 2) for byte in range(256))

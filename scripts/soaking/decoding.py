"""Decode the bytes of devices by the manufacturers' specifications, independently of the driver's code."""

import binascii
import math
import re
import struct
from collections.abc import Iterator
from typing import Any

ADDRESS = 0x80
ANSWERS = {24: ("battery", ">H"), 49: ("currents", ">hh"), 78: ("counts", ">II"), 82: ("temperature", ">H")}
UNITS = {"battery": 0.1, "currents": 0.01, "counts": 1, "temperature": 0.1}
LINE = re.compile(rb"[ \t]*(-?[0-9]+(?:\.[0-9]*)?)[ \t]+([01])[ \t]*\r?")  # of a DSP-3000, in deg/s, clockwise
MESSAGE = bytes.fromhex("FE81FF55")  # of a KVH with data format A


def decode_roboclaw(reply: bytes) -> Iterator[tuple[str, Any]]:
    """Yield (kind, values) of a reply; its CRC identifies the command that it answers."""
    for command, (kind, layout) in ANSWERS.items():
        length = struct.calcsize(layout)
        if len(reply) == length + 2:
            crc = binascii.crc_hqx(bytes((ADDRESS, command)) + reply[:length], 0)
            if crc == int.from_bytes(reply[length:], "big"):
                yield kind, tuple(value * UNITS[kind] for value in struct.unpack(layout, reply[:length]))


def decode_dsp3000(data: bytes) -> Iterator[tuple[str, Any]]:
    """Yield the readings in complete lines: ("rate", (yaw rate [rad/s], counter-clockwise, whether it is valid))."""
    for line in data.split(b"\n")[:-1]:
        match = LINE.fullmatch(line)
        if match is not None:
            yield "rate", (-math.radians(float(match[1])), match[2] == b"1")


def decode_kvh(data: bytes, period: float) -> Iterator[tuple[str, Any]]:
    """Yield the readings of a device that sends angles [rad] every `period` [s], z axis up."""
    for message in re.findall(re.escape(MESSAGE) + rb".{32}", data, re.DOTALL):
        (angle,) = struct.unpack_from(">f", message, 12)
        yield "rate", (angle / period, bool(message[28] & 0b100))

"""DSP-3000 lines: there is no checksum, so only what is a line to the last character may give a rate."""

import math
import re

from robot_driver.gyros.dsp3000 import LONGEST_LINE, SETTLING, Dsp3000
from robot_driver.gyros.gyro import GyroReading
from tests.robot_driver.any_bytes.script import Script, in_pieces
from tests.robot_driver.golden_vectors import DSP3000_LINE

STEADY = b"".join(b"%15.6f   1\r\n" % (0.01 * (number % 2)) for number in range(SETTLING))  # with a rate's scatter
RUNNING = b"\n" + STEADY  # so that the next line is believed
ENDS = (b"\r\n", b"\n")


def check(data: bytes) -> None:
    """Check what DSP-3000 lines promise."""
    script = Script(data)
    sizes = script.sizes()
    stream = script.one_of((b"", RUNNING)) + script.stream(_line)
    gyro, found = Dsp3000(), []
    for end, reading in in_pieces(gyro.feed, stream, sizes):
        _check_reading(stream, end - reading.bytes_since, reading)
        found.append(reading)
        assert gyro.next_request() in (b"", b"RRR")
    assert len(gyro._line) <= LONGEST_LINE
    assert list(map(repr, map(_without_arrival, found))) == list(
        map(repr, map(_without_arrival, Dsp3000().feed(stream)))
    )
    _check_recovery(gyro)


def _check_reading(stream: bytes, start: int, reading: GyroReading) -> None:
    assert stream[start - 1 : start] == b"\n"
    line = stream[start : stream.index(b"\n", start)]
    value, validity = re.split(rb"[ \t]+", line.strip(b" \t\r"))
    assert len(line) <= LONGEST_LINE
    assert set(line) <= set(b"0123456789-. \t\r")
    assert validity in (b"0", b"1")
    if reading.valid:
        assert validity == b"1"
        assert reading.yaw_rate == -math.radians(float(value))
        assert abs(float(value)) <= 500.0
    else:
        assert math.isnan(reading.yaw_rate)


def _check_recovery(gyro: Dsp3000) -> None:
    assert gyro.feed(b"\n" + DSP3000_LINE)[-1].bytes_since == len(DSP3000_LINE)
    readings = gyro.feed(STEADY)
    assert len(readings) == SETTLING
    assert readings[-1].valid


def _line(script: Script) -> bytes:
    millionths, blanks = script.numbers("<iB")
    return b"%*.6f   %d" % (blanks % 80, millionths / 1e6, script.number(2)) + script.one_of(ENDS)


def _without_arrival(reading: GyroReading) -> tuple[bool, float, int]:
    return reading.valid, reading.yaw_rate, reading.lost_before

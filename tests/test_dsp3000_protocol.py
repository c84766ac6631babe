"""DSP-3000 lines: read in pieces of any size, signed for our frame, and never believed when they make no sense."""

import math

import pytest

from robot_driver.gyros import GyroReading
from robot_driver.gyros.dsp3000 import SETTLING, Dsp3000
from tests.golden_vectors import DSP3000_LINE


def settled() -> Dsp3000:
    """Return the protocol of a gyro that has been running in rate mode for a while; a line is about to begin."""
    gyro = Dsp3000()
    gyro.feed(b"\n" + SETTLING * DSP3000_LINE)
    gyro.next_request()
    return gyro


def readings(stream: bytes) -> list[GyroReading]:
    """Return the readings of a stream that begins at the start of a line."""
    return settled().feed(stream)


@pytest.mark.parametrize(
    "line", [DSP3000_LINE, DSP3000_LINE.replace(b"\r", b""), b"0.015733 1\n", b"\t0.015733\t1 \r\n"]
)
def test_a_line_is_a_rate_counter_clockwise_positive(line: bytes) -> None:
    (reading,) = readings(line)
    assert reading.valid
    assert reading.yaw_rate == pytest.approx(-math.radians(0.015733), rel=1e-12)


def test_an_invalid_sample_has_no_rate() -> None:
    (reading,) = readings(b"     -12.345678   0\r\n")
    assert not reading.valid
    assert math.isnan(reading.yaw_rate)


@pytest.mark.parametrize(
    "line",
    [
        b"  1\r\n",
        b"\r\n",
        b"0.5 2\r\n",
        b"0.5 1 1\r\n",
        b"nan 1\r\n",
        b"inf 1\r\n",
        b"1e2 1\r\n",
        b"1_0.0 1\r\n",
        b"500.1 1\r\n",
        b"-500.1 1\r\n",
        b"0.5 1 \x00\r\n",
        b"0..5 1\r\n",
        b"- 5 1\r\n",
    ],
)
def test_what_makes_no_sense_is_no_reading(line: bytes) -> None:
    assert readings(line) == []
    assert len(readings(line + DSP3000_LINE)) == 1


def test_a_reading_tells_how_long_ago_it_began() -> None:
    first, second = readings(DSP3000_LINE + DSP3000_LINE + b"    ")
    assert (first.bytes_since, second.bytes_since) == (46, 25)


def test_15_a_gyro_that_may_have_been_off_is_put_back_into_its_mode_and_not_believed_until_then() -> None:
    gyro = Dsp3000()
    assert gyro.feed(b"\n") == []
    assert gyro.next_request() == b""
    in_another_mode = gyro.feed(SETTLING * DSP3000_LINE)
    assert gyro.next_request() == b"RRR"
    assert gyro.next_request() == b""
    assert not any(reading.valid or reading.yaw_rate == reading.yaw_rate for reading in in_another_mode)
    assert gyro.feed(DSP3000_LINE)[0].valid
    assert not gyro.feed(b"       0.015733   0\r\n")[0].valid  # as after a dip of its supply
    assert gyro.next_request() == b""
    assert not gyro.feed(DSP3000_LINE)[0].valid
    assert gyro.next_request() == b"RRR"


def test_the_mode_letter_is_sent_three_times() -> None:
    assert Dsp3000().wake_up == b"RRR"

"""DSP-3000 lines: read in pieces of any size, signed for our frame, and never believed when they make no sense."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robot_driver.gyros import GyroReading
from robot_driver.gyros.dsp3000 import SETTLING, Dsp3000

GOLDEN = b"       0.015733   1\r\n"


def settled() -> Dsp3000:
    """Return the protocol of a gyro that has been running in rate mode for a while; a line is about to begin."""
    gyro = Dsp3000()
    gyro.feed(b"\n" + SETTLING * GOLDEN)
    gyro.next_request()
    return gyro


def readings(stream: bytes) -> list[GyroReading]:
    """Return the readings of a stream that begins at the start of a line."""
    return settled().feed(stream)


@pytest.mark.parametrize("line", [GOLDEN, GOLDEN.replace(b"\r", b""), b"0.015733 1\n", b"\t0.015733\t1 \r\n"])
def test_a_line_is_a_rate_counter_clockwise_positive(line: bytes) -> None:
    (reading,) = readings(line)
    assert reading.valid
    assert reading.yaw_rate == pytest.approx(-math.radians(0.015733), rel=1e-12)


def test_the_rest_of_a_line_that_began_before_we_listened_is_dropped() -> None:
    gyro = Dsp3000()
    assert gyro.feed(b"0.015733   1\r\n") == []
    assert len(gyro.feed(GOLDEN)) == 1


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
    assert len(readings(line + GOLDEN)) == 1


def test_a_reading_tells_how_long_ago_it_began() -> None:
    first, second = readings(GOLDEN + GOLDEN + b"    ")
    assert (first.bytes_since, second.bytes_since) == (46, 25)


def test_15_a_gyro_that_may_have_been_off_is_put_back_into_its_mode_and_not_believed_until_then() -> None:
    gyro = Dsp3000()
    assert gyro.feed(b"\n") == []
    assert gyro.next_request() == b""
    in_another_mode = gyro.feed(SETTLING * GOLDEN)
    assert gyro.next_request() == b"RRR"
    assert gyro.next_request() == b""
    assert not any(reading.valid or reading.yaw_rate == reading.yaw_rate for reading in in_another_mode)
    assert gyro.feed(GOLDEN)[0].valid
    assert not gyro.feed(b"       0.015733   0\r\n")[0].valid  # as after a dip of its supply
    assert gyro.next_request() == b""
    assert not gyro.feed(GOLDEN)[0].valid
    assert gyro.next_request() == b"RRR"


def test_the_mode_letter_is_sent_three_times() -> None:
    assert Dsp3000().wake_up == b"RRR"


streams = st.lists(
    st.one_of(
        st.floats(-400, 400).map(lambda rate: f"{rate:15.6f}   1\r\n".encode()),
        st.floats(-400, 400).map(lambda rate: f"{rate:15.6f}   0\n".encode()),
        st.binary(max_size=100),
    ),
    max_size=20,
).map(b"".join)


@given(streams, st.lists(st.integers(1, 40), max_size=30))
def test_pieces_of_any_size_give_the_same_readings(stream: bytes, sizes: list[int]) -> None:
    # Lines longer than any real one are dropped at a point that depends on the pieces, so they are left out.
    stream = b"\n".join(line[:60] for line in stream.split(b"\n"))
    whole, gyro, in_pieces = Dsp3000().feed(stream), Dsp3000(), []
    for size in sizes:
        piece, stream = stream[:size], stream[size:]
        in_pieces += gyro.feed(piece)
    in_pieces += gyro.feed(stream)
    assert [repr(reading.yaw_rate) for reading in in_pieces] == [repr(reading.yaw_rate) for reading in whole]


@given(st.lists(st.binary(max_size=300), max_size=10))
def test_garbage_never_gives_a_bad_datum_nor_fills_the_memory(pieces: list[bytes]) -> None:
    gyro = Dsp3000()
    for piece in pieces:
        for reading in gyro.feed(piece):
            assert not reading.valid or abs(reading.yaw_rate) <= math.radians(500.0)
        assert len(gyro._line) <= 64

"""Whatever comes down a line, in pieces of any size: no parser fails, hangs, or makes a datum of it that is none."""

from collections.abc import Callable
from typing import TypeVar

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from robot_driver.controllers import BadReply
from robot_driver.controllers.roboclaw import RoboClaw
from robot_driver.gate.wire_roboclaw import crc
from robot_driver.gyros.dsp3000 import LONGEST_LINE, Dsp3000
from robot_driver.gyros.kvh_messages import Answer, Stream
from tests.robot_driver.any_bytes import CHECKS
from tests.robot_driver.golden_vectors import DSP3000_LINE

pytestmark = pytest.mark.slow

T = TypeVar("T")

ROBOTEQ_TELLS_ZERO = b"\3\1\0\0\0\0\0\1\1"  # for a duty that is not zero


@pytest.mark.parametrize("protocol", CHECKS)
@settings(max_examples=300)
@given(st.binary(min_size=60, max_size=300))
@example(ROBOTEQ_TELLS_ZERO)
def test_any_bytes_are_taken_for_what_they_are(protocol: str, script: bytes) -> None:
    CHECKS[protocol](script)


# What follows was found by these checks or by scripts/fuzz.


def byte_by_byte(feed: Callable[[bytes], list[T]], stream: bytes) -> list[T]:
    return [found for place in range(len(stream)) for found in feed(stream[place : place + 1])]


def test_a_line_longer_than_any_is_none_in_one_piece_and_in_many() -> None:
    stream = b"\n" + b" " * LONGEST_LINE + DSP3000_LINE
    assert Dsp3000().feed(stream) == byte_by_byte(Dsp3000().feed, stream) == []


def test_an_answer_with_noise_inside_is_none() -> None:
    assert Stream().feed(b"DR,1\xfe00\r\n" + bytes(40)) == []
    assert Stream().feed(b"DR,1000\r\n") == [Answer("DR", "1000")]


def test_an_answer_longer_than_any_counts_alike_in_one_piece_and_in_many() -> None:
    line = b"CONFIG,1" + b" " * 300 + b"\r\n"
    assert Stream().feed(line) == byte_by_byte(Stream().feed, line)


def test_a_version_without_an_end_is_none_even_with_a_right_checksum() -> None:
    data = b"x" * 48
    with pytest.raises(BadReply, match="no end"):
        RoboClaw().identify().parse(data + crc(bytes((0x80, 21)) + data).to_bytes(2, "big"))

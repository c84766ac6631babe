"""Long answers come in parts, and no client waits long for the next."""

from itertools import pairwise

import pytest

from robot_driver.emulator.robot_in_time import LONGEST_HOLD, StreamingAdapter


@pytest.mark.parametrize("size", [1, 2, 3, 29, 58, 100])
@pytest.mark.parametrize("baud", [2400, 9600, 38400, 115200])
def test_bytes_come_in_order_once_they_have_left_the_wire_and_soon(size: int, baud: int) -> None:
    data, byte_time = bytes(range(size)), 10 / baud
    begin, end = 5.0, 5.0 + size * byte_time
    pieces = StreamingAdapter().pieces(begin, end, data)
    assert b"".join(piece for _, piece in pieces) == data
    assert all(piece for _, piece in pieces)
    left = 0
    for moment, piece in pieces:
        left += len(piece)
        assert moment == pytest.approx(begin + left * byte_time)
    moments = [begin, *(moment for moment, _ in pieces)]
    assert max(later - earlier for earlier, later in pairwise(moments)) <= LONGEST_HOLD + byte_time
    assert pieces[-1][0] == end


@pytest.mark.parametrize("data", [b"", b"short"])
def test_what_takes_no_time_is_one_piece(data: bytes) -> None:
    assert StreamingAdapter().pieces(5.0, 5.0, data) == [(5.0, data)]

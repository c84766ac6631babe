"""What comes through the pipe of the last gate is a whole message that was meant, or it is refused."""

import os
import struct
from random import Random
from zlib import crc32

import pytest

from robot_driver.gate.messages import (
    MOST_DATA,
    REPORT_LENGTH,
    WORD_LENGTH,
    Kind,
    Malformed,
    Reason,
    Report,
    Word,
    packed_report,
    packed_word,
    report_in,
    word_in,
)

WORD = Word(Kind.WRITE, 7, 10**15, True, False, 0.25, -1.0, 10**15 + 5 * 10**8, b"\x80\x22")
REPORT = Report(7, True, False, True, 3, tuple(range(len(Reason))))


@pytest.mark.parametrize("data", [b"", b"\0\0", bytes(range(MOST_DATA))])
def test_a_message_says_what_it_was_given(data: bytes) -> None:
    word = WORD._replace(data=data)
    assert word_in(packed_word(word)) == word
    assert len(packed_word(word)) == WORD_LENGTH
    assert report_in(packed_report(REPORT)) == REPORT
    assert len(packed_report(REPORT)) == REPORT_LENGTH


def test_more_than_a_message_holds_is_not_packed() -> None:
    with pytest.raises(struct.error):
        packed_word(WORD._replace(data=bytes(MOST_DATA + 1)))


def test_whatever_bit_is_damaged_and_whatever_is_missing_or_too_much_is_refused() -> None:
    message = packed_word(WORD)
    damaged = [
        message[: bit // 8] + bytes((message[bit // 8] ^ 1 << bit % 8,)) + message[bit // 8 + 1 :]
        for bit in range(8 * len(message))
    ]
    for wrong in (*damaged, *(message[:end] for end in range(len(message))), message + b"\0"):
        with pytest.raises(Malformed):
            word_in(wrong)


def test_random_bytes_are_refused() -> None:
    chance = Random(1)
    for _ in range(5_000):
        with pytest.raises(Malformed):
            word_in(chance.randbytes(chance.choice((0, 1, WORD_LENGTH, WORD_LENGTH + 1))))
        with pytest.raises(Malformed):
            report_in(chance.randbytes(REPORT_LENGTH))
    with pytest.raises(Malformed):
        word_in(packed_report(REPORT) + os.urandom(WORD_LENGTH - REPORT_LENGTH))


@pytest.mark.parametrize(
    ("place", "value"),
    [(0, ord("X")), (4, len(Kind)), (5, 4), (6, MOST_DATA + 1), (44 + 1 + MOST_DATA, 1)],
    ids=["another kind of message", "unknown wish", "unknown flag", "too long", "something behind the data"],
)
def test_what_has_a_right_sum_but_says_what_cannot_be_is_refused(place: int, value: int) -> None:
    content = bytearray(packed_word(WORD)[:-4])
    content[min(place, len(content) - 1)] = value
    with pytest.raises(Malformed):
        word_in(bytes(content) + struct.pack("<I", crc32(content)))

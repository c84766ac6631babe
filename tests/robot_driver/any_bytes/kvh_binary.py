"""KVH binary messages and answers: whatever comes, a rate has a right CRC-32 and a device is only asked, never told."""

import math
import struct

from robot_driver.emulator.kvh_binary_device import CHOICES, UPRIGHT, crc_mpeg2, self_test_message
from robot_driver.gyros.kvh_binary import ENTER_CONFIGURATION, LEAVE_CONFIGURATION, QUERIES, KvhBinary
from robot_driver.gyros.kvh_messages import LONGEST_LINE, Answer, Sample, SelfTest, Stream
from tests.robot_driver.any_bytes.script import Script, in_pieces

# Header: length of the message, place of its status (bytes; self-tests have none). KVH manual, tables 5-1 to 5-12.
FORMATS = {b"\xfe\x81\xff\x55": (36, 28), b"\xfe\x81\xff\x56": (40, 32), b"\xfe\x81\xff\x57": (38, 32)}
LENGTHS = FORMATS | {b"\xfe\x81\x00\xaa": (11, 0), b"\xfe\x81\x00\xab": (13, 0)}
LONGEST = 40  # bytes
REQUESTS = {b"", ENTER_CONFIGURATION, LEAVE_CONFIGURATION, *(f"?{query}\r\n".encode() for query in QUERIES)}
VALUES = CHOICES | {"AXES": (UPRIGHT, "1,0,0,0,0.8,-0.6,0,0.6,0.8", "0,0,1,0,1,0,nan,inf,1e999")}

Said = Sample | SelfTest | Answer
Message = tuple[str, int, int] | str  # rates, status, sequence number; or that it is a self-test


def check(data: bytes) -> None:
    """Check what the parsers of messages and of the interview promise."""
    script = Script(data)
    sizes, settings = script.sizes(), {query: _value(script, query) for query in QUERIES}
    stream = script.stream(_whole) + TAIL
    said = list(in_pieces(Stream().feed, stream, sizes))
    messages = _messages(stream)
    assert [_of_message(one) for _, one in said if not isinstance(one, Answer)] == list(messages.values())
    assert [_of_message(one) for _, one in said] == [_of_message(one) for one in Stream().feed(stream)]
    assert said[-1][1] == Answer("CONFIG", "1")
    _check_places(stream, said, messages)
    gyro = _interviewed(settings)
    for end, reading in in_pieces(gyro.feed, stream, sizes):
        assert isinstance(messages[end - reading.bytes_since], tuple)
        assert reading.valid == (abs(reading.yaw_rate) <= math.radians(1000.0))
        assert gyro.next_request() in REQUESTS
    assert len(gyro._stream._waiting) <= LONGEST
    assert len(gyro._stream._line) <= LONGEST_LINE


def _messages(stream: bytes) -> dict[int, Message]:
    """Return the messages by where they begin; the first wins where two overlap."""
    found: dict[int, Message] = {}
    free = 0
    for start in range(len(stream)):
        header = stream[start : start + 4]
        length, status = LENGTHS.get(header, (0, 0))
        message = stream[start : start + length]
        if start < free or not length or not _is_sound(message):
            continue
        rates = struct.unpack_from(">fff", message.ljust(LONGEST), 4)
        found[start] = (repr(rates), message[status], message[status + 1]) if status else "self-test"
        free = start + length
    return found


def _is_sound(message: bytes) -> bool:
    if message[2]:
        return crc_mpeg2(message[:-4]) == int.from_bytes(message[-4:], "big")
    return sum(message[:-1]) % 256 == message[-1]


def _check_places(stream: bytes, said: list[tuple[int, Said]], messages: dict[int, Message]) -> None:
    for end, one in said:
        if isinstance(one, Sample):
            assert messages[end - one.bytes_since] == _of_message(one)
        if isinstance(one, Answer):
            answer = f"{one.name},{one.value}".encode()
            assert answer + b"\r" in stream or answer + b"\n" in stream


def _of_message(one: Said) -> Message | Answer:
    if isinstance(one, Sample):
        return repr(one.rotation), one.status, one.sequence
    return "self-test" if isinstance(one, SelfTest) else one


def _whole(script: Script) -> bytes:
    kind = script.number(5)
    if kind == 0:
        return self_test_message()
    if kind == 1:
        query = script.one_of(("CONFIG", "INVALID", *QUERIES))
        return f"{query},{_value(script, query)}\r\n".encode("latin-1")
    header = script.one_of(list(FORMATS))
    return _message(header, script.take(FORMATS[header][0] - 8))


def _message(header: bytes, payload: bytes) -> bytes:
    data = header + payload.ljust(FORMATS[header][0] - 8, b"\0")
    return data + crc_mpeg2(data).to_bytes(4, "big")


def _value(script: Script, query: str) -> str:
    """Return an answer that makes sense, or any."""
    if query in VALUES and script.number(8):
        return script.one_of(VALUES[query])
    return script.take(script.number(20)).decode("latin-1")


def _interviewed(settings: dict[str, str]) -> KvhBinary:
    gyro = KvhBinary()
    gyro.feed(b"CONFIG,1\r\n")
    for query in QUERIES * 2:
        gyro.feed(f"{query},{settings[query]}\r\n".encode("latin-1"))
        assert gyro.next_request() in REQUESTS
    return gyro


# What noise may reach into, and what must be found whatever came before it.
TAIL = 3 * _message(b"\xfe\x81\xff\x55", bytes(28)) + bytes(LONGEST) + b"\nCONFIG,1\r\n"

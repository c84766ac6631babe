"""RoboClaw packet serial: the bytes are those of the manual, and a damaged reply is never believed."""

import math
import struct
from binascii import crc_hqx
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from cmr.msg import motor_feedback_t
from robot_driver.controllers import BadReply, Request, Telemetry
from robot_driver.controllers.roboclaw import RoboClaw


def reply_to(command: int, data: bytes) -> bytes:
    """Return the reply a device sends: data, and the CRC over address, command and data."""
    return data + struct.pack(">H", crc_hqx(bytes((0x80, command)) + data, 0))


def telemetry(roboclaw: RoboClaw, command: int, data: bytes) -> Telemetry:
    for request in roboclaw.read_telemetry():
        if request.data[1] == command:
            return request.parse(reply_to(command, data))
    raise AssertionError(f"command {command} is not asked for")


def every_request() -> list[Request[Any]]:
    roboclaw = RoboClaw()
    return [
        roboclaw.identify(),
        *roboclaw.learn(),
        roboclaw.set_watchdog(0.5),
        roboclaw.read_watchdog(),
        roboclaw.drive(0.5, -0.5),
        roboclaw.read_encoders(),
        *roboclaw.read_telemetry(),
    ]


def test_full_duty_avoids_the_value_that_has_no_positive_twin() -> None:
    assert RoboClaw().drive(-1.0, 1.0).data[2:6] == struct.pack(">hh", -32767, 32767)


@pytest.mark.parametrize("duty", [1.01, -1.01])
def test_more_than_full_duty_is_never_sent(duty: float) -> None:
    with pytest.raises(ValueError, match="between -1 and 1"):
        RoboClaw().drive(duty, 0.0)


def test_the_answer_to_a_duty_is_the_duty_that_was_really_sent() -> None:
    sent = RoboClaw().drive(0.3, -0.7).parse(b"\xff")
    assert sent == (round(0.3 * 32767) / 32767, round(-0.7 * 32767) / 32767)


@given(st.binary(max_size=4).filter(lambda reply: reply != b"\xff"))
def test_only_ff_acknowledges(reply: bytes) -> None:
    with pytest.raises(BadReply):
        RoboClaw().drive(0.0, 0.0).parse(reply)


def test_version_ends_with_nul_and_crc() -> None:
    request = RoboClaw().identify()
    reply = reply_to(21, b"USB Roboclaw 2x15a v4.2.8\n\0")
    for length in range(len(reply)):
        assert request.missing(reply[:length]) > 0
    assert request.missing(reply) == 0
    assert request.parse(reply) == "USB Roboclaw 2x15a v4.2.8"


def test_version_without_an_end_is_given_up() -> None:
    request = RoboClaw().identify()
    reply = b""
    while missing := request.missing(reply):
        reply += b"x" * missing
    assert len(reply) <= 50
    with pytest.raises(BadReply):
        request.parse(reply)


@pytest.mark.parametrize("length", [1, 2, 4])
def test_the_status_format_of_the_firmware_is_learned_and_used(length: int) -> None:
    roboclaw = RoboClaw()
    (learn,) = roboclaw.learn()
    learn.parse(reply_to(90, bytes(length)))
    request = roboclaw.read_telemetry()[-1]
    assert request.longest_reply == length + 2
    assert request.parse(reply_to(90, bytes(length))) == {"status": 0}


def test_a_status_of_unknown_length_is_refused() -> None:
    (learn,) = RoboClaw().learn()
    with pytest.raises(BadReply, match="3 bytes"):
        learn.parse(reply_to(90, bytes(3)))


@pytest.mark.parametrize(
    ("word", "meaning"),
    [
        ("00000001", motor_feedback_t.STATUS_ESTOP),
        ("00000002", motor_feedback_t.STATUS_TEMPERATURE),
        ("00200000", motor_feedback_t.STATUS_TEMPERATURE),
        ("00080000", motor_feedback_t.STATUS_BATTERY),
        ("00000040", motor_feedback_t.STATUS_MOTOR_FAULT),
        ("00010001", motor_feedback_t.STATUS_MOTOR_FAULT | motor_feedback_t.STATUS_ESTOP),
        ("00400000", 0),
        ("0004", motor_feedback_t.STATUS_ESTOP),
        ("2000", motor_feedback_t.STATUS_TEMPERATURE),
        ("0800", motor_feedback_t.STATUS_BATTERY),
        ("0200", motor_feedback_t.STATUS_MOTOR_FAULT),
        ("8000", 0),
        ("04", motor_feedback_t.STATUS_ESTOP),
    ],
)
def test_status_bits_mean_what_the_manual_says(word: str, meaning: int) -> None:
    roboclaw = RoboClaw()
    roboclaw.learn()[0].parse(reply_to(90, bytes.fromhex(word)))
    assert telemetry(roboclaw, 90, bytes.fromhex(word)) == {"status": meaning}


def test_telemetry_is_in_volts_amperes_and_degrees() -> None:
    roboclaw = RoboClaw()
    assert telemetry(roboclaw, 49, struct.pack(">hh", 150, -25)) == {"currents": (1.5, -0.25)}
    assert telemetry(roboclaw, 82, struct.pack(">H", 315)) == {"temperature": 31.5}


def test_watchdog_is_in_tenths_of_a_second() -> None:
    assert math.isclose(RoboClaw().read_watchdog().parse(reply_to(15, b"\x05")), 0.5)


@given(st.sampled_from(every_request()), st.binary(max_size=60))
def test_garbage_is_refused_and_nothing_else_happens(request: Request[Any], garbage: bytes) -> None:
    request.missing(garbage)
    # One reply in 65536 of random garbage carries a right CRC by chance; hypothesis does not find it.
    if garbage == b"\xff":
        return
    with pytest.raises(BadReply):
        request.parse(garbage)


@given(st.integers(0, 2**32 - 1), st.integers(0, 2**32 - 1), st.integers(0, 79))
def test_no_single_flipped_bit_is_believed(first: int, second: int, bit: int) -> None:
    reply = bytearray(reply_to(78, struct.pack(">II", first, second)))
    assert RoboClaw().read_encoders().parse(bytes(reply)) == (first, second)
    reply[bit // 8] ^= 1 << bit % 8
    with pytest.raises(BadReply):
        RoboClaw().read_encoders().parse(bytes(reply))


def test_a_late_reply_to_another_command_is_refused() -> None:
    with pytest.raises(BadReply):
        RoboClaw().read_telemetry()[0].parse(reply_to(82, b"\x01\x3b"))

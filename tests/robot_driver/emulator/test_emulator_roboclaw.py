"""The emulated RoboClaw speaks packet serial byte for byte, and is silent where the real one is."""

import dataclasses
import math
import struct

import pytest

from robot_driver.emulator.plant import Plant
from robot_driver.emulator.roboclaw_device import RoboclawDevice, checksum
from robot_driver.emulator.settings import load_settings
from tests.robot_driver.emulated_device import answer, let_pass
from tests.robot_driver.golden_vectors import ROBOCLAW_DUTIES, ROBOCLAW_RESET_ENCODERS, ROBOCLAW_STOP, ROBOCLAW_TIMEOUT

pytestmark = pytest.mark.waits


def make_device(**roboclaw: int) -> tuple[RoboclawDevice, Plant]:
    settings = load_settings().ideal()
    settings = dataclasses.replace(settings, roboclaw=dataclasses.replace(settings.roboclaw, **roboclaw))
    plant = Plant(settings)
    return RoboclawDevice(settings, plant), plant


def read(device: RoboclawDevice, command: int, time: float = 1.0) -> bytes:
    """Return the data of an answer after a look at its CRC, which covers the request too."""
    request = bytes([0x80, command])
    reply = answer(device, request, time)
    assert int.from_bytes(reply[-2:], "big") == checksum(request + reply[:-2])
    return reply[:-2]


@pytest.mark.parametrize("position", range(8))
def test_a_damaged_request_is_met_with_silence_and_moves_nothing(position: int) -> None:
    device, _ = make_device()
    damaged = bytearray(ROBOCLAW_DUTIES)
    damaged[position] ^= 0x04
    assert answer(device, bytes(damaged)) == b""
    assert device.duty == [0, 0]
    assert answer(device, ROBOCLAW_DUTIES, 1.1) == b"\xff"


def test_an_unknown_command_and_another_units_address_are_met_with_silence_until_the_line_rests() -> None:
    device, _ = make_device()
    assert answer(device, b"\x80\xf0\x01\x02", 1.0) == b""
    assert answer(device, b"\x80\x18", 1.005) == b""  # still within the packet that was not understood
    assert answer(device, b"\x81\x18", 1.1) == b""
    assert answer(device, b"\x80\x18", 1.2) != b""


def test_a_packet_may_come_in_pieces_with_short_gaps_but_not_with_long_ones() -> None:
    device, _ = make_device()
    for index, byte in enumerate(ROBOCLAW_DUTIES[:-1]):
        assert answer(device, bytes([byte]), 1.0 + 0.009 * index) == b""
    assert answer(device, ROBOCLAW_DUTIES[-1:], 1.063) == b"\xff"
    assert answer(device, ROBOCLAW_STOP[:4], 2.0) == b""
    assert answer(device, ROBOCLAW_STOP[4:], 2.011) == b""
    assert device.duty == [8000, -8000]


def test_two_requests_at_once_get_two_answers_in_order() -> None:
    device, _ = make_device()
    replies = device.receive(ROBOCLAW_STOP + b"\x80\x2f", 1.0)
    assert [reply.data[:1] for reply in replies] == [b"\xff", b"\x80"]
    assert replies[0].time < replies[1].time


@pytest.mark.parametrize(("baud", "seconds"), [(115200, 60 / 115200), (38400, 60 / 38400), (0, 0.0)])
def test_an_answer_takes_its_time_on_the_wire(baud: int, seconds: float) -> None:
    device, _ = make_device(baud=baud)
    (reply,) = device.receive(b"\x80\x31", 1.0)
    assert len(reply.data) == 6
    assert reply.time == pytest.approx(1.0 + seconds)


def test_duty_of_one_motor_leaves_the_other_alone_and_motor_one_is_left() -> None:
    device, plant = make_device()
    for command, duty in ((32, 16000), (33, -500)):
        request = struct.pack(">BBh", 0x80, command, duty)
        assert answer(device, request + checksum(request).to_bytes(2, "big")) == b"\xff"
    assert read(device, 48) == struct.pack(">hh", 16000, -500)
    plant.advance(1.0)
    assert plant.left.velocity > 0.0 > plant.right.velocity


def test_every_reading_has_the_length_and_content_of_the_manual() -> None:
    device, plant = make_device()
    assert answer(device, ROBOCLAW_DUTIES, 0.5) == b"\xff"
    let_pass(device, plant, 3.5)
    speed = round(8000 / 32767 / 0.054 * 2048 / (2.0 * math.pi))
    counts = [math.floor(count) for count in plant.encoder_counts()]
    assert read(device, 21).endswith(b"\n\x00")
    assert struct.unpack(">ii", read(device, 78)) == tuple(counts)
    assert struct.unpack(">iB", read(device, 16)) == (counts[0], 0)
    assert struct.unpack(">iB", read(device, 17)) == (counts[1], 2)
    for left, right in ((18, 19), (30, 31)):
        assert struct.unpack(">iB", read(device, left)) == (pytest.approx(speed, abs=1), 0)
        assert struct.unpack(">iB", read(device, right)) == (pytest.approx(-speed, abs=1), 1)
    assert struct.unpack(">ii", read(device, 79)) == pytest.approx((speed, -speed), abs=1)
    assert struct.unpack(">ii", read(device, 108)) == pytest.approx((speed, -speed), abs=2)
    assert (read(device, 24), read(device, 25)) == (b"\x00\x7c", b"\x00\x32")
    assert struct.unpack(">hh", read(device, 49)) == pytest.approx((0, 0), abs=1)  # at speed, without friction
    assert read(device, 82) == read(device, 83) == struct.pack(">H", 315)
    assert read(device, 47) == b"\x80\x80"
    assert len(read(device, 73)) == 56


def test_a_starting_motor_draws_the_current_of_a_held_one() -> None:
    device, _ = make_device()
    answer(device, ROBOCLAW_DUTIES)
    expected = round(100 * 4.0 * 8000 / 32767)
    assert struct.unpack(">hh", read(device, 49)) == (expected, -expected)


@pytest.mark.parametrize("width", [1, 2, 4])
def test_the_status_has_the_width_of_the_firmware(width: int) -> None:
    assert read(make_device(status_bytes=width)[0], 90) == bytes(width)


def test_encoders_count_modulo_two_to_the_32_and_reset_to_zero() -> None:
    device, plant = make_device()
    answer(device, ROBOCLAW_DUTIES)
    plant.advance(1.0)
    right = math.floor(plant.encoder_counts()[1])
    assert struct.unpack(">II", read(device, 78))[1] == 2**32 + right
    assert answer(device, ROBOCLAW_RESET_ENCODERS) == b"\xff"
    assert read(device, 78) == bytes(8)
    plant.advance(1.1)
    assert 0 < struct.unpack(">II", read(device, 78))[0] < 1000


def test_the_watchdog_stops_the_motors_until_a_new_drive_command() -> None:
    device, plant = make_device()
    assert answer(device, ROBOCLAW_TIMEOUT, 1.0) == b"\xff"
    assert read(device, 15, 1.0) == b"\x05"
    answer(device, ROBOCLAW_DUTIES, 1.1)
    read(device, 24, 1.5)  # any byte feeds it
    let_pass(device, plant, 1.99)
    assert device.duty == [8000, -8000]
    let_pass(device, plant, 2.01)
    assert device.duty == [0, 0]
    let_pass(device, plant, 10.0)
    assert read(device, 48, 10.0) == bytes(4)  # bytes alone do not start them again
    assert plant.left.velocity == pytest.approx(0.0, abs=1e-6)
    answer(device, ROBOCLAW_DUTIES, 10.1)
    assert device.duty == [8000, -8000]


def test_without_a_timeout_the_motors_go_on() -> None:
    device, plant = make_device()
    answer(device, ROBOCLAW_DUTIES, 1.0)
    let_pass(device, plant, 60.0)
    assert device.duty == [8000, -8000]

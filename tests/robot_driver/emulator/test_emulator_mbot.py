"""The emulated MBot board talks while it is told the time, and stops when it is not, as the firmware does."""

import dataclasses
import math
import struct
from typing import Any

import pytest

from robot_driver.emulator.mbot_device import MBotDevice, frame
from robot_driver.emulator.plant import Plant
from robot_driver.emulator.settings import load_settings
from tests.robot_driver.emulated_device import said_until
from tests.robot_driver.golden_vectors import MBOT_DUTIES, MBOT_STOP, MBOT_TIME, MBOT_VELOCITY

pytestmark = pytest.mark.waits

PERIOD = 1.0 / 220.0


def make_device(**mbot: Any) -> tuple[MBotDevice, Plant]:
    settings = load_settings().ideal()
    plant = Plant(settings)
    return MBotDevice(dataclasses.replace(settings, mbot=dataclasses.replace(settings.mbot, **mbot)), plant), plant


def payload(said: bytes, topic: int, layout: str) -> tuple[Any, ...]:
    """Return the numbers of one topic; the frame is where its header is."""
    size = struct.calcsize(layout)
    header = struct.pack("<HB", size, 255 - size) + struct.pack("<H", topic)
    return struct.unpack_from(layout, said, said.index(b"\xff\xfe" + header) + 7)


def test_it_says_nothing_before_it_is_told_the_time_and_everything_after() -> None:
    device, plant = make_device()
    assert said_until(device, plant, 0.1) == []
    assert device.receive(MBOT_TIME, 0.1) == []
    (said,) = said_until(device, plant, 0.1 + PERIOD)
    assert len(said) == 8 * 7 + 4 * 20 + 76 + 48 + 32
    assert payload(said, 233, "<q3f")[0] == pytest.approx(7, abs=PERIOD * 1e6)


def test_commands_in_pieces_drive_the_wheels_of_which_the_right_one_is_mirrored() -> None:
    device, plant = make_device()
    for byte in b"\xff\xfe\x00" + MBOT_DUTIES + MBOT_TIME:
        device.receive(bytes((byte,)), 0.0)
    said = said_until(device, plant, 0.9)[-1]
    assert payload(said, 233, "<q3f")[1:] == (0.5, -0.25, 0.0)
    left, right = plant.encoder_counts()
    counts = payload(said, 221, "<q3q3ii")[1:3]
    assert counts == (pytest.approx(left, abs=50), pytest.approx(-right, abs=50))
    assert 0 < right < left
    assert payload(said, 220, "<q17f")[3] < 0.0  # to the right
    assert payload(said, 223, "<q4h4f")[-1] == pytest.approx(12.4, abs=0.5)


def test_a_damaged_command_is_not_carried_out() -> None:
    device, plant = make_device()
    device.receive(MBOT_DUTIES[:-1] + b"\x96" + MBOT_TIME, 0.0)
    said_until(device, plant, 0.1)
    assert device.duty == (0.0, 0.0)


def test_it_stops_a_second_after_the_time_and_goes_on_with_the_last_duties_when_told_it_again() -> None:
    device, plant = make_device()
    device.receive(MBOT_DUTIES + MBOT_TIME, 0.0)
    talked = len(said_until(device, plant, 3.0)) * PERIOD
    assert talked == pytest.approx(1.0, abs=2 * PERIOD)
    assert device.duty == (0.0, 0.0)
    device.receive(MBOT_TIME, 3.0)
    said_until(device, plant, 3.1)
    assert device.duty == (0.5, -0.25)
    device.receive(MBOT_STOP, 3.1)
    said_until(device, plant, 3.2)
    assert device.duty == (0.0, 0.0)


def test_it_can_be_one_without_a_watchdog() -> None:
    device, plant = make_device(ignores_watchdog=True)
    device.receive(MBOT_DUTIES + MBOT_TIME, 0.0)
    said_until(device, plant, 3.0)
    assert device.duty == (0.5, -0.25)


def told(device: MBotDevice, plant: Plant, until: float, *frames: bytes) -> bytes:
    """Send frames now, and the time often enough until then (s); return what is said last."""
    said = [b""]
    device.receive(b"".join(frames), plant.time)
    while plant.time < until:
        device.receive(MBOT_TIME, plant.time)
        said = said_until(device, plant, min(until, plant.time + 0.5)) or said
    return said[-1]


def wheel_speeds(left: float, right: float) -> bytes:
    return frame(231, struct.pack("<q3f", 7, left, right, 0.0))


def test_velocities_that_the_boards_own_daemon_sends_turn_the_robot() -> None:
    device, plant = make_device()
    said = told(device, plant, 2.0, MBOT_VELOCITY)
    assert payload(said, 234, "<q3f")[1:] == pytest.approx((0.5, 0.0, -0.25), rel=0.01)
    left, right = plant.left.velocity, plant.right.velocity
    assert 0.04 * (left + right) / 2.0 == pytest.approx(0.5, rel=0.01)
    assert 0.04 * (right - left) / 0.161 == pytest.approx(-0.25, rel=0.01)


def test_wheel_speeds_are_driven_by_the_calibration_and_the_right_one_is_mirrored() -> None:
    device, plant = make_device()
    said = told(device, plant, 2.0, wheel_speeds(10.0, -5.0))
    assert payload(said, 233, "<q3f")[1:] == pytest.approx((0.54, -0.27, 0.0), rel=1e-6)
    assert payload(said, 232, "<q3f")[1:] == pytest.approx((10.0, -5.0, 0.0), rel=0.01)
    assert (plant.left.velocity, plant.right.velocity) == pytest.approx((10.0, 5.0), rel=0.01)
    said = told(device, plant, 4.0, wheel_speeds(0.0, 0.0))
    assert payload(said, 232, "<q3f")[1:] == pytest.approx((0.0, 0.0, 0.0), abs=0.01)


def test_the_calibration_knows_the_friction() -> None:
    settings = load_settings()
    plant = Plant(settings)
    device = MBotDevice(settings, plant)
    told(device, plant, 0.1, wheel_speeds(2.0, 2.0))
    assert device.duty == pytest.approx((0.108 + 0.4 / 118.0, 0.108 + 0.4 / 118.0))


@pytest.mark.parametrize(
    ("speeds", "duty"), [((1e30, -1e30), 0.995), ((3.4e38, -3.4e38), 0.995), ((40.0, -40.0), 0.995)]
)
def test_more_than_the_motors_can_do_is_all_that_the_firmware_gives_them(
    speeds: tuple[float, float], duty: float
) -> None:
    device, plant = make_device()
    told(device, plant, 0.5, wheel_speeds(*speeds))
    assert (plant.left.duty, plant.right.duty) == (duty, duty)


@pytest.mark.parametrize("topic", [214, 230, 231])
def test_numbers_that_are_none_drive_nothing_and_harm_nothing(topic: int) -> None:
    device, plant = make_device()
    told(device, plant, 0.5, frame(topic, struct.pack("<q3f", 7, math.nan, math.nan, math.inf)))
    told(device, plant, 1.0, MBOT_STOP)
    assert (plant.left.velocity, plant.right.velocity) == (0.0, 0.0)


def test_firmware_with_crossed_functions_takes_speeds_for_duties_too() -> None:
    device, plant = make_device(takes_velocities=True)
    told(device, plant, 0.1, wheel_speeds(0.5, -0.25))
    assert device.duty == (0.5, -0.25)


def test_encoders_go_on_from_what_they_are_set_to_and_steps_do_not_see_it() -> None:
    device, plant = make_device()
    told(device, plant, 1.0, wheel_speeds(3.0, -3.0))
    before = plant.encoder_counts()
    reset = frame(222, struct.pack("<q3q3ii", 7, 1000, -(2**40), 5, 0, 0, 0, 0))
    counts = payload(told(device, plant, 1.2, reset), 221, "<q3q3ii")
    turned = [math.floor(now) - math.floor(then) for now, then in zip(plant.encoder_counts(), before, strict=True)]
    assert counts[1:4] == (pytest.approx(1000 + turned[0], abs=20), pytest.approx(-(2**40) - turned[1], abs=20), 0)
    assert 0 < counts[4] < 20
    assert -20 < counts[5] < 0


def test_odometry_is_by_the_wheels_and_goes_on_from_what_it_is_set_to() -> None:
    device, plant = make_device()
    reset = frame(211, struct.pack("<q3f", 7, 1.0, 2.0, math.pi / 2))
    velocity = frame(214, struct.pack("<q3f", 7, 0.2, 0.0, 0.0))
    x, y, theta = payload(told(device, plant, 2.0, reset, velocity), 210, "<q3f")[1:]
    way = math.hypot(plant.x, plant.y)
    assert (x, y, theta) == (
        pytest.approx(1.0, abs=0.02),
        pytest.approx(2.0 + way, abs=0.02),
        pytest.approx(math.pi / 2, abs=0.05),
    )
    assert way > 0.3
    nowhere = frame(211, struct.pack("<q3f", 7, 0.0, 0.0, math.inf))
    assert payload(told(device, plant, 2.1, nowhere), 210, "<q3f")[3] == math.inf


def test_topics_that_it_does_not_take_and_damaged_frames_are_counted() -> None:
    device, plant = make_device()
    device.receive(frame(999, b"12345678") + frame(220, bytes(76)) + frame(214, b"short") + MBOT_STOP[:-1] + b"\0", 0.0)
    told(device, plant, 0.1)
    assert device.not_understood == {"unknown topic": 1, "topic 220": 1, "topic 214": 1, "wrong checksum": 1}


def test_a_time_beyond_all_and_noise_without_end_harm_nothing() -> None:
    device, plant = make_device()
    for utime in (2**63 - 1, -(2**63)):
        device.receive(frame(201, struct.pack("<q", utime)), plant.time)
        assert len(said_until(device, plant, plant.time + 0.1)) > 10
    device.receive(b"\xff" * 100000, plant.time)
    assert len(device._waiting) <= 1

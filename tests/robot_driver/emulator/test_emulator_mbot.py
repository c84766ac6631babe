"""The emulated MBot board talks while it is told the time, and stops when it is not, as the firmware does."""

import dataclasses
import struct
from typing import Any

import pytest

from robot_driver.emulator.mbot_device import MBotDevice
from robot_driver.emulator.plant import Plant
from robot_driver.emulator.settings import load_settings
from tests.robot_driver.emulated_device import said_until
from tests.robot_driver.golden_vectors import MBOT_DUTIES, MBOT_STOP, MBOT_TIME

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

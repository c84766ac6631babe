"""The emulated Roboteq speaks its text protocol as the manual has it, and has the traps of the real one."""

import dataclasses
import math
from typing import Any

import pytest

from robot_driver.emulator.plant import Plant
from robot_driver.emulator.roboteq_device import RoboteqDevice
from robot_driver.emulator.settings import load_settings
from tests.robot_driver.emulated_device import answer, let_pass

pytestmark = pytest.mark.waits


def make_device(**roboteq: Any) -> tuple[RoboteqDevice, Plant]:
    settings = load_settings().ideal()
    settings = dataclasses.replace(
        settings,
        electrics=dataclasses.replace(settings.electrics, battery_voltage=24.6),
        roboteq=dataclasses.replace(settings.roboteq, **({"echo": False} | roboteq)),
    )
    plant = Plant(settings)
    return RoboteqDevice(settings, plant), plant


@pytest.mark.parametrize(
    ("line", "reply"),
    [
        (b"?FID\r", b"FID=Roboteq v1.6 SDC2160 05/01/2016\r"),
        (b"?V\r", b"V=135:246:4730\r"),
        (b"?C\r", b"C=0:0\r"),
        (b"?C 2\r", b"C=0\r"),
        (b"?FF_", b"FF=0\r"),
        (b"?FM 1\r", b"FM=0\r"),
        (b"?T\r", b"T=32:32:32\r"),
        (b"!M 500 -500\r", b"+\r"),
        (b"!G 1 700\r", b"+\r"),
        (b"~RWD\r", b"RWD=1000\r"),
        (b"~MMOD 1\r", b"MMOD=0\r"),
        (b"?NIX\r", b"-\r"),
        (b"!M 500\r", b"-\r"),
        (b"!M a b\r", b"-\r"),
        (b"^RWD 65001\r", b"-\r"),
        (b"^RWD\r", b"-\r"),
        (b"!\r", b"-\r"),
        (b"\r", b""),
        (b"\xff\r", b"-\r"),
        (b"?C 3\r", b"-\r"),
    ],
)
def test_every_line_is_answered_as_in_the_manual(line: bytes, reply: bytes) -> None:
    assert answer(make_device()[0], line) == reply


def test_it_echoes_until_it_is_told_not_to_and_again_after_power_off() -> None:
    device, _ = make_device(echo=True)
    assert answer(device, b"!M 0 0\r") == b"!M 0 0\r+\r"
    assert answer(device, b"^ECHOF 1\r") == b"^ECHOF 1\r+\r"
    assert answer(device, b"?FF\r") == b"FF=0\r"
    device.switch_on()
    assert answer(device, b"?FF\r") == b"?FF\rFF=0\r"


def test_a_line_may_come_in_pieces_and_several_at_once() -> None:
    device, _ = make_device()
    assert answer(device, b"!M 5") == b""
    assert answer(device, b"0 0\r?FF\r?FM\r") == b"+\rFF=0\rFM=0:0\r"
    assert device.duty == [50, 0]


def test_an_answer_takes_its_time_on_the_wire() -> None:
    device, _ = make_device()
    (reply,) = device.receive(b"?C\r", 1.0)
    assert reply.time == pytest.approx(1.0 + 60 / 115200)


def test_motor_one_is_left_and_forward_is_positive() -> None:
    device, plant = make_device()
    answer(device, b"!M 500 -250\r", 0.0)
    plant.advance(0.9)
    counts = [math.floor(count) for count in plant.encoder_counts()]
    assert counts[0] > 0 > counts[1]
    assert answer(device, b"?C\r", 0.9) == b"C=%d:%d\r" % tuple(counts)


def test_counts_wrap_as_signed_numbers_of_32_bits() -> None:
    device, _ = make_device()
    answer(device, b"!C 1 2147483647\r!C 2 -2147483648\r")
    assert answer(device, b"?C\r") == b"C=2147483647:-2147483648\r"
    device._encoder_zero[0] -= 1
    assert answer(device, b"?C 1\r") == b"C=-2147483648\r"


def test_only_actions_feed_the_watchdog() -> None:
    device, plant = make_device(watchdog=500)
    answer(device, b"!M 300 300\r", 1.0)
    answer(device, b"?C\r^ECHOF 1\r", 1.4)
    let_pass(device, plant, 1.49)
    assert device.duty == [300, 300]
    let_pass(device, plant, 1.51)
    assert device.duty == [0, 0]


def test_after_the_watchdog_any_action_has_the_other_channel_go_on_as_before() -> None:
    device, plant = make_device(watchdog=500)
    answer(device, b"!M 300 300\r", 1.0)
    let_pass(device, plant, 2.0)
    answer(device, b"!G 1 0\r", 2.0)
    assert device.duty == [0, 300]


def test_without_a_watchdog_the_motors_go_on() -> None:
    device, plant = make_device(watchdog=0)
    answer(device, b"!M 300 300\r", 1.0)
    let_pass(device, plant, 60.0)
    assert device.duty == [300, 300]


def test_the_emergency_stop_holds_until_it_is_released() -> None:
    device, _ = make_device()
    answer(device, b"!M 300 300\r!EX\r!M 300 300\r")
    assert device.duty == [0, 0]
    assert answer(device, b"?FF\r") == b"FF=16\r"
    answer(device, b"!MG\r!M 200 200\r")
    assert device.duty == [200, 200]


def test_writing_to_the_flash_is_counted() -> None:
    device, _ = make_device()
    assert answer(device, b"%EESAV\r!EES\r") == b"+\r+\r"
    assert device.saves == 2


def test_a_device_may_ignore_the_watchdogs_setting() -> None:
    device, _ = make_device(ignores_watchdog=True)
    assert answer(device, b"^RWD 500\r~RWD\r") == b"+\rRWD=1000\r"

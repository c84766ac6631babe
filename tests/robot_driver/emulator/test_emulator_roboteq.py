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
        (b"?ff\r", b"FF=0\r"),  # small letters
        (b"!m 500 -500\r", b"+\r"),
        (b"\n?FF\t\r", b"FF=0\r"),  # characters below a space have no effect
        (b"!M 300 300 +\r", b"+\r"),  # as PyRoboteq writes it
        (b"?V [2]+\r", b"V=246\r"),
        (b"?V []+\r", b"V=135:246:4730\r"),
        (b"?FID []+\r", b"FID=Roboteq v1.6 SDC2160 05/01/2016\r"),
        (b"!MS 1\r", b"+\r"),
        (b"!S 1 100\r", b"+\r"),
        (b"!AC 1 2000\r", b"+\r"),
        (b"!DC 2 20000\r", b"+\r"),
        (b"?S\r", b"S=0:0\r"),
        (b"?SR 2\r", b"SR=0\r"),
        (b"?CR\r", b"CR=0:0\r"),
        (b"?BA\r", b"BA=0:0\r"),
        (b"~MXRPM 1\r", b"MXRPM=177\r"),
        (b"~KP\r", b"KP=20:20\r"),
        (b"^MMOD 1 3\r", b"-\r"),  # a mode that is not emulated
        (b"^MMOD 3 1\r", b"-\r"),
        (b"^MMOD 0 1\r", b"-\r"),
        (b"!S 3 100\r", b"-\r"),
        (b"!G 0 100\r", b"-\r"),
        (b"^MXPF 1 101\r", b"-\r"),
        (b"%RESET 1\r", b"-\r"),
        (b"&1\r", b"-\r"),
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


def test_what_is_refused_is_counted() -> None:
    device, _ = make_device()
    answer(device, b"?NIX\r?NIX 1\r!M a b\r?C\r")
    assert device.not_understood == {"?NIX": 2, "!M": 1}


def speeds_of(device: RoboteqDevice, time: float) -> list[int]:
    return [int(speed) for speed in answer(device, b"?S\r", time)[2:-1].split(b":")]


@pytest.mark.parametrize("mode", [b"1", b"6"])
def test_in_closed_loop_a_channel_keeps_the_speed_in_rpm_or_its_share_of_the_largest(mode: bytes) -> None:
    device, plant = make_device(watchdog=0)
    answer(device, b"^MMOD 1 %b\r^MMOD 2 %b\r!S 1 60\r!G 2 -500\r" % (mode, mode), 0.0)
    let_pass(device, plant, 2.0)
    assert speeds_of(device, 2.0) == pytest.approx((60, -0.5 * 177), abs=1)
    assert plant.left.velocity == pytest.approx(2.0 * math.pi, rel=0.01)  # 60 turns a minute
    counted = [int(count) for count in answer(device, b"?CR\r", 2.0)[3:-1].split(b":")]
    assert counted == [math.floor(count) for count in plant.encoder_counts()]
    let_pass(device, plant, 3.0)
    counted = [int(count) for count in answer(device, b"?CR\r", 3.0)[3:-1].split(b":")]
    assert counted == pytest.approx((2048, -2048 * 0.5 * 177 / 60), rel=0.01)
    assert answer(device, b"?SR\r", 3.0) == b"SR=339:-500\r"
    answer(device, b"!M 0 0\r", 3.0)
    let_pass(device, plant, 5.0)
    assert speeds_of(device, 5.0) == [0, 0]


def test_in_open_loop_a_speed_is_a_share_of_the_power() -> None:
    device, _ = make_device()
    answer(device, b"^MXRPM 1 1000\r!S 1 250\r!S 2 -1000\r")
    assert device.duty == [250, -1000]


def test_a_speed_that_the_motor_cannot_do_is_all_it_can_and_the_watchdog_stops_it() -> None:
    device, plant = make_device(watchdog=1500)
    answer(device, b"^MMOD 1 1\r^MXRPM 1 1000\r!S 1 5000\r", 0.0)
    let_pass(device, plant, 1.49)
    assert device.duty == [1000, 0]
    assert speeds_of(device, 1.49) == [pytest.approx(177, abs=1), 0]
    let_pass(device, plant, 1.51)
    assert device.duty == [0, 0]
    let_pass(device, plant, 4.0)
    assert speeds_of(device, 4.0) == [0, 0]


def test_ramps_of_the_manual() -> None:
    """With a largest speed of 1000 rpm, 20000 takes half a second to full power; a ramp of 0 is none."""
    device, plant = make_device(watchdog=0)
    answer(device, b"!AC 2 20000\r!M 1000 1000\r", 0.0)
    assert device.duty == [1000, 1000]
    answer(device, b"!M 0 0\r^MXRPM 2 1000\r^MAC 2 1\r^MDEC 2 10000\r!AC 2 20000\r!M 0 1000\r", 0.0)
    let_pass(device, plant, 0.25)
    assert device.duty == [0, pytest.approx(500, abs=10)]
    let_pass(device, plant, 0.51)
    assert device.duty == [0, 1000]
    answer(device, b"!M 0 0\r", 1.0)
    let_pass(device, plant, 1.5)
    assert device.duty == [0, pytest.approx(500, abs=10)]
    answer(device, b"!EX\r", 1.5)
    assert device.duty == [0, 0]


def test_powers_are_limited_each_way() -> None:
    device, plant = make_device()
    answer(device, b"^MXPF 1 40\r^MXPR 2 30\r!M 1000 -1000\r")
    assert device.duty == [400, -300]
    assert answer(device, b"?P\r?M\r") == b"P=400:-300\rM=1000:-1000\r"
    plant.advance(1.01)
    assert plant.left.duty == 0.4


def test_settings_that_were_changed_are_as_before_after_power_off() -> None:
    device, _ = make_device()
    answer(device, b"^MMOD 1 1\r^KP 2 35\r")
    assert answer(device, b"~MMOD\r~KP\r") == b"MMOD=1:0\rKP=20:35\r"
    device.switch_on()
    assert answer(device, b"~MMOD\r~KP\r") == b"MMOD=0:0\rKP=20:20\r"

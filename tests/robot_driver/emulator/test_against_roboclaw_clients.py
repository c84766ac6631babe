"""Clients of RoboClaws that nobody here wrote drive the emulated robot, and read and set all that firmware 4.2 has.

`tcr-roboclaw` is the maker's older library: it writes each packet byte by byte, at most 10 ms between two bytes of an
answer. `roboclaw` writes whole packets, and drives by the commands of one byte. What both have is what `basicmicro`,
the maker's newer library in `test_against_basicmicro`, no longer has. What `roboclaw` computes checksums with is no
longer in the package that it names; a function of Python's is in its place.
"""

import binascii
import math
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any
from unittest.mock import patch

import pytest
from tcr_roboclaw import Roboclaw

from robot_driver.emulator.plant import Plant
from robot_driver.emulator.roboclaw_device import RoboclawDevice
from tests.robot_driver.emulator.served import emulated, served
from tests.support.driver_bench import wait_for

pytestmark = pytest.mark.waits

RETRIES = 5
PATIENCE = 1.0  # s; a busy machine looks away
SLOW = 38400  # bit/s, the factory setting
QPPS = round(2048 / (2.0 * math.pi * 0.054))


@contextmanager
def older_client(folder: Path, baud: int = SLOW) -> Iterator[tuple[Any, RoboclawDevice, Plant]]:
    settings, plant = emulated("roboclaw", baud=baud)
    device = RoboclawDevice(settings, plant)
    with served(folder, device, plant) as port:
        client = Roboclaw(port, baud, retries=RETRIES)
        client.open()
        yield client, device, plant
        client._port.close()


@contextmanager
def another_client(folder: Path) -> Iterator[tuple[Any, RoboclawDevice]]:
    """Serve `roboclaw`, which knows the status of the oldest firmware only."""
    checksums = ModuleType("PyCRC.CRCCCITT")
    checksums.CRCCCITT = lambda: SimpleNamespace(calculate=lambda data: binascii.crc_hqx(data, 0))  # type: ignore[attr-defined]
    with patch.dict(sys.modules, {"PyCRC": ModuleType("PyCRC"), "PyCRC.CRCCCITT": checksums}):
        from roboclaw.roboclaw import RoboClaw
    settings, plant = emulated("roboclaw", status_bytes=1)
    device = RoboclawDevice(settings, plant)
    with served(folder, device, plant) as port:
        client = RoboClaw(port, 0x80)
        client.port.timeout = PATIENCE
        yield client, device
        client.port.close()


def near(*speeds: float) -> Any:
    return pytest.approx(list(speeds), abs=0.02 * QPPS)


def signed(number: int) -> int:
    return (number + 2**31) % 2**32 - 2**31


def speeds_of(client: Any) -> list[int]:
    said, *speeds = client.GetISpeedCounters()
    assert said == 1
    return [signed(speed) for speed in speeds]


@pytest.mark.parametrize(
    ("call", "arguments", "speeds"),
    [
        ("SpeedM1M2", (2000, -1000), (2000, -1000)),
        ("SpeedAccelM1M2", (20000, -2000, 1000), (-2000, 1000)),
        ("IndepSpeedAccelM1M2", (20000, 1500, 10000, 1500), (1500, 1500)),
        ("DutyM1M2", (16384, -16384), (QPPS / 2, -QPPS / 2)),
        ("DutyAccelM1M2", (100000, 16384, 50000, 8192), (QPPS / 2, QPPS / 4)),
        ("ForwardM1", (64,), (QPPS * 64 / 127, 0)),
        ("BackwardM2", (127,), (0, -QPPS)),
        ("ForwardBackwardM1", (32,), (-QPPS / 2, 0)),
    ],
)
def test_the_wheels_turn_as_the_older_client_commands(
    tmp_path: Path, call: str, arguments: tuple[int, ...], speeds: tuple[float, float]
) -> None:
    with older_client(tmp_path) as (client, _, plant):
        assert getattr(client, call)(*arguments)
        wait_for(lambda: speeds_of(client) == near(*speeds))
        _, *before = client.GetEncoderCounters()
        began = plant.time
        wait_for(lambda: plant.time > began + 0.5)
        _, *after = client.GetEncoderCounters()
        seconds = plant.time - began
        counted = [signed(new - old) for new, old in zip(after, before, strict=True)]
        assert counted == pytest.approx([seconds * speed for speed in speeds], rel=0.1, abs=50)


def test_the_older_client_mixes(tmp_path: Path) -> None:
    with older_client(tmp_path) as (client, device, _):
        assert client.MixedForward(64)
        assert device.duty == [0, 0]
        assert client.MixedTurnLeft(64)
        assert device.duty == [0, pytest.approx(32767, rel=0.01)]
        assert client.MixedForwardBackward(64)
        assert client.MixedLeftRight(127)
        assert device.duty == [32767, -32767]


def test_every_reading_of_the_older_client_comes_at_38400_baud(tmp_path: Path) -> None:
    with older_client(tmp_path) as (client, _, _):
        assert client.ReadVersion() == (1, "USB Roboclaw 2x15a v4.2.8\n")
        assert client.SetEncM1(123456)
        assert client.SetEncM2(2**32 - 9)
        assert client.GetEncoderCounters() == [1, 123456, 2**32 - 9]
        assert client.ReadEncM1() == (1, 123456, 0)
        assert client.ReadSpeedM2() == client.ReadISpeedM1() == (1, 0, 0)
        assert client.ReadMainBatteryVoltage() == (1, 124)
        assert client.ReadLogicBatteryVoltage() == (1, 50)
        assert client.ReadTemp() == client.ReadTemp2() == (1, 315)
        assert client.ReadError() == (1, 0)
        assert client.ReadBufferLengths() == (1, 0x80, 0x80)
        assert client.ReadPWMs() == client.ReadCurrents() == (1, 0, 0)
        assert client.GetMotorAverageSpeeds() == client.GetSpeedErrors() == client.GetPositionErrors() == [1, 0, 0]
        assert client.SetSerialTimeout(5)
        assert client.ReadSerialTimeout() == (1, 5)


# What is set, and what it is read by; the client divides and multiplies constants itself.
SET_AND_READ: list[tuple[str, tuple[float, ...], str, tuple[float, ...]]] = [
    ("SetMinVoltageMainBattery", (10,), "ReadMinMaxMainVoltages", (80, 340)),
    ("SetMaxVoltageMainBattery", (82,), "ReadMinMaxMainVoltages", (60, 160)),
    ("SetMainVoltages", (110, 140), "ReadMinMaxMainVoltages", (110, 140)),
    ("SetMinVoltageLogicBattery", (10,), "ReadMinMaxLogicVoltages", (80, 340)),
    ("SetLogicVoltages", (55, 65), "ReadMinMaxLogicVoltages", (55, 65)),
    ("SetM1VelocityPID", (1.5, 0.5, 0.25, 44000), "ReadM1VelocityPID", (1.5, 0.5, 0.25, 44000)),
    ("SetM2VelocityPID", (2.5, 1.5, 0.0, 12000), "ReadM2VelocityPID", (2.5, 1.5, 0.0, 12000)),
    ("SetM1PositionPID", (2.0, 1.0, 0.5, 10, 3, 0, 9000), "ReadM1PositionPID", (2.0, 1.0, 0.5, 10, 3, 0, 9000)),
    ("SetM2PositionPID", (2.0, 1.0, 0.5, 10, 3, 0, 9000), "ReadM2PositionPID", (2.0, 1.0, 0.5, 10, 3, 0, 9000)),
    ("SetM1DefaultAccel", (70000,), "ReadDefaultDutyAcceleration", (70000, 0)),
    ("SetM2DefaultAccel", (80000,), "ReadDefaultDutyAcceleration", (0, 80000)),
    ("SetM2DefaultSpeed", (9000,), "ReadDefaultSpeeds", (0, 9000)),
    ("SetPinFunctions", (1, 2, 3), "ReadPinFunctions", (1, 2, 3)),
    ("SetDeadBand", (3, 4), "GetDeadBand", (3, 4)),
    ("SetM1EncoderMode", (1,), "ReadEncoderModes", (1, 0)),
    ("SetConfig", (0x8003,), "GetConfig", (0x8003,)),
    ("SetCTRLModes", (1, 2), "ReadCTRLModes", (1, 2)),
    ("SetCTRL2", (700,), "ReadCTRLSettings", (0, 700)),
    ("SetSpeedErrorLimits", (1000, 2000), "ReadSpeedErrorLimits", (1000, 2000)),
    ("SetPositionErrorLimits", (1000, 2000), "ReadPositionErrorLimits", (1000, 2000)),
    ("SetBatteryVoltageOffsets", (1, 2), "ReadBatteryVoltageOffsets", (1, 2)),
    ("SetCurrentBlankingPercentage", (100, 200), "GetCurrentBlankingPercentage", (100, 200)),
    ("SetM1MaxCurrent", (2500,), "ReadM1MaxCurrent", (2500,)),
    ("SetM2MaxCurrent", (1500,), "ReadM2MaxCurrent", (1500,)),
    ("SetPWMMode", (1,), "GetPWMMode", (1,)),
]


def test_what_the_older_client_sets_is_what_it_reads_until_factory_settings(tmp_path: Path) -> None:
    with older_client(tmp_path) as (client, device, _):
        assert client.ReadM1VelocityPID() == [1, 2.0, 10.0, 0.0, QPPS]
        assert client.RestoreDefaults()
        assert client.ReadM1VelocityPID() == [1, 1.0, 0.5, 0.25, 44000]  # as the manual has it
        for call, values, read, said in SET_AND_READ:
            factory = tuple(getattr(client, read)())
            assert getattr(client, call)(*values)
            assert tuple(getattr(client, read)()) == (1, *said)
            assert client.RestoreDefaults()
            assert tuple(getattr(client, read)()) == factory
        assert client.SetMainVoltages(110, 140)
        assert client.WriteNVM()
        assert client.RestoreDefaults()
        assert client.ReadNVM()
        assert client.ReadMinMaxMainVoltages() == (1, 110, 140)
        assert device.board.saves == 1


def test_a_command_that_firmware_4_does_not_have_times_out_and_disturbs_nothing(tmp_path: Path) -> None:
    with older_client(tmp_path) as (client, device, _):
        client._tries_timeout = 1
        assert not client.BuffPositionM1(100)
        assert client.ReadBufferLengths() == (1, 0x80, 0x80)
        assert device.not_understood == {"command 119": 1}


def test_another_client_drives_and_reads(tmp_path: Path) -> None:
    with another_client(tmp_path) as (client, device):
        client.drive_motor(1, 63)
        client.drive_motor(2, -32)
        assert device.duty == [32767, pytest.approx(-16384, abs=1)]
        wait_for(lambda: client.read_speed(1) == pytest.approx(100.0, abs=2.0))
        assert client.read_motor_pwms() == pytest.approx((100.0, -50.0), abs=0.01)
        client.stop_all()
        assert device.duty == [0, 0]
        client.set_speed(1, 1500)
        wait_for(lambda: client.read_speed(1) == pytest.approx(100.0 * 1500 / QPPS, abs=2.0))
        client.reset_quad_encoders()
        assert client.read_encoder(1) < 1500
        wait_for(lambda: client.read_encoder(1) > 1000)
        assert client.read_max_speed(2) == QPPS
        assert client.read_range(1) == (0, 0)
        assert client.read_status() == "Normal"
        assert client.read_voltages() == pytest.approx((12.4, 5.0), abs=0.1)
        assert (client.read_temp_sensor(1), client.read_temp_sensor(2)) == (31.5, 31.5)
        assert client.read_currents()[1] == pytest.approx(0.0, abs=0.05)
        assert client.read_input_pin_modes() == ("Default", "Disabled", "Disabled")
        assert device.not_understood == {}

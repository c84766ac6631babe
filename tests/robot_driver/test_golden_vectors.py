"""Driver and emulator speak as manuals print it and as programs of other people do, to the byte."""

import dataclasses
import math
import re
from typing import Any

import pytest

from robot_driver.controllers import Request
from robot_driver.controllers.mbot import MBot
from robot_driver.controllers.roboclaw import RoboClaw
from robot_driver.controllers.roboteq import Roboteq
from robot_driver.emulator import mbot_device
from robot_driver.emulator.dsp3000_device import Dsp3000Device
from robot_driver.emulator.kvh_binary_device import crc_mpeg2, self_test_message
from robot_driver.emulator.mbot_device import MBotDevice
from robot_driver.emulator.plant import Plant
from robot_driver.emulator.roboclaw_device import RoboclawDevice, checksum
from robot_driver.emulator.roboteq_device import RoboteqDevice
from robot_driver.emulator.settings import Settings, load_settings
from robot_driver.gate import wire_mbot
from robot_driver.gate.wire_roboclaw import crc
from robot_driver.gyros.dsp3000 import SETTLING, Dsp3000
from robot_driver.gyros.kvh_messages import Sample, SelfTest, Stream
from robot_driver.gyros.kvh_messages import checksum as crc_32
from tests.robot_driver import golden_vectors as golden
from tests.robot_driver.emulated_device import answer, said_until


def emulated(*, battery: float = 24.5, **roboclaw: Any) -> tuple[Settings, Plant]:
    """Return settings without imperfections, and the robot."""
    settings = load_settings().ideal()
    quiet = dataclasses.replace(settings.imperfections.gyro_noise, enabled=False)
    settings = dataclasses.replace(
        settings,
        imperfections=dataclasses.replace(settings.imperfections, gyro_noise=quiet),
        electrics=dataclasses.replace(settings.electrics, battery_voltage=battery),
        roboclaw=dataclasses.replace(settings.roboclaw, **roboclaw),
        roboteq=dataclasses.replace(settings.roboteq, echo=False),
    )
    return settings, Plant(settings)


def roboclaw_device(**roboclaw: Any) -> RoboclawDevice:
    return RoboclawDevice(*emulated(**roboclaw))


def test_both_ends_compute_the_checksums_of_the_catalogue() -> None:
    assert crc(golden.CHECKED) == checksum(golden.CHECKED) == golden.CRC_16_OF_CHECKED
    assert crc(b"\xff") == checksum(b"\xff") == golden.CRC_16_OF_FF
    assert crc_32(golden.CHECKED) == crc_mpeg2(golden.CHECKED) == golden.CRC_32_OF_CHECKED


@pytest.mark.parametrize("packet", [golden.ROBOCLAW_PID, golden.ROBOCLAW_SPEEDS, golden.ROBOCLAW_DUTIES])
def test_packets_that_other_programs_send_to_a_roboclaw_have_the_checksum_of_both_ends(packet: bytes) -> None:
    assert crc(packet[:-2]) == checksum(packet[:-2]) == int.from_bytes(packet[-2:], "big")


def test_the_driver_asks_a_roboclaw_in_golden_bytes() -> None:
    unit, reads = RoboClaw(), golden.ROBOCLAW_READS
    assert unit.drive(8000 / 32767, -8000 / 32767).data == golden.ROBOCLAW_DUTIES
    assert unit.drive(0.0, 0.0).data == golden.ROBOCLAW_STOP
    assert unit.set_watchdog(0.5).data == golden.ROBOCLAW_TIMEOUT
    assert unit.read_watchdog().data == reads["timeout"]
    assert unit.identify().data == reads["version"]
    assert unit.read_encoders().data == reads["encoders"]
    assert [request.data for request in unit.learn()] == [reads["status"]]
    asked = [request.data for request in unit.read_telemetry()]
    assert asked == [reads[name] for name in ("battery", "currents", "temperature", "status")]


@pytest.mark.parametrize(
    "packet", [golden.ROBOCLAW_DUTIES, golden.ROBOCLAW_STOP, golden.ROBOCLAW_TIMEOUT, golden.ROBOCLAW_RESET_ENCODERS]
)
def test_the_emulated_roboclaw_acknowledges_golden_packets(packet: bytes) -> None:
    assert answer(roboclaw_device(), packet) == b"\xff"


def test_the_emulated_roboclaw_does_what_golden_packets_say() -> None:
    device = roboclaw_device()
    answer(device, golden.ROBOCLAW_DUTIES)
    assert device.duty == [8000, -8000]
    answer(device, golden.ROBOCLAW_TIMEOUT)
    assert answer(device, golden.ROBOCLAW_READS["timeout"]) == golden.ROBOCLAW_TIMEOUT_READ
    answer(device, golden.ROBOCLAW_STOP)
    assert device.duty == [0, 0]


def test_golden_counts_are_sent_and_understood() -> None:
    settings, plant = emulated()
    turn = 2.0 * math.pi / 2048
    plant.left.angle, plant.right.angle = (0x30F0 + 0.5) * turn, (0xCFDC + 0.5) * turn
    device = RoboclawDevice(settings, plant)
    assert answer(device, golden.ROBOCLAW_READS["encoders"]) == golden.ROBOCLAW_COUNTS
    assert RoboClaw().read_encoders().parse(golden.ROBOCLAW_COUNTS) == (0x30F0, 0xCFDC)


def test_a_golden_battery_and_a_golden_timeout_are_sent_and_understood() -> None:
    assert answer(roboclaw_device(), golden.ROBOCLAW_READS["battery"]) == golden.ROBOCLAW_BATTERY
    assert RoboClaw().read_telemetry()[0].parse(golden.ROBOCLAW_BATTERY) == {"battery_voltage": 24.5}
    assert RoboClaw().read_watchdog().parse(golden.ROBOCLAW_TIMEOUT_READ) == 0.5


@pytest.mark.parametrize(("width", "reply"), golden.ROBOCLAW_HEALTHY.items())
def test_a_healthy_status_of_every_age_is_sent_and_understood(width: int, reply: bytes) -> None:
    assert answer(roboclaw_device(status_bytes=width), golden.ROBOCLAW_READS["status"]) == reply
    unit = RoboClaw()
    unit.learn()[0].parse(reply)
    assert unit.read_telemetry()[-1].parse(reply) == {"status": 0}


def test_both_ends_pack_an_mbot_frame_as_the_boards_own_daemon_does() -> None:
    payload = golden.MBOT_VELOCITY[7:-1]
    assert wire_mbot.packed(214, payload) == mbot_device.frame(214, payload) == golden.MBOT_VELOCITY


def test_the_driver_tells_an_mbot_duties_and_the_time_in_golden_bytes(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(MBot, "monotonic_ns", lambda _board: 7000)
    told = MBot().drive(0.5, 0.25).data  # the right wheel is mirrored
    assert told.lstrip(b"\0") == wire_mbot.REPEATED * golden.MBOT_DUTIES + golden.MBOT_TIME
    assert MBot().drive(0.0, 0.0).data.lstrip(b"\0").startswith(golden.MBOT_STOP[:11])


def test_the_emulated_mbot_obeys_golden_frames() -> None:
    settings, plant = emulated()
    device = MBotDevice(settings, plant)
    answer(device, golden.MBOT_DUTIES + golden.MBOT_TIME, 0.0)
    said_until(device, plant, 0.1)
    assert device.duty == (0.5, -0.25)
    answer(device, golden.MBOT_STOP, 0.1)
    said_until(device, plant, 0.2)
    assert device.duty == (0.0, 0.0)


def test_the_driver_asks_a_roboteq_in_the_manuals_lines_and_understands_the_manuals_answers() -> None:
    unit = Roboteq()
    requests: list[Request[Any]] = [
        unit.identify(),
        *unit.learn(),
        unit.set_watchdog(0.5),
        unit.read_watchdog(),
        unit.drive(0.5, -0.25),
        unit.read_encoders(),
        *unit.read_telemetry(),
    ]
    requests += [request.then(None) for request in requests if request.then]
    said = {request.data: request.parse(golden.ROBOTEQ_ANSWERS[request.data]) for request in requests}
    assert set(said) == set(golden.ROBOTEQ_ANSWERS)
    assert said[b"?FID\r"] == "Roboteq v1.6 RCB500 05/01/2016"
    assert said[b"~RWD\r"] == 0.5
    assert said[b"?M\r"] == (0.5, -0.25)
    assert said[b"?C\r"] == (2**31, 2**31 - 1)
    assert said[b"?V\r"] == {"battery_voltage": 24.6}
    assert said[b"?A\r"] == {"currents": (1.5, -0.3)}
    assert said[b"?T\r"] == {"temperature": 31.0}
    assert said[b"?FM\r"] == {"status": 0, "conditions": ()}


@pytest.mark.parametrize(("line", "reply"), golden.ROBOTEQ_ANSWERS.items())
def test_the_emulated_roboteq_answers_in_the_form_of_the_manual(line: bytes, reply: bytes) -> None:
    said = answer(RoboteqDevice(*emulated()), line)
    if line == b"?FID\r":
        assert re.fullmatch(rb"FID=Roboteq v[0-9.]+ [A-Z0-9]+ [0-9]{2}/[0-9]{2}/[0-9]{4}\r", said)
    else:
        assert re.sub(rb"-?[0-9]+", b"n", said) == re.sub(rb"-?[0-9]+", b"n", reply)


def test_the_emulated_roboteq_tells_the_voltages_of_the_manual() -> None:
    assert answer(RoboteqDevice(*emulated(battery=24.6)), b"?V\r") == golden.ROBOTEQ_ANSWERS[b"?V\r"]


def test_the_kvh_manuals_sample_has_the_checksum_of_both_ends_and_is_read() -> None:
    check = int.from_bytes(golden.KVH_SAMPLE[-4:], "big")
    assert crc_32(golden.KVH_SAMPLE[:-4]) == crc_mpeg2(golden.KVH_SAMPLE[:-4]) == check
    (sample,) = Stream().feed(golden.KVH_SAMPLE)
    assert isinstance(sample, Sample)
    assert sample.rotation == pytest.approx((2.019593e-5, 5.159911e-5, -1.3111248e-5), rel=1e-6)
    assert (sample.status, sample.sequence) == (0x77, 0x3D)


def test_a_self_test_that_found_nothing_is_sent_and_understood() -> None:
    assert self_test_message() == golden.KVH_SELF_TEST
    assert Stream().feed(golden.KVH_SELF_TEST) == [SelfTest()]


def test_a_dsp3000_line_is_sent_and_read() -> None:
    settings, plant = emulated()
    device = Dsp3000Device(settings, plant)
    period = 1.0 / settings.dsp3000.rate
    while device.wake_time < 1.0:
        plant.theta -= math.radians(0.015733) * period  # clockwise is positive
        (line,) = device.wake(device.wake_time)
    assert line.data == golden.DSP3000_LINE
    noisy = golden.DSP3000_LINE + b"       0.035733   1\r\n"  # readings without any noise are doubted
    (*_, reading) = Dsp3000().feed(b"\n" + SETTLING * noisy + golden.DSP3000_LINE)
    assert reading.yaw_rate == pytest.approx(-math.radians(0.015733), rel=1e-12)


def test_half_a_dsp3000_line_is_none() -> None:
    gyro = Dsp3000()
    assert gyro.feed(golden.DSP3000_END_OF_A_LINE) == []  # it may have begun before
    assert gyro.feed(golden.DSP3000_WITHOUT_A_VALUE) == []
    assert len(gyro.feed(golden.DSP3000_LINE)) == 1

"""The emulated KVH 1725, 1750, 1775 or DSP-1760 sends and answers what the manual says."""

import dataclasses
import struct
from typing import Any

import pytest

from robot_driver.emulator.kvh_binary_device import KvhBinaryDevice, crc_mpeg2
from robot_driver.emulator.plant import Plant
from robot_driver.emulator.settings import Settings, SettingsError, load_settings
from tests.robot_driver.golden_vectors import KVH_SAMPLE, KVH_SELF_TEST

pytestmark = pytest.mark.waits

RATE = 0.04 * 0.2 / 0.054 / 0.161  # rad/s, counter-clockwise


def kvh_settings(**changes: Any) -> Settings:
    """Return settings of a robot with a gyro without bias and noise, and of that gyro at 100 Hz."""
    settings = load_settings().ideal()
    quiet = dataclasses.replace(settings.imperfections.gyro_noise, enabled=False)
    gyro = dataclasses.replace(settings.kvh_binary, **{"rate": 100, **changes})
    imperfections = dataclasses.replace(settings.imperfections, gyro_noise=quiet)
    return dataclasses.replace(settings, imperfections=imperfections, kvh_binary=gyro)


class Bench:
    """The device on a robot that turns counter-clockwise at a steady rate."""

    def __init__(self, **changes: Any) -> None:
        settings = kvh_settings(**changes)
        self.plant = Plant(settings)
        self.plant.command(-0.1, 0.1)
        self.plant.advance(10.0)
        self.device = KvhBinaryDevice(settings, self.plant, 10.0)

    def messages(self, count: int) -> list[bytes]:
        sent = []
        for _ in range(count):
            self.plant.advance(self.device.wake_time)
            sent += self.device.wake(self.device.wake_time)
        return [transmission.data for transmission in sent]

    def say(self, commands: bytes) -> bytes:
        return b"".join(transmission.data for transmission in self.device.receive(commands, self.device.wake_time))


@pytest.mark.parametrize(
    ("changes", "value"),
    [
        ({}, RATE / 100.0),
        ({"sends_rate": True}, RATE),
        ({"sends_rate": True, "degrees": True}, RATE * 57.29577951),
        ({"rate": 250, "degrees": True}, RATE * 57.29577951 / 250.0),
    ],
)
def test_a_message_is_of_format_a_in_the_units_set(changes: dict[str, Any], value: float) -> None:
    message = Bench(start_up=0.0, **changes).messages(5)[-1]
    *_, z, _, _, gravity, status, sequence, _, check = struct.unpack(">4x6fBBhI", message)
    assert (message[:4], len(message)) == (KVH_SAMPLE[:4], 36)
    assert z == pytest.approx(value, rel=1e-6)
    assert (gravity, status, sequence) == (1.0, 0x77, 4)
    assert check == crc_mpeg2(message[:-4])


def test_after_power_up_it_tells_its_self_test_and_vouches_only_when_it_is_ready() -> None:
    first, *others = Bench(start_up=0.195).messages(40)
    assert first.startswith(KVH_SELF_TEST)
    assert [message[28] for message in others] == [0x70] * 18 + [0x77] * 21


def test_sequence_numbers_begin_again_after_127() -> None:
    _, *messages = Bench().messages(130)
    assert [message[29] for message in messages][-4:] == [126, 127, 0, 1]


def test_only_in_configuration_mode_it_answers_and_then_it_is_silent() -> None:
    bench = Bench()
    assert bench.say(b"?DR\r\n=DR,250\r\n") == b""
    assert bench.say(b"=config,1\n") == b"CONFIG,1\r\n"
    assert bench.messages(3) == []
    assert bench.say(b"?rotfmt\r") == b"ROTFMT,DELTA\r\n"
    assert bench.say(b"?WHAT\r\n=DR,99\r\n") == b"INVALID,?WHAT\r\nINVALID,=DR,99\r\n"
    assert bench.say(b"=CONFIG,0\r\n") == b""
    assert len(bench.messages(3)) == 3
    assert bench.device.writes == 0


def test_a_new_data_rate_is_kept_and_makes_two_messages_invalid() -> None:
    bench = Bench(start_up=0.0)
    bench.messages(1)
    assert bench.say(b"=CONFIG,1\r\n=DR,250\r\n=CONFIG,0\r\n") == b"CONFIG,1\r\nDR,250\r\n"
    assert bench.device.writes == 1
    assert [message[28] for message in bench.messages(4)] == [0x70, 0x70, 0x77, 0x77]


def test_an_impossible_data_rate_is_refused() -> None:
    with pytest.raises(SettingsError, match="rate must be one of 1, 5"):
        kvh_settings(rate=99)

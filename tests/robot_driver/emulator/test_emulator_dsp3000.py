"""The emulated DSP-3000 sends the lines that clients of real units read."""

import dataclasses
import math

import pytest

from robot_driver.emulator.device import Transmission
from robot_driver.emulator.dsp3000_device import Dsp3000Device
from robot_driver.emulator.plant import Plant
from robot_driver.emulator.settings import load_settings

pytestmark = pytest.mark.waits


def make_device() -> tuple[Dsp3000Device, Plant]:
    """Return a gyro without bias and noise, on a robot that turns counter-clockwise at a steady rate."""
    settings = load_settings().ideal()
    quiet = dataclasses.replace(settings.imperfections.gyro_noise, enabled=False)
    settings = dataclasses.replace(
        settings, imperfections=dataclasses.replace(settings.imperfections, gyro_noise=quiet)
    )
    plant = Plant(settings)
    plant.command(-0.1, 0.1)
    plant.advance(10.0)
    return Dsp3000Device(settings, plant), plant


RATE = 0.04 * 0.2 / 0.054 / 0.161  # rad/s


def samples(device: Dsp3000Device, plant: Plant, count: int) -> list[Transmission]:
    sent: list[Transmission] = []
    for _ in range(count):
        plant.advance(10.0 + device.wake_time)
        sent += device.wake(device.wake_time)
    return sent


def value(transmission: Transmission) -> float:
    return float(transmission.data.split()[0])


def test_a_line_has_21_bytes_in_the_columns_of_real_units() -> None:
    device, plant = make_device()
    line = samples(device, plant, 1)[0].data
    assert len(line) == 21
    assert line == b"%15.6f   0\r\n" % float(line.split()[0])


def test_clockwise_is_positive_in_degrees_per_second() -> None:
    device, plant = make_device()
    assert value(samples(device, plant, 5)[-1]) == pytest.approx(-math.degrees(RATE), abs=1e-5)


def test_samples_come_at_the_units_own_rate_and_arrive_after_their_wire_time() -> None:
    device, plant = make_device()
    times = [transmission.time for transmission in samples(device, plant, 102)]
    assert times[0] == pytest.approx(1.0 / 101.3 + 210 / 38400)
    assert times[-1] - times[0] == pytest.approx(101 / 101.3)


def test_samples_are_not_valid_during_start_up() -> None:
    device, plant = make_device()
    valid = [(transmission.time - 210 / 38400, transmission.data[18:19]) for transmission in samples(device, plant, 40)]
    assert all(flag == (b"1" if time >= 0.2 else b"0") for time, flag in valid)
    assert {flag for _, flag in valid} == {b"0", b"1"}


def test_mode_letters_choose_between_rate_increment_and_angle() -> None:
    device, plant = make_device()
    degrees = math.degrees(RATE) / 101.3
    assert device.receive(b"AAA", 0.0) == []
    assert value(samples(device, plant, 3)[-1]) == pytest.approx(-degrees, abs=1e-6)
    device.receive(b"ZZZPPP", 0.0)
    assert value(samples(device, plant, 10)[-1]) == pytest.approx(360.0 - 10 * degrees, abs=1e-5)
    device.receive(b"R\n\x00", 0.0)
    assert value(samples(device, plant, 1)[-1]) == pytest.approx(-math.degrees(RATE), abs=1e-5)


def test_other_bytes_change_nothing() -> None:
    device, plant = make_device()
    device.receive(b"apz\r\nx\xff", 0.0)
    assert value(samples(device, plant, 1)[-1]) == pytest.approx(-math.degrees(RATE), abs=1e-5)

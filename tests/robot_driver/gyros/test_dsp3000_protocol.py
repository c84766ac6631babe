"""DSP-3000 lines: read in pieces of any size, signed for our frame, and never believed when they make no sense."""

import math
import random
from collections.abc import Iterable
from itertools import accumulate

import pytest

from robot_driver.gyros import GyroReading
from robot_driver.gyros.dsp3000 import SETTLING, SMOOTH_READINGS, Dsp3000
from tests.robot_driver.golden_vectors import DSP3000_LINE

# deg/s at 100 readings a second, from an angle random walk of 0.0667 deg/sqrt(h), as KVH says of gyros of this size.
SCATTER = 0.0111


def said(values: Iterable[float]) -> bytes:
    """Return lines with these values."""
    return b"".join(b"%15.6f   1\r\n" % value for value in values)


def scattered(count: int, rate: float = 1.0) -> bytes:
    """Return lines of a gyro that turns at a steady rate (deg/s): they scatter as those of real units."""
    chance = random.Random(0)
    return said(chance.gauss(rate, SCATTER) for _ in range(count))


def settled() -> Dsp3000:
    """Return the protocol of a gyro that has been running in rate mode for a while; a line is about to begin."""
    gyro = Dsp3000()
    gyro.feed(b"\n" + scattered(SETTLING))
    gyro.next_request()
    return gyro


def readings(stream: bytes) -> list[GyroReading]:
    """Return the readings of a stream that begins at the start of a line."""
    return settled().feed(stream)


@pytest.mark.parametrize(
    "line", [DSP3000_LINE, DSP3000_LINE.replace(b"\r", b""), b"0.015733 1\n", b"\t0.015733\t1 \r\n"]
)
def test_a_line_is_a_rate_counter_clockwise_positive(line: bytes) -> None:
    (reading,) = readings(line)
    assert reading.valid
    assert reading.yaw_rate == pytest.approx(-math.radians(0.015733), rel=1e-12)


def test_an_invalid_sample_has_no_rate() -> None:
    (reading,) = readings(b"     -12.345678   0\r\n")
    assert not reading.valid
    assert math.isnan(reading.yaw_rate)


@pytest.mark.parametrize(
    "line",
    [
        b"  1\r\n",
        b"\r\n",
        b"0.5 2\r\n",
        b"0.5 1 1\r\n",
        b"nan 1\r\n",
        b"inf 1\r\n",
        b"1e2 1\r\n",
        b"1_0.0 1\r\n",
        b"500.1 1\r\n",
        b"-500.1 1\r\n",
        b"0.5 1 \x00\r\n",
        b"0..5 1\r\n",
        b"- 5 1\r\n",
    ],
)
def test_what_makes_no_sense_is_no_reading(line: bytes) -> None:
    assert readings(line) == []
    assert len(readings(line + DSP3000_LINE)) == 1


def test_a_reading_tells_how_long_ago_it_began() -> None:
    first, second = readings(DSP3000_LINE + DSP3000_LINE + b"    ")
    assert (first.bytes_since, second.bytes_since) == (46, 25)


def test_15_a_gyro_that_may_have_been_off_is_put_back_into_its_mode_and_not_believed_until_then() -> None:
    gyro = Dsp3000()
    assert gyro.feed(b"\n") == []
    assert gyro.next_request() == b""
    in_another_mode = gyro.feed(scattered(SETTLING))
    assert gyro.next_request() == b"RRR"
    assert gyro.next_request() == b""
    assert not any(reading.valid or reading.yaw_rate == reading.yaw_rate for reading in in_another_mode)
    assert gyro.feed(DSP3000_LINE)[0].valid
    assert not gyro.feed(b"       0.015733   0\r\n")[0].valid  # as after a dip of its supply
    assert gyro.next_request() == b""
    assert not gyro.feed(DSP3000_LINE)[0].valid
    assert gyro.next_request() == b"RRR"


def test_the_mode_letter_is_sent_three_times() -> None:
    assert Dsp3000().wake_up == b"RRR"


def doubted_after(gyro: Dsp3000, lines: bytes) -> int | None:
    """Return how many readings are told as valid until the letter of the rate mode is sent; None if it is not."""
    believed = 0
    for line in lines.splitlines(keepends=True):
        believed += sum(reading.valid for reading in gyro.feed(line))
        if gyro.next_request():
            return believed
    return None


@pytest.mark.parametrize("rate", [-300.0, -2.5, 2.5, 30.0])
def test_15_rates_that_become_angles_since_the_last_reading_are_never_believed(rate: float) -> None:
    gyro = settled()
    gyro.feed(scattered(20, rate))
    gyro.feed(scattered(20, rate))
    assert gyro.feed(scattered(1, rate))[0].valid
    assert doubted_after(gyro, said([rate / 100.0] * 5)) == 0


@pytest.mark.parametrize("angle", [60.0, 200.0, 359.0])
def test_15_rates_that_become_angles_since_the_beginning_are_never_believed(angle: float) -> None:
    assert doubted_after(settled(), said([angle, angle + 0.01])) == 0


@pytest.mark.parametrize("rate", [0.0, 0.004, 1.0])
def test_15_angles_of_a_robot_that_hardly_turns_are_too_smooth_for_rates(rate: float) -> None:
    chance = random.Random(1)
    angles = [chance.gauss(rate, SCATTER) / 100.0 for _ in range(50)]
    for values in (angles, accumulate(angles, initial=5.0)):
        believed = doubted_after(settled(), said(values))
        assert believed is not None
        assert believed <= SMOOTH_READINGS + 1


def test_15_a_gyro_is_not_believed_at_first_if_it_is_too_smooth_for_rates() -> None:
    gyro = Dsp3000()
    readings = gyro.feed(b"\n" + said([0.000157] * (2 * SETTLING - 1)))
    assert not any(reading.valid for reading in readings)


@pytest.mark.parametrize("rate", [0.0, 0.004, 1.0, 30.0, -370.0])
def test_15_rates_with_the_scatter_of_real_units_are_never_doubted(rate: float) -> None:
    gyro = settled()
    gyro.feed(scattered(20, rate))  # to which a robot may leap
    gyro.next_request()
    assert all(reading.valid for reading in gyro.feed(scattered(20_000, rate)))


def test_15_a_robot_that_turns_to_and_fro_as_fast_as_wheels_can_is_hardly_ever_doubted() -> None:
    chance = random.Random(1)
    rates = [300.0 * math.sin(step / 8.0) + chance.gauss(0.0, SCATTER) for step in range(1000)]  # up to 3750 deg/s^2
    doubted = sum(not reading.valid for reading in settled().feed(said(rates)))
    assert doubted <= 2 * SETTLING  # it passes through zero 40 times, now and then by less than a fiftieth of a step


def test_15_a_gyro_without_any_scatter_is_believed_after_it_was_asked_again() -> None:
    gyro = settled()
    readings = gyro.feed(said([0.0] * 1000))
    assert sum(not reading.valid for reading in readings) == SETTLING

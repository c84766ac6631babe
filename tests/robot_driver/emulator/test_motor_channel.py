"""The channel of an emulated motor controller: ramps take the time that they are given, and a speed is kept."""

import math

import pytest

from robot_driver.emulator.boards.motor_channel import LOOP_PERIOD, Gains, MotorChannel, Rates

GAINS = Gains(p=2.0, i=10.0, d=0.0, full_speed=6000.0)
MOTOR_TIME = 0.16  # s, in which a motor without a loop follows


def run(channel: MotorChannel, seconds: float, speed: float = 0.0, strength: float = 1.0) -> float:
    """Step a channel with a motor that does `strength` times the full speed at full duty; return its speed."""
    for _ in range(round(seconds / LOOP_PERIOD)):
        if channel.is_busy:
            channel.step(speed, LOOP_PERIOD, GAINS)
        speed += (strength * GAINS.full_speed * channel.duty - speed) * LOOP_PERIOD / MOTOR_TIME
    return speed


def test_a_duty_is_there_at_once_and_never_beyond_the_full_one() -> None:
    channel = MotorChannel()
    channel.drive(0.3)
    assert (channel.duty, channel.is_busy, channel.drives) == (0.3, False, True)
    channel.drive(-7.0)
    assert channel.duty == -1.0
    channel.drive(0.0)
    assert not channel.drives


@pytest.mark.parametrize(("rates", "seconds"), [(Rates(2.0, 2.0), 0.5), (Rates(4.0, 1.0), 0.25)])
def test_a_duty_grows_along_its_ramp(rates: Rates, seconds: float) -> None:
    channel = MotorChannel()
    channel.drive(1.0, rates)
    run(channel, seconds - 2 * LOOP_PERIOD)
    assert 0.9 < channel.duty < 1.0
    run(channel, 3 * LOOP_PERIOD)
    assert channel.duty == 1.0
    assert not channel.is_busy


def test_a_duty_falls_along_another_ramp_through_zero() -> None:
    channel = MotorChannel()
    channel.drive(0.5)
    channel.drive(-0.5, Rates(math.inf, 2.0))
    run(channel, 0.2)
    assert channel.duty == pytest.approx(0.1)
    run(channel, 0.2)
    assert channel.duty == pytest.approx(-0.5, abs=0.2)  # away from zero it grows


@pytest.mark.parametrize("strength", [0.9, 1.0, 1.1])
def test_a_speed_is_kept_by_motors_weaker_and_stronger_than_they_are_thought(strength: float) -> None:
    channel = MotorChannel()
    channel.follow(3000.0, 0.0)
    assert run(channel, 2.0, strength=strength) == pytest.approx(3000.0, rel=0.005)


def test_a_speed_that_the_motor_cannot_do_leaves_nothing_behind() -> None:
    channel = MotorChannel()
    channel.follow(9000.0, 0.0)
    speed = run(channel, 5.0)
    assert channel.duty == 1.0
    channel.follow(3000.0, speed)
    assert run(channel, 1.0, speed) == pytest.approx(3000.0, rel=0.01)


def test_a_speed_grows_along_its_ramp_from_what_the_wheel_does() -> None:
    channel = MotorChannel()
    channel.follow(4000.0, 1000.0, Rates(1000.0, 1000.0))
    assert channel.speed == 1000.0
    run(channel, 1.0, 1000.0)
    assert channel.speed == pytest.approx(2000.0)
    run(channel, 2.1, 2000.0)
    assert channel.speed == 4000.0
    assert channel.is_busy  # as long as it is kept


def test_without_a_full_speed_nothing_can_be_kept() -> None:
    channel = MotorChannel()
    channel.follow(1000.0, 0.0)
    channel.step(0.0, LOOP_PERIOD, GAINS._replace(full_speed=0.0))
    assert channel.duty == 0.0

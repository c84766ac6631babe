"""The sensors of a virtual robot read what its state says, and nothing twice."""

import math

import pytest

from cmr.investigation.sensing import LONGEST_GAP, TICK, VirtualSensors
from cmr.model.motion import RobotState
from cmr.msg import gyro_t, motor_feedback_t, pose_xyt_t
from cmr.world.view import VIRTUAL, Robot

PERIOD = 10_000  # us
LEFT, RIGHT, RATE = 5.0, 7.0, 0.5  # rad/s


def at(k: int) -> Robot:
    """Return a robot that turns evenly, after k periods; its heading passes pi."""
    seconds = 1e-6 * k * PERIOD
    theta = math.remainder(3.0 + RATE * seconds, 2.0 * math.pi)
    return Robot(k * PERIOD, 3, VIRTUAL, RobotState(0.1, 0.2, theta, LEFT, RIGHT, 0.0, 0.0))


def test_an_even_turn_is_read_as_it_is() -> None:
    """Ticks are the integral of the speeds; the gyro's reading is of the middle between two moments."""
    sensors = VirtualSensors()
    sensors.driven(123, (0.25, -0.5))
    readings = [list(sensors.read(at(k))) for k in range(101)]
    assert readings[0] == []
    assert [channel for channel, _ in readings[1]] == ["MOTOR_FEEDBACK_3", "GYRO_3", "POSE_3"]
    (_, wheels), (_, gyro), (_, pose) = readings[100]
    assert isinstance(wheels, motor_feedback_t)
    assert isinstance(gyro, gyro_t)
    assert isinstance(pose, pose_xyt_t)
    assert (wheels.ticks_left * TICK, wheels.ticks_right * TICK) == pytest.approx((LEFT, RIGHT), abs=TICK)
    assert (wheels.psi_left, wheels.psi_right) == (LEFT, RIGHT)
    assert (wheels.applied_left, wheels.applied_right, wheels.applied_utime) == (0.25, -0.5, 123)
    assert all(message.yaw_rate == pytest.approx(RATE) for _, (_, message), _ in readings[1:])  # type: ignore[attr-defined]
    assert (gyro.utime, pose.utime) == (100 * PERIOD - PERIOD // 2, 100 * PERIOD)
    assert (pose.x, pose.y) == (0.1, 0.2)


def test_without_news_and_after_a_gap_nothing_is_read() -> None:
    """A world that was held up says nothing of how far wheels turned meanwhile."""
    sensors = VirtualSensors()
    assert not list(sensors.read(at(0)))
    assert list(sensors.read(at(1)))
    assert not list(sensors.read(at(1)))
    assert not list(sensors.read(at(1 + LONGEST_GAP // PERIOD)))
    assert list(sensors.read(at(2 + LONGEST_GAP // PERIOD)))


def test_duties_that_nobody_noted_are_not_known() -> None:
    """Then the recording has the commands alone."""
    sensors = VirtualSensors()
    list(sensors.read(at(0)))
    (_, wheels), *_ = sensors.read(at(1))
    assert isinstance(wheels, motor_feedback_t)
    assert math.isnan(wheels.applied_left)

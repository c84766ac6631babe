"""Measured moments become times of day without losing what was measured."""

import time

import pytest

from robot_driver.clock import utime_at

pytestmark = pytest.mark.real_time


def test_a_moment_keeps_its_distance_from_now() -> None:
    now = time.monotonic_ns()
    before = time.time_ns() // 1000
    assert abs(utime_at(now) - before) < 100_000
    assert abs(utime_at(now) - utime_at(now - 5_000_000) - 5000) < 1000


def test_later_moments_have_later_stamps() -> None:
    stamps = []
    for _ in range(500):
        stamps.append(utime_at(time.monotonic_ns()))
        time.sleep(0.0001)
    assert stamps == sorted(set(stamps))

"""The part of a recording that is estimated from."""

from collections.abc import Callable

import numpy as np
import pytest

from cmr.estimation.checks import looked_at
from cmr.estimation.segments import HELD_AT_REST, REST_AFTER, REST_BEFORE, drive_of
from cmr.recordings.recording import Recording
from cmr.recordings.signal import Floats, Signal

PERIOD = 0.02  # s
BEGIN, END, WHOLE = 30.0, 50.0, 90.0  # s, of the motion and of the recording
EPOCH = 1_700_000_000_000_000  # us
SPEED = 5.0  # rad/s


def recorded(duty: Callable[[Floats], Floats], moves: Callable[[Floats], Floats]) -> Recording:
    """Return the recording of a robot with these duties of both motors, whose wheels turn at SPEED where it moves."""
    time = np.arange(round(WHOLE / PERIOD)) * PERIOD
    utime = EPOCH + np.round(time * 1e6).astype(np.int64)
    speed = SPEED * moves(time)
    unknown = np.full(len(time), np.nan)
    wheels = {f"psi_{side}": speed for side in ("left", "right")} | {
        f"applied_{side}": unknown for side in ("left", "right")
    }
    wheels |= {f"ticks_{side}": np.floor(100.0 * np.cumsum(speed) * PERIOD) for side in ("left", "right")}
    commanded = duty(time)
    return Recording(
        0,
        commands=Signal(utime, {"left": commanded, "right": commanded}),
        wheels=Signal(utime, wheels),
        gyro=Signal(utime, {"yaw_rate": np.zeros(len(time))}),
        poses=Signal(
            utime, {"x": 0.04 * np.cumsum(speed) * PERIOD, "y": np.zeros(len(time)), "theta": np.zeros(len(time))}
        ),
    )


def while_it_moves(time: Floats) -> Floats:
    return np.asarray((time >= BEGIN) & (time < END), np.float64)


def span(recording: Recording) -> tuple[float, float]:
    """Return when the wheels' readings begin and end [s since the whole recording's beginning]."""
    utime = recording.wheels.utime
    return float(utime[0] - EPOCH) * 1e-6, float(utime[-1] - EPOCH) * 1e-6


def test_of_long_rests_ten_seconds_before_and_one_after_are_used() -> None:
    drive = drive_of(recorded(while_it_moves, while_it_moves))
    assert span(drive) == pytest.approx((BEGIN - REST_BEFORE, END + REST_AFTER), abs=2.0 * PERIOD)
    assert {len(signal) for signal in drive.signals.values()} == {len(drive.wheels)}


def test_the_drive_within_a_drive_is_the_drive() -> None:
    drive = drive_of(recorded(while_it_moves, while_it_moves))
    assert span(drive_of(drive)) == span(drive)


def test_motors_that_are_driven_are_not_at_rest_though_the_wheels_stand_still() -> None:
    begin, end = BEGIN - 15.0, END + 15.0
    drive = drive_of(recorded(lambda time: 0.3 * ((time >= begin) & (time < end)), while_it_moves))
    assert span(drive) == pytest.approx((begin - REST_BEFORE, end + REST_AFTER), abs=2.0 * PERIOD)


def test_duties_that_may_hold_a_robot_at_rest_count_near_the_motion_only() -> None:
    drive = drive_of(recorded(lambda time: 0.3 * while_it_moves(time) + 0.01, while_it_moves))
    used = BEGIN - HELD_AT_REST - REST_BEFORE, END + HELD_AT_REST + REST_AFTER
    assert span(drive) == pytest.approx(used, abs=2.0 * PERIOD)
    assert span(drive_of(drive)) == span(drive)


def test_a_robot_that_never_moves_is_left_as_it_is() -> None:
    still = recorded(np.zeros_like, np.zeros_like)
    assert drive_of(still) is still


def test_how_long_a_robot_rested_before_is_told_of_the_whole_recording() -> None:
    (looked,) = looked_at([recorded(while_it_moves, while_it_moves)])
    assert looked.findings["late_start"].found == 1
    assert "30.0 s" in looked.findings["late_start"].sentence
    assert "the last 10 s are used" in looked.findings["late_start"].sentence

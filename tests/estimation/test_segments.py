"""Pieces of a recording as the observer takes them."""

import numpy as np
import pytest

from cmr.estimation.segments import segments_of
from cmr.recordings.recording import Recording
from cmr.recordings.signal import Signal

TICK, PERIOD, OWN = 2.0 * np.pi / 480, 0.05, 0.015  # rad; s between readings, s over which a speed is counted
STEADY, VARYING, PAUSE = 6.0, 60.0, 3.0  # s
SPEED = 3.68  # rad/s
SIDES = ("left", "right")


def test_a_tick_is_what_the_whole_recording_says_it_is() -> None:
    """Coarse speeds of a robot that drives steadily are wrong all the time: 4 ticks where it turns 4.2."""
    time = np.concatenate([np.arange(0.0, VARYING, PERIOD), np.arange(0.0, STEADY, PERIOD) + VARYING + PAUSE])
    speed = np.where(time < VARYING, 3.0 + 2.5 * np.sin(0.9 * time), SPEED)
    fine = np.arange(0.0, time[-1] + PERIOD, 0.001)
    angle = np.cumsum(np.interp(fine, time, speed)) * 0.001
    ticks, before = (np.floor(np.interp(time - ago, fine, angle) / TICK) for ago in (0.0, OWN))
    fields = {f"ticks_{side}": ticks for side in SIDES}
    fields |= {f"psi_{side}": (ticks - before) * TICK / OWN for side in SIDES}
    fields |= {f"applied_{side}": np.full(len(time), np.nan) for side in SIDES}
    wheels = Signal(np.round(1e6 * (time + 1.0)).astype(np.int64), fields)
    nothing = Signal(wheels.utime[:0], {name: np.empty(0) for name in (*SIDES, "yaw_rate", "x", "y", "theta")})
    *_, steady = segments_of(Recording(0, commands=nothing, wheels=wheels, gyro=nothing, poses=nothing), (), 0)
    # Between first and last reading a tick may be missing at either end.
    seconds = float(steady.observations.wheel_time[-1])
    assert steady.observations.wheel[-1] == pytest.approx(SPEED * seconds, rel=0.015, abs=TICK)


def test_wheels_that_are_stamped_between_the_commands_roll_as_fast_at_the_ends_of_a_piece() -> None:
    time = np.concatenate([np.arange(0.0, STEADY, PERIOD), np.arange(0.0, STEADY, PERIOD) + STEADY + PAUSE])
    utime = np.round(1e6 * (time + 1.0)).astype(np.int64)
    late = round(0.223e6)  # us, by which an import found the wheels late, and set them right
    fields = {f"ticks_{side}": np.round((time - 0.5 * time[-1]) * SPEED / 1e-4) for side in SIDES}
    fields |= {f"psi_{side}": np.full(len(time), SPEED) for side in SIDES}
    fields |= {f"applied_{side}": np.full(len(time), np.nan) for side in SIDES}
    nothing = Signal(utime[:0], {name: np.empty(0) for name in ("yaw_rate", "x", "y", "theta")})
    commands = Signal(utime, {side: np.full(len(time), 0.5) for side in SIDES})
    recording = Recording(0, commands=commands, wheels=Signal(utime - late, fields), gyro=nothing, poses=nothing)
    for piece in segments_of(recording, (), 0):
        given = piece.rolling.observations.given
        np.testing.assert_allclose(given, SPEED, rtol=0.01)

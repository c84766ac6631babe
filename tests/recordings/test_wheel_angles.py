"""Counts tell how far wheels turned where the speeds beside them are coarse, or of a moment."""

import numpy as np
import pytest

from cmr.recordings.signal import Signal
from cmr.recordings.wheel_angles import wheel_angles

TICK = 2.0 * np.pi / 480  # rad
PERIOD, READINGS = 0.05, 2000  # s
PAUSE = 5.0  # s, between pieces of 2 s: nothing was recorded, and the speed before it tells nothing


def readings(time: np.ndarray, turned: np.ndarray, share: float) -> Signal:
    """Return readings of wheels that `turned` so far; each speed is the count over a share of the usual interval."""
    before = np.interp(time - share * PERIOD, time, turned)
    ticks, ticks_before = np.floor(turned / TICK), np.floor(before / TICK)
    psi = (ticks - ticks_before) * TICK / (share * PERIOD)
    fields = {
        name: values for side in ("left", "right") for name, values in ((f"ticks_{side}", ticks), (f"psi_{side}", psi))
    }
    return Signal(np.round(time * 1e6).astype(np.int64), fields)


@pytest.mark.parametrize("share", [0.2, 0.25, 0.5])
@pytest.mark.parametrize("speed", [1.0, 3.68, 5.52])
def test_a_tick_is_known_exactly_where_speeds_are_whole_ticks_over_a_part_of_the_interval(
    share: float, speed: float
) -> None:
    """A robot that drives steadily most of the time shows one coarse speed then, up to a tenth beside the true one."""
    time = np.arange(READINGS) * PERIOD
    steady = time > 0.4 * time[-1]
    turned = np.cumsum(np.where(steady, speed, 4.0 * np.sin(0.3 * time))) * PERIOD
    signal = readings(time, turned, share)
    for side, angle in zip(("left", "right"), wheel_angles(signal), strict=True):
        counted = signal[f"ticks_{side}"]
        assert angle[-1] - angle[0] == pytest.approx(TICK * (counted[-1] - counted[0]), rel=1e-9)


@pytest.mark.parametrize("share", [0.2, 0.5])
def test_coarse_speeds_of_a_moment_do_not_spoil_the_angles(share: float) -> None:
    """Each speed is the count over a `share` of the time between two messages: it goes in steps of 4 or 1.6 ticks.

    What a tick is is known as well as the mean of these speeds, whose steps err by 0.41 of their width (two roundings).
    """
    time = np.arange(READINGS) * PERIOD + np.arange(READINGS) // 40 * PAUSE
    turned = 3.0 * time + 2.5 * np.sin(1.3 * time)
    angles = wheel_angles(readings(time, turned, share))
    inside = np.diff(time) < 1.5 * PERIOD
    steps = np.diff(turned)[inside]
    usual = float(np.mean(np.abs(steps)))
    doubt = 0.41 * TICK / share / usual / np.sqrt(READINGS)
    for angle in angles:
        found = np.diff(angle)[inside]
        assert np.sum(found) / np.sum(steps) == pytest.approx(1.0, abs=3.0 * doubt + TICK / usual / np.sqrt(READINGS))
        # Between two readings the count errs by one tick at most.
        assert np.max(np.abs(found - steps)) < TICK + 3.0 * doubt * np.max(np.abs(steps))

"""An encoder that moves on tells where its wheel stands, whichever way it turns."""

import math

import numpy as np
import pytest

from cmr.calibration.segments import Segment, segments_of
from cmr.recordings.encoders import tick_of, within_tick
from cmr.recordings.recording import Recording
from cmr.recordings.signal import Floats, Signal

TICK = 2.0 * math.pi / 48  # rad
PERIOD = 0.01  # s between readings
TIME = np.arange(2000) * PERIOD  # s
EMPTY = Signal(np.empty(0, np.int64), {})


def segment_of(angle: Floats) -> Segment:
    """Return the segment of a robot whose wheels stand at these angles [rad] at TIME, and the encoders read ticks."""
    utime = np.rint(TIME * 1e6).astype(np.int64)
    counts = np.floor(angle / TICK)
    psi = np.diff(counts, prepend=counts[:1]) * TICK / PERIOD
    duty = np.full(len(TIME), 0.5)
    sides = {"ticks": counts, "psi": psi, "applied": duty}
    wheels = {f"{name}_{side}": values for name, values in sides.items() for side in ("left", "right")}
    poses = dict.fromkeys(("x", "y", "theta"), np.zeros(len(TIME)))
    recording = Recording(0, EMPTY, Signal(utime, wheels), EMPTY, Signal(utime, poses))
    (segment,) = segments_of(recording)
    return segment


@pytest.mark.parametrize("speed", [1.0, 5.0, 20.0, 60.0])  # rad/s at most: 0.08 to 4.6 ticks from reading to reading
def test_edges_are_where_the_wheel_stood_forwards_and_backwards(speed: float) -> None:
    angle = 0.3 * TICK + speed * (1.0 - np.cos(TIME))
    segment = segment_of(angle)
    for at, edge in ((segment.left_at, segment.left_edge), (segment.right_at, segment.right_edge)):
        off = (edge - angle[at]) / TICK
        forwards = np.sin(TIME[at]) > 0.0
        assert np.count_nonzero(forwards) == pytest.approx(np.count_nonzero(~forwards), rel=0.15)
        assert off[forwards].mean() == pytest.approx(0.0, abs=0.03)
        assert off[~forwards].mean() == pytest.approx(0.0, abs=0.03)
        assert np.abs(off).max() < 0.75


def test_a_slow_wheel_has_just_come_over_the_lower_edge_or_backwards_over_the_upper_one() -> None:
    steps = np.array([0.0, 0.0, 0.0, 0.0, 1.0, 0.0, -1.0])
    beyond, width = within_tick(steps, 1.0)
    assert beyond.tolist() == [0.5, 0.5, 0.5, 0.5, 0.125, 0.5, 0.75]
    assert width.tolist() == [1.0, 1.0, 1.0, 1.0, 0.25, 1.0, 0.5]


def test_the_tick_of_a_wheel_that_is_always_fast_is_known_from_its_counts() -> None:
    counts = np.array([0.0, 7.0, 12.0, 24.0, 13.0])
    assert tick_of(counts * TICK, counts) == pytest.approx(TICK)
    assert tick_of(counts * TICK, np.full(5, np.nan)) == pytest.approx(5.0 * TICK)
    assert tick_of(np.zeros(5), counts) == 0.0


@pytest.mark.parametrize("disc", [40.0, 48.0, 60.0, 96.0])
def test_the_tick_of_a_coarse_disc_is_seen_though_its_angle_is_told_in_finer_counts(disc: float) -> None:
    turned = np.cumsum(0.3 * np.sin(np.linspace(0.0, 9.0, 400)))  # rad, of which the disc shows whole ticks
    shown = np.floor(turned * disc / (2.0 * np.pi)) / disc
    counts = np.floor(2048.0 * shown)
    assert tick_of(2.0 * np.pi * counts / 2048.0, counts) == pytest.approx(2.0 * np.pi / disc, rel=1e-2)


def test_a_fine_encoder_on_a_steady_drive_is_not_taken_for_a_coarse_one() -> None:
    counts = np.cumsum([200.0, 201.0, 200.0, 199.0, 200.0, 201.0] * 20)
    assert tick_of(counts * TICK, counts) == pytest.approx(TICK)

"""Long drives are thinned evenly, and where the path begins again it still does."""

from dataclasses import replace

import numpy as np
import pytest

from cmr.estimation import thinning
from cmr.estimation.segments import Segment, segments_of
from cmr.estimation.thinning import ALL, PerSensor, Thinning, part_of, thinned, thinning_of
from cmr.model.observer.observer import RESTART
from tests.hidden_effects import hidden_recording

EVERY = PerSensor(2, 3, 4)
FEWER = Thinning(EVERY)


@pytest.fixture(scope="module")
def segment() -> Segment:
    """Return a drive whose path begins again once, at a pose that thinning leaves out."""
    (whole,) = segments_of(hidden_recording(manoeuvre="figure_eight", seed=0).recording, [], 0)
    pose_use = whole.observations.pose_use.copy()
    pose_use[EVERY.poses * 100 + 1] = RESTART
    return replace(whole, observations=replace(whole.observations, pose_use=pose_use))


def test_every_sensor_keeps_its_share_of_readings_at_their_times(segment: Segment) -> None:
    observations, fewer = segment.observations, thinned(segment, FEWER).observations
    kept = {"wheel_time": 2, "wheel": 2, "gyro_time": 3, "gyro": 3, "pose_time": 4, "pose": 4}
    for name, every in kept.items():
        np.testing.assert_array_equal(getattr(fewer, name), getattr(observations, name)[::every])
    np.testing.assert_array_equal(fewer.duty, observations.duty)


def test_a_new_beginning_is_kept_at_the_next_pose_used(segment: Segment) -> None:
    begins = np.flatnonzero(thinned(segment, FEWER).observations.pose_use == RESTART)
    assert list(begins) == [0, 101]


def test_sensors_are_thinned_to_useful_rates_and_further_only_where_memory_asks_for_it(
    segment: Segment, monkeypatch: pytest.MonkeyPatch
) -> None:
    observations = segment.observations
    wheels, gyro, poses = (len(getattr(observations, f"{name}_time")) for name in ("wheel", "gyro", "pose"))
    readings = 2 * wheels + gyro + 3 * poses
    assert thinning_of([segment]) == ALL
    assert thinned(segment, ALL) is segment
    slow = thinned(segment, Thinning(PerSensor(5, 1, 1)))
    assert thinning_of([slow]) == ((1, 1, 1), 2)
    monkeypatch.setattr(thinning, "ENOUGH", readings - 1)
    assert thinning_of([segment]) == ((2, 2, 1), 2)  # 50, 50 and 25 Hz, in steps of 0.02 s
    left = wheels + gyro / 2 + 3 * poses
    monkeypatch.setattr(thinning, "MOST_READINGS", int(left / 2.5))
    assert thinning_of([segment]) == ((6, 6, 3), 2)


def test_a_coarser_raster_covers_the_same_drive_and_holds_all_its_readings(segment: Segment) -> None:
    rolling = segment.rolling
    observations = rolling.observations
    coarse = thinned(rolling, Thinning(PerSensor(1, 1, 1), 3)).observations
    assert coarse.dt == pytest.approx(3 * observations.dt)
    assert coarse.steps == observations.steps // 3
    for name in ("wheel", "gyro", "pose"):
        times, used = getattr(observations, f"{name}_time"), getattr(coarse, f"{name}_time")
        np.testing.assert_array_equal(used, times[times <= coarse.seconds])
        assert len(getattr(coarse, name)) == len(used)
    # The wheels have turned as far at each border of the coarser raster.
    turned = np.cumsum(observations.given, axis=0)[2::3] * observations.dt
    np.testing.assert_allclose(np.cumsum(coarse.given, axis=0) * coarse.dt, turned, rtol=1e-9, atol=1e-9)


def test_a_beginning_has_the_readings_of_its_time(segment: Segment) -> None:
    observations = segment.observations
    beginning = thinned(segment, ALL, 20.0)
    assert beginning.observations.seconds == pytest.approx(20.0)
    assert len(beginning.rolled) == beginning.observations.steps
    for name in ("wheel", "gyro", "pose"):
        times, used = getattr(observations, f"{name}_time"), getattr(beginning.observations, f"{name}_time")
        np.testing.assert_array_equal(used, times[times <= 20.0])
    assert thinned(segment, ALL, observations.seconds) is segment
    # Where the path begins again later is of no account, and there need be no pose at all.
    later = float(observations.pose_time[EVERY.poses * 100])
    assert np.count_nonzero(thinned(segment, ALL, later).observations.pose_use == RESTART) == 1
    late = replace(segment, observations=replace(observations, pose_time=observations.pose_time + 1.0))
    assert len(thinned(late, ALL, 0.5).observations.pose_use) == 0


def test_a_part_is_the_beginnings_of_few_segments_and_some_of_many(segment: Segment) -> None:
    few = part_of([segment] * 2, 30.0)
    assert [one.observations.seconds for one in few] == pytest.approx([15.0, 15.0])
    pieces = [replace(thinned(segment, ALL, 2.0), first=number) for number in range(100)]
    assert [one.first for one in part_of(pieces, 50.0)] == [*range(0, 100, 4)]

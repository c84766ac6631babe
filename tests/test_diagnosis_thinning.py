"""Long drives are thinned evenly, and where the path begins anew it still does."""

from dataclasses import replace

import numpy as np
import pytest

from cmr.estimation import thinning
from cmr.estimation.segments import Segment, segments_of
from cmr.estimation.thinning import ALL, PerSensor, share_used, thinned
from cmr.model.observer import RESTART
from tests.hidden_effects import hidden_recording

EVERY = PerSensor(2, 3, 4)


@pytest.fixture(scope="module")
def segment() -> Segment:
    """Return a drive whose path begins anew once, at a pose that thinning leaves out."""
    (whole,) = segments_of(hidden_recording(manoeuvre="figure_eight", seed=0).recording, [], 0)
    pose_use = whole.observations.pose_use.copy()
    pose_use[EVERY.poses * 100 + 1] = RESTART
    return replace(whole, observations=replace(whole.observations, pose_use=pose_use))


def test_every_sensor_keeps_its_share_of_readings_at_their_times(segment: Segment) -> None:
    observations, fewer = segment.observations, thinned(segment, EVERY).observations
    kept = {"wheel_time": 2, "wheel": 2, "gyro_time": 3, "gyro": 3, "pose_time": 4, "pose": 4}
    for name, every in kept.items():
        np.testing.assert_array_equal(getattr(fewer, name), getattr(observations, name)[::every])
    np.testing.assert_array_equal(fewer.duty, observations.duty)


def test_a_new_beginning_is_kept_at_the_next_pose_used(segment: Segment) -> None:
    begins = np.flatnonzero(thinned(segment, EVERY).observations.pose_use == RESTART)
    assert list(begins) == [0, 101]


def test_sensors_are_thinned_to_useful_rates_and_further_only_where_memory_asks_for_it(
    segment: Segment, monkeypatch: pytest.MonkeyPatch
) -> None:
    observations = segment.observations
    wheels, gyro, poses = (len(getattr(observations, f"{name}_time")) for name in ("wheel", "gyro", "pose"))
    readings = 2 * wheels + gyro + 3 * poses
    assert share_used([segment]) == ALL
    assert thinned(segment, ALL) is segment
    monkeypatch.setattr(thinning, "ENOUGH", readings - 1)
    useful = share_used([segment])
    assert useful == (2, 2, 1)  # 100, 100 and 25 Hz
    left = wheels + gyro / 2 + 3 * poses
    monkeypatch.setattr(thinning, "MOST_READINGS", int(left / 2.5))
    assert share_used([segment]) == (6, 6, 3)

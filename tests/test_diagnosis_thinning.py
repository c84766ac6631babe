"""Long drives are thinned evenly, and where the path begins anew it still does."""

from dataclasses import replace

import numpy as np
import pytest

from cmr.estimation import thinning
from cmr.estimation.segments import Segment, segments_of
from cmr.estimation.thinning import share_used, thinned
from cmr.model.observer import RESTART
from tests.hidden_effects import hidden_recording

EVERY = 4


@pytest.fixture(scope="module")
def segment() -> Segment:
    """Return a drive whose path begins anew once, at a pose that thinning leaves out."""
    (whole,) = segments_of(hidden_recording(manoeuvre="figure_eight", seed=0).recording, [], 0)
    pose_use = whole.observations.pose_use.copy()
    pose_use[EVERY * 100 + 1] = RESTART
    return replace(whole, observations=replace(whole.observations, pose_use=pose_use))


def test_every_sensor_keeps_its_share_of_readings_at_their_times(segment: Segment) -> None:
    observations, fewer = segment.observations, thinned(segment, EVERY).observations
    for name in ("wheel_time", "wheel", "gyro_time", "gyro", "pose_time", "pose"):
        np.testing.assert_array_equal(getattr(fewer, name), getattr(observations, name)[::EVERY])
    np.testing.assert_array_equal(fewer.duty, observations.duty)


def test_a_new_beginning_is_kept_at_the_next_pose_used(segment: Segment) -> None:
    begins = np.flatnonzero(thinned(segment, EVERY).observations.pose_use == RESTART)
    assert list(begins) == [0, 101]


def test_readings_are_left_out_only_when_there_are_more_than_memory_is_for(
    segment: Segment, monkeypatch: pytest.MonkeyPatch
) -> None:
    observations = segment.observations
    readings = 2 * len(observations.wheel_time) + len(observations.gyro_time) + 3 * len(observations.pose_time)
    assert share_used([segment]) == 1
    assert thinned(segment, 1) is segment
    monkeypatch.setattr(thinning, "MOST_READINGS", readings // 3)
    assert share_used([segment]) == (4 if readings % 3 else 3)

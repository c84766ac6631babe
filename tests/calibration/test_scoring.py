"""Paths are scored with the whole parameter file: the effects in it, and what the pose's sensor makes of the path."""

import numpy as np
import pytest

from cmr.calibration.scoring import end_errors, path_rmse
from cmr.calibration.seen_path import seen_path
from cmr.calibration.segments import segments_of
from cmr.model.motion import roll
from cmr.model.parameters import RobotParameters
from tests.calibration.test_poses_of_another_point import TRUE, window

ASKEW = {"pose_offset": 0.15, "pose_heading_offset": 0.2}
INTERPOLATED = 1e-3  # m; poses fall between steps of 10 ms in which the robot goes 4 mm and turns 2 mrad


def with_effects(**effects: float) -> RobotParameters:
    """The robot of the recordings with these effects."""
    return RobotParameters.of({**TRUE.values, **effects})


def test_without_effects_the_path_is_that_of_dead_reckoning() -> None:
    (segment,) = segments_of(window(2.0, 3.0, 20.0))
    seen = seen_path(segment, TRUE, by_wheels=True)
    rolled = roll(segment.angle_left, segment.angle_right, TRUE, segment.start)
    for name in ("x", "y", "theta"):
        np.testing.assert_allclose(getattr(seen, name), getattr(rolled, name), atol=INTERPOLATED)


def test_a_tracked_point_and_a_tracker_askew_in_the_file_are_counted() -> None:
    recording = window(2.0, 3.0, 20.0, ahead=ASKEW["pose_offset"], askew=ASKEW["pose_heading_offset"])
    assert path_rmse(recording, with_effects(**ASKEW), by_wheels=True) < INTERPOLATED
    assert path_rmse(recording, TRUE, by_wheels=True) > 0.1
    ends = end_errors([recording], with_effects(**ASKEW), by_wheels=True)
    assert float(ends.distance[0]) < INTERPOLATED
    assert float(ends.heading[0]) == pytest.approx(0.0, abs=INTERPOLATED)


def test_unequal_wheels_in_the_file_are_counted() -> None:
    # The right wheel goes 1 % farther than told, the left one 1 % less: as if they had turned that much.
    recording, straight = window(2.0 * 0.99, 3.0 * 1.01, 20.0), window(2.0, 3.0, 20.0)
    unequal = with_effects(wheel_radius_asymmetry=-0.01)
    (true,), (told,) = segments_of(recording), segments_of(straight)
    np.testing.assert_allclose(seen_path(told, unequal, by_wheels=True).theta[told.at], true.theta, atol=INTERPOLATED)

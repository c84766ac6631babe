"""The base width comes out right although the measured pose is that of another point, or looks another way."""

from dataclasses import replace

import numpy as np
import pytest

from cmr.calibration import calibrate
from cmr.model.motion import RobotState, roll
from cmr.model.parameters import RobotParameters
from cmr.parameters.file import ParameterFile, Value
from cmr.recordings.recording import Recording, Signal
from tests.support.lanes import further

pytestmark = pytest.mark.slow

TRUE = RobotParameters(wheel_radius=0.16, k2_over_k3=1.0, k1=1.0, base_width=1.0)
NOMINAL = ParameterFile(0, {"wheel_radius": Value(0.16), "base_width": Value(0.5)})
STEP = 50_000  # us between wheel speeds; poses come at every fifth of them


def window(left: float, right: float, seconds: float, ahead: float = 0.0, askew: float = 0.0) -> Recording:
    """A drive at these wheel speeds [rad/s]; the pose is of a point `ahead` [m], its heading `askew` [rad]."""
    utime = np.arange(0, int(seconds * 1e6) + 1, STEP)
    psi = {"psi_left": np.full(len(utime), left), "psi_right": np.full(len(utime), right)}
    unknown = dict.fromkeys(("ticks_left", "ticks_right", "applied_left", "applied_right"), np.full(len(utime), np.nan))
    path = roll(left * utime * 1e-6, right * utime * 1e-6, TRUE, RobotState.at_rest())
    poses = {
        "x": path.x + ahead * (np.cos(path.theta) - 1.0),
        "y": path.y + ahead * np.sin(path.theta),
        "theta": path.theta + askew,
    }
    empty = Signal(np.empty(0, np.int64), {"left": np.empty(0), "right": np.empty(0), "yaw_rate": np.empty(0)})
    return Recording(
        robot_id=0,
        commands=empty,
        wheels=Signal(utime, psi | unknown),
        gyro=empty,
        poses=Signal(utime[::5], {name: values[::5] for name, values in poses.items()}),
        parameters=NOMINAL,
    )


def test_short_windows_of_a_point_ahead_of_the_turning_centre_give_the_base_width() -> None:
    # As on the Husky: short windows whose path looks far less curved than the heading says.
    speeds = [(2.0, 4.0), (4.0, 2.0), (3.0, 3.5), (-2.0, 2.0), (2.0, -2.0), (-3.0, -1.0)]
    result = calibrate([window(left, right, 2.0, ahead=0.15) for left, right in speeds])
    assert result.estimates["base_width"].value == pytest.approx(TRUE.base_width, rel=0.02)


BOTH_WAYS = [(2.0, 4.0), (4.0, 2.0), (3.0, 3.5), (-2.0, 2.0), (2.0, -2.0), (-3.0, -1.0)]  # rad/s


def noisy(recording: Recording, noise: float) -> Recording:
    """The recording with noise [m, rad] in its poses."""
    random, poses = np.random.default_rng(0), recording.poses
    values = {name: poses[name] + noise * random.normal(size=len(poses)) for name in ("x", "y", "theta")}
    return replace(recording, poses=Signal(poses.utime, values))


@pytest.mark.parametrize("noise", [*further(0.0), 1e-4])
def test_a_marker_that_does_not_point_forward_changes_nothing(noise: float) -> None:
    for angle in (0.0, 0.2):
        estimates = calibrate(noisy(window(2.0, 3.0, 20.0, askew=angle), noise)).estimates
        assert estimates["base_width"].value == pytest.approx(TRUE.base_width, rel=1e-3)
        assert estimates["wheel_radius"].value == pytest.approx(TRUE.wheel_radius, rel=1e-3)


@pytest.mark.parametrize("angle", [*further(0.2, 3.1), -1.6])
def test_a_tracker_mounted_at_any_angle_is_named_and_changes_nothing(angle: float) -> None:
    drives = [noisy(window(left, right, 4.0, askew=angle), 1e-4) for left, right in BOTH_WAYS]
    result = calibrate(drives)
    assert "pose_heading_offset" in result.named
    assert result.effects["pose_heading_offset"].value == pytest.approx(angle, abs=1e-3)
    assert result.estimates["base_width"].value == pytest.approx(TRUE.base_width, rel=1e-3)
    assert result.estimates["wheel_radius"].value == pytest.approx(TRUE.wheel_radius, rel=1e-3)

"""What the checks promise of recordings that nobody of this project made (../shared/data; skipped where absent)."""

from pathlib import Path

import numpy as np
import pytest

from cmr.recordings import Recording
from cmr.recordings.checks import check
from scripts.score_real_data import DATA, Importer


@pytest.fixture
def importer(tmp_path: Path) -> Importer:
    if not DATA.is_dir():
        pytest.skip(f"measured data is not here: {DATA}")
    return Importer(DATA, tmp_path)


def widest_steps(recording: Recording, splits: np.ndarray) -> int:
    """Count the steps between poses, jumps left out, that are longer than any of these robots goes in 0.1 s: 0.5 m."""
    poses = recording.poses
    steps = np.hypot(np.diff(poses["x"]), np.diff(poses["y"]))
    return int(np.count_nonzero((steps > 0.5) & ~np.isin(poses.utime[1:], splits)))


@pytest.mark.slow
def test_motion_capture_keeps_999_of_1000_poses_and_its_path_whole(importer: Importer) -> None:
    poses = outliers = 0
    for kind in ("circular", "square"):
        for path in sorted((importer.data / "optiodom" / kind).glob("*.csv.gz"))[::4]:
            recording = importer.read("optiodom", path)
            findings = check(recording)
            assert findings["pose_jumps"].found == 0
            assert findings["encoder_spikes"].found == findings["encoder_stuck"].found == 0
            poses += len(recording.poses)
            outliers += findings["pose_outliers"].found
    assert outliers < poses / 1000


def test_lidar_slam_of_the_maebot_is_kept_and_its_clocks_agree(importer: Importer) -> None:
    recording = importer.read("maebot", importer.data / "maebot_convex/convex.log")
    findings = check(recording)
    assert findings["pose_outliers"].found <= 0.005 * len(recording.poses)
    assert findings["pose_jumps"].found == findings["poses_held"].found == 0
    lag = findings.lag("poses")
    assert lag is not None
    assert abs(lag.seconds) < 0.03


def test_the_mbots_wheels_follow_their_commands_and_nothing_is_set_aside(importer: Importer) -> None:
    recording = importer.read("mbot", importer.data / "mbot_square/drive_square.log")
    findings = check(recording)
    assert all(signal is recording.signals[name] for name, signal in findings.cleaned(recording).signals.items())
    lag = findings.lag("wheels")
    assert lag is not None
    assert 0.0 < lag.seconds < 0.2


def test_lidar_that_gets_lost_on_grass_is_found_and_most_of_what_it_says_then_set_aside(importer: Importer) -> None:
    recording = importer.read("husky_wet_grass", importer.data / "husky_wet_grass/husky_wet_grass.csv.gz")
    findings = check(recording)
    cleaned = findings.cleaned(recording)
    time, kept = recording.poses.seconds, np.isin(recording.poses.utime, cleaned.poses.utime)
    lost = (time > 94.0) & (time < 110.0)  # poses metres apart within 0.1 s
    assert np.mean(~kept[lost]) > 0.5
    assert np.mean(kept[~lost]) > 0.99
    assert widest_steps(cleaned, findings.splits) < 0.5 * widest_steps(recording, findings.splits)

"""What the check of first poses promises: those older than their piece are set aside, and all others stay."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml

from cmr.recordings.faults.checks import check
from cmr.recordings.faults.stale_poses import stale_poses
from cmr.recordings.recording import Recording
from cmr.recordings.signal import SECONDS, Mask, Signal
from cmr_tools.importing.import_log import main
from cmr_tools.importing.mapping import SHIPPED
from scripts.score_real_data import DATA
from tests.recordings.drives_in_pieces import Shape, drawn, recorded
from tests.support.lanes import further

pytestmark = pytest.mark.slow

STEADY = Shape(seed=5, lengths=(3.0,) * 40, manner="held", noise=0.004, wheels=50.0)


def first_poses(recording: Recording) -> Mask:
    """Tell which poses are the first of a piece."""
    return np.diff(recording.poses.utime, prepend=0) * SECONDS > 1.0


def with_old_first_poses(whole: Recording, age: float) -> Recording:
    """Cut off the beginning of each piece but its first pose, which then stands where the rest begins."""
    begins = whole.poses.utime[first_poses(whole)]
    new_begins = begins + round(age / SECONDS)

    def is_kept(signal: Signal) -> Mask:
        number = np.maximum(np.searchsorted(begins, signal.utime, side="right") - 1, 0)
        return np.asarray(signal.utime >= new_begins[number])

    rest = whole.where({name: is_kept(signal) for name, signal in whole.signals.items() if name != "poses"})
    poses = whole.poses.where(is_kept(whole.poses) | first_poses(whole))
    utime = np.where(first_poses(whole)[is_kept(whole.poses) | first_poses(whole)], 0, poses.utime)
    utime[utime == 0] = new_begins
    return replace(rest, poses=replace(poses, utime=utime))


@pytest.mark.parametrize("latency", [0.0, 0.25])
@pytest.mark.parametrize("frame", ["own", "world"])
def test_first_poses_that_are_older_than_their_piece_are_set_aside(frame: str, latency: float) -> None:
    recording = with_old_first_poses(recorded(replace(STEADY, frame=frame, latency=latency)), 0.08)
    findings = check(recording)
    assert findings["stale_poses"].found == 40
    assert "on average by 0.08 s: 40 poses set aside" in findings["stale_poses"].sentence
    assert not first_poses(recording)[~findings["stale_poses"].set_aside["poses"]].any()
    assert len(findings.cleaned(recording).poses) <= len(recording.poses) - 40


def test_what_is_set_aside_is_told_of_all_samples_though_some_are_damaged() -> None:
    recording = with_old_first_poses(recorded(STEADY), 0.08)
    x = recording.poses["x"].copy()
    x[7] = 1e12
    fields = recording.poses.fields | {"x": x}
    findings = check(replace(recording, poses=replace(recording.poses, fields=fields)))
    assert findings["damaged_samples"].found == 1
    np.testing.assert_array_equal(findings["stale_poses"].set_aside["poses"], first_poses(recording))


@pytest.mark.parametrize("latency", [0.0, 0.25])
def test_first_poses_that_are_as_old_as_they_say_stay(latency: float) -> None:
    recording = recorded(replace(STEADY, latency=latency))
    assert check(recording)["stale_poses"].found == 0


@pytest.mark.parametrize("latency", [*further(0.0), 0.3])
def test_no_first_pose_of_a_clean_recording_is_called_stale(latency: float) -> None:
    for seed in range(12):  # scripts/check_clean_drives looks at hundreds
        assert stale_poses(recorded(replace(drawn(seed), latency=latency))).found == 0, seed


def test_a_recording_without_poses_or_without_wheels_has_no_stale_poses() -> None:
    assert check(recorded(replace(STEADY, wheels=0.0)))["stale_poses"].found == 0
    whole = recorded(STEADY)
    assert check(replace(whole, poses=whole.poses.between(0, 0)))["stale_poses"].found == 0


def test_old_logs_of_the_husky_on_tile_have_stale_poses_and_new_ones_none(tmp_path: Path) -> None:
    recording = DATA / "husky_tile" / "husky_tile.csv.gz"
    if not recording.exists():
        pytest.skip(f"measured data is not here: {recording}")
    found = {}
    for first in ("kept", "left_out"):
        mapping = yaml.safe_load((SHIPPED / "husky_tile.yaml").read_text())
        mapping["pose"]["first_of_piece"] = first
        (tmp_path / "tile.yaml").write_text(yaml.safe_dump(mapping))
        assert main([str(tmp_path / "tile.yaml"), str(recording), "--out", str(tmp_path / "run.lcm")]) == 0
        found[first] = check(Recording.read(tmp_path / "run.lcm"))["stale_poses"].found
    assert found == {"kept": 600, "left_out": 0}

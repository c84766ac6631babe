"""What the checks of poses promise: faults of the tracker are found, and true poses stay, however the robot drives."""

import itertools
import re
from dataclasses import replace

import numpy as np
import pytest

from cmr.recordings.faults.checks import check
from tests.support.emulated_drive import DEFAULT, figure_eight
from tests.support.faulty_drive import (
    Duties,
    by_lidar,
    later,
    lively,
    moved,
    placed,
    recording,
    scattered,
    set_aside,
    without,
)
from tests.support.lanes import further

pytestmark = pytest.mark.slow

PERIOD = 0.02  # s between two poses of the emulated drives
NOISE = DEFAULT.imperfections.pose_noise.position  # m


@pytest.mark.parametrize(
    "kind", ["as recorded", "lidar alone", *further("lidar", "poses alone", "poses and commands", "late")]
)
def test_fewer_than_one_true_pose_in_10_000_is_called_an_outlier(kind: str) -> None:
    total = outliers = 0
    for duties, seed in itertools.product((figure_eight, lively), range(3)):
        whole = recording(duties, seed)
        for noise_seed in range(4):
            noisy = by_lidar(whole, noise_seed, 0.003, 1)
            if "lidar" in kind:
                noisy = by_lidar(whole, noise_seed)
            if "poses" in kind or "alone" in kind:
                noisy = without(noisy, "wheels", "gyro", *(["commands"] if "alone" in kind else []))
            if kind == "late":
                noisy = later(noisy, "poses", 0.3)
            findings = check(noisy)
            assert findings["pose_jumps"].found == 0
            assert findings["poses_held"].found == 0
            total += len(noisy.poses)
            outliers += findings["pose_outliers"].found
    assert outliers <= total / 10_000


@pytest.mark.parametrize("every", [1, 10])
@pytest.mark.parametrize("seconds", [0.2, 0.8, 3.0])
def test_wheels_that_spin_are_no_fault_of_the_tracker(every: int, seconds: float) -> None:
    whole = by_lidar(recording(), 1, 0.003 if every == 1 else 0.03, every)
    time = whole.wheels.seconds
    spinning = (time > 12.0) & (time < 12.0 + seconds)
    faster = {
        name: np.where(spinning, 2.0 * values, values) if name.startswith("psi") else values
        for name, values in whole.wheels.fields.items()
    }
    findings = check(replace(whole, wheels=replace(whole.wheels, fields=faster)))
    assert findings["pose_jumps"].found == 0
    assert findings["pose_outliers"].found == 0


@pytest.mark.parametrize("duties", [figure_eight, lively])
@pytest.mark.parametrize("sensors", ["all", "poses alone", "clocks apart"])
@pytest.mark.parametrize(("least", "burst"), [(7 * NOISE, 1), (0.05, 3), (0.5, 1), (1.0, 5), (2.0, 10)])
def test_outliers_of_every_size_beyond_the_noise_are_set_aside(
    duties: Duties, sensors: str, least: float, burst: int
) -> None:
    whole = recording(duties, 3)
    if sensors == "poses alone":
        whole = without(whole, "wheels", "gyro", "commands")
    if sensors == "clocks apart":
        whole = later(whole, "poses", -1.4)
    faulty, wrong = scattered(whole, 5, least, burst=burst)
    findings = check(faulty)
    found = set_aside(findings, "pose_outliers", "poses")
    assert np.count_nonzero(found & wrong) >= 0.95 * np.count_nonzero(wrong)
    assert np.count_nonzero(found & ~wrong) <= 1
    assert findings["pose_jumps"].found == 0
    if least >= 0.05:
        assert found[wrong].all()
    cleaned = findings.cleaned(faulty)
    assert len(cleaned.poses) == len(faulty.poses) - findings["pose_outliers"].found
    assert cleaned.wheels is faulty.wheels


@pytest.mark.parametrize("turn", [0.3, 1.5, 3.1, -3.1])
def test_headings_that_cannot_be_are_set_aside_and_do_not_spoil_those_around(turn: float) -> None:
    whole = recording(figure_eight, 3)
    wrong = np.random.default_rng(1).uniform(size=len(whole.poses)) < 0.02
    theta = whole.poses["theta"] + turn * wrong
    findings = check(placed(whole, whole.poses["x"], whole.poses["y"], theta))
    assert np.array_equal(set_aside(findings, "pose_outliers", "poses"), wrong)
    assert findings["pose_jumps"].found == 0


def test_outliers_of_a_lidar_are_set_aside() -> None:
    faulty, wrong = scattered(by_lidar(recording(figure_eight, 3), 3), 5, 0.4, share=0.05)
    assert np.array_equal(set_aside(check(faulty), "pose_outliers", "poses"), wrong)


@pytest.mark.parametrize(("shift", "turn"), [(0.1, 0.0), (1.0 + 1.0j, 0.0), (0.0, 0.5), (2.0, 3.0), (0.5, -1.5)])
@pytest.mark.parametrize("sensors", ["all", "poses alone"])
def test_a_jump_of_the_tracker_splits_the_path_there(shift: complex, turn: float, sensors: str) -> None:
    whole = recording(figure_eight, 4)
    if sensors == "poses alone":
        whole = without(whole, "wheels", "gyro", "commands")
    at = 700
    findings = check(moved(whole, slice(at, None), shift, turn))
    assert findings["pose_jumps"].found == 1
    # The pose at the jump may itself be set aside; noise may move a small jump by one.
    assert abs(int(findings.splits[0]) - int(whole.poses.utime[at])) <= PERIOD * 1e6
    assert findings["pose_outliers"].found <= 1
    assert findings["pose_headings_turned"].found == 0


@pytest.mark.parametrize("duties", [figure_eight, lively])
@pytest.mark.parametrize("turn", [0.3, -0.3, 1.5, 3.0])
@pytest.mark.parametrize("known_by", ["wheels", "commands"])
def test_headings_that_a_jump_turned_against_the_way_the_robot_goes_are_set_aside(
    duties: Duties, turn: float, known_by: str
) -> None:
    whole = recording(duties, 4)
    whole = without(whole, "wheels") if known_by == "commands" else whole
    poses, after = whole.poses, np.arange(len(whole.poses)) >= 1000
    slipped = placed(whole, poses["x"], poses["y"] + 0.4 * after, poses["theta"] + turn * after)
    findings = check(slipped)
    assert findings["pose_jumps"].found == 1
    gone = set_aside(findings, "pose_headings_turned", "poses")
    assert np.count_nonzero(gone != after) <= 1
    told = re.search(r"turned by (\d+) degrees", findings["pose_headings_turned"].sentence)
    assert told is not None
    assert float(told[1]) == pytest.approx(np.degrees(abs(turn)), abs=2.0)


@pytest.mark.parametrize("angle", [0.5, np.pi])
@pytest.mark.parametrize("arm", [0.15, -0.15 + 0.1j])
def test_a_tracked_point_off_the_middle_and_a_heading_off_the_front_throughout_are_no_fault_after_a_jump(
    arm: complex, angle: float
) -> None:
    for duties in (figure_eight, lively):
        whole = recording(duties, 4)
        place = arm * np.exp(1j * whole.poses["theta"])
        poses = whole.poses
        off = placed(whole, poses["x"] + place.real, poses["y"] + place.imag, poses["theta"] + angle)
        findings = check(moved(off, slice(700, None), 0.4, 1.0))
        assert findings["pose_jumps"].found == 1
        assert findings["pose_headings_turned"].found == 0


def test_jumps_are_found_among_outliers() -> None:
    whole, at = recording(figure_eight, 4), (400, 700, 1100)
    for place in at:
        whole = moved(whole, slice(place, None), 0.4 - 0.3j, 0.2)
    faulty, wrong = scattered(whole, 6, 1.0)
    findings = check(faulty)
    assert findings["pose_jumps"].found == 3
    for split, place in zip(findings.splits, at, strict=True):
        assert abs(int(split) - int(whole.poses.utime[place])) <= 2 * PERIOD * 1e6
    assert set_aside(findings, "pose_outliers", "poses")[wrong].all()


def test_a_path_that_jumps_and_comes_back_was_wrong_in_between() -> None:
    whole = recording(figure_eight, 4)
    for count in (12, 50, 120):
        away = slice(700, 700 + count)
        findings = check(moved(whole, away, 0.8, 0.0))
        assert findings["pose_jumps"].found == 0
        expected = np.zeros(len(whole.poses), np.bool_)
        expected[away] = True
        assert np.array_equal(set_aside(findings, "pose_outliers", "poses"), expected)


def test_poses_that_are_held_while_the_robot_moves_are_set_aside_and_those_at_rest_are_not() -> None:
    whole = recording(figure_eight, 4)
    poses = whole.poses
    source = np.arange(len(poses))
    source[700:740] = 699
    source[:60] = 0  # the robot rests for 1.5 s, 75 poses
    held = placed(whole, *(poses[name][source] for name in ("x", "y", "theta")))
    findings = check(held)
    assert np.flatnonzero(set_aside(findings, "poses_held", "poses")).tolist() == list(range(700, 740))
    assert findings["pose_outliers"].found == findings["pose_jumps"].found == 0


def test_of_poses_published_more_often_than_they_are_measured_each_is_used_once() -> None:
    whole = recording(figure_eight, 4)
    source = np.arange(len(whole.poses)) // 5 * 5
    findings = check(placed(whole, *(whole.poses[name][source] for name in ("x", "y", "theta"))))
    driving = (whole.poses.seconds > 2.0) & (whole.poses.seconds < 31.0)
    repeats = source != np.arange(len(source))
    assert np.array_equal(set_aside(findings, "poses_held", "poses")[driving], repeats[driving])
    assert findings["pose_outliers"].found == 0

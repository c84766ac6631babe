"""What the checks promise: faults put into a drive are found, and a drive without faults stays as it is."""

import itertools
import math
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cmr.bus.messages import make
from cmr.msg import gyro_t, motor_command_t, motor_feedback_t, pose_xyt_t
from cmr.recordings import Recorder, Recording
from cmr.recordings.checks import Findings, check
from cmr.recordings.lags import lags_of
from cmr.recordings.signal import Floats, Mask, Signal
from tests.emulated_drive import DEFAULT, EPOCH, figure_eight, messages

Duties = Callable[[float], tuple[float, float]]
PERIOD = 0.02  # s between two poses of the emulated drives
NOISE = DEFAULT.imperfections.pose_noise.position  # m
# What finds nothing in a drive without faults.
FAULTS = {
    "pose_outliers",
    "pose_jumps",
    "poses_held",
    "encoder_spikes",
    "encoder_resets",
    "encoder_stuck",
    "damaged_samples",
    "poses_clock",
    "gyro_clock",
    "never_moved",
    "late_start",
    "cut_off",
    "gaps",
    "uneven_rates",
    "damaged_log",
    "rejected_messages",
    "unusable_messages",
    "repeated_times",
    "late_messages",
}


def lively(share: float) -> tuple[float, float]:
    """Fast turns both ways, reversals and abrupt starts."""
    time = 30.0 * share
    return 0.5 * math.sin(1.3 * time) + 0.3 * math.sin(5.0 * time), 0.5 * math.sin(1.1 * time + 1.0)


def circle(_share: float) -> tuple[float, float]:
    return 0.2, 0.5


@cache
def recording(duties: Duties = figure_eight, seed: int = 0) -> Recording:
    recorder = Recorder(0)
    for channel, message in messages(duties=duties, seed=seed):
        recorder.handle(message.utime, channel, message)
    return recorder.recording()


def without(whole: Recording, *names: str) -> Recording:
    return whole.where({name: np.zeros(len(whole.signals[name]), np.bool_) for name in names})


def placed(whole: Recording, x: Floats, y: Floats, theta: Floats) -> Recording:
    fields = {"x": x, "y": y, "theta": np.remainder(theta + np.pi, 2.0 * np.pi) - np.pi}
    return replace(whole, poses=replace(whole.poses, fields=fields))


def moved(whole: Recording, at: Mask | slice, shift: complex, turn: float = 0.0) -> Recording:
    """Return the recording with the poses `at` turned about the origin and shifted."""
    poses = whole.poses
    place, theta = poses["x"] + 1j * poses["y"], poses["theta"].copy()
    place[at] = place[at] * np.exp(1j * turn) + shift
    theta[at] += turn
    return placed(whole, place.real, place.imag, theta)


def by_lidar(whole: Recording, seed: int, noise: float = 0.03, every: int = 10) -> Recording:
    """Return the recording with fewer and noisier poses."""
    rng = np.random.default_rng(seed)
    whole = whole.where({"poses": np.arange(len(whole.poses)) % every == 0})
    poses, count = whole.poses, len(whole.poses)
    x, y = (poses[name] + rng.normal(0.0, noise, count) for name in ("x", "y"))
    return placed(whole, x, y, poses["theta"] + rng.normal(0.0, 0.02, count))


def later(whole: Recording, name: str, seconds: float) -> Recording:
    signal = whole.signals[name]
    delayed: dict[str, Signal] = {name: replace(signal, utime=signal.utime + round(seconds * 1e6))}
    return replace(whole, **delayed)  # type: ignore[arg-type]


def scattered(whole: Recording, seed: int, least: float, share: float = 0.02, burst: int = 1) -> tuple[Recording, Mask]:
    """Return the recording with outliers of `least` to twice that many metres, and where they are."""
    rng = np.random.default_rng(seed)
    count = len(whole.poses)
    wrong = np.zeros(count, np.bool_)
    while np.count_nonzero(wrong) < share * count:
        first = rng.integers(1, count - burst)
        if burst == 1 or not wrong[max(first - 12, 0) : first + burst + 12].any():
            wrong[first : first + burst] = True
    off = least * rng.uniform(1.0, 2.0, count) * np.exp(2j * np.pi * rng.uniform(size=count))
    return moved(whole, wrong, off[wrong]), wrong


def set_aside(findings: Findings, check_name: str, signal: str) -> Mask:
    return findings[check_name].set_aside[signal]


def test_drives_without_faults_stay_as_they_are() -> None:
    for duties, seed in itertools.product((figure_eight, lively, circle), (1, 2)):
        whole = recording(duties, seed)
        findings = check(whole)
        assert {finding.check for finding in findings.all} == FAULTS
        assert findings.sentences() == []
        assert [found["found"] for found in findings.data_checks()] == [0] * len(FAULTS)
        for name, signal in findings.cleaned(whole).signals.items():
            assert signal is whole.signals[name]


@pytest.mark.parametrize("kind", ["as recorded", "lidar", "poses alone", "poses and commands", "lidar alone", "late"])
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


@pytest.mark.parametrize("seconds", [-1.9, -0.2, 0.013, 0.5, 1.9])
@pytest.mark.parametrize("duties", [figure_eight, lively])
def test_the_time_by_which_poses_are_late_is_found_to_a_fraction_of_a_sample(seconds: float, duties: Duties) -> None:
    faulty, _ = scattered(later(recording(duties, 5), "poses", seconds), 7, 1.0)
    lag = next(lag for lag in lags_of(faulty) if lag.sensor == "poses")
    assert lag.known
    # The emulated ground follows the wheels by 2 ms.
    assert abs(lag.seconds - seconds - 0.002) < 4.0 * lag.std
    assert lag.std < PERIOD / 2.0
    found = check(faulty)["poses_clock"]
    assert found.found == (abs(seconds) > 0.03)
    assert ("behind" if seconds > 0.0 else "ahead") in found.sentence


@pytest.mark.parametrize("seconds", [-1.9, 0.1, 0.7])
def test_the_time_by_which_the_gyro_is_late_is_found(seconds: float) -> None:
    lag = check(later(recording(lively, 5), "gyro", seconds)).lag("gyro")
    assert lag is not None
    # The emulated gyro gives the mean rate since the sample before, so it is 5 ms late by itself.
    assert abs(lag.seconds - seconds - 0.005) < 4.0 * lag.std + 0.001


def test_wheels_follow_their_commands_by_about_the_motors_time_constant() -> None:
    truth = DEFAULT.robot
    lag = check(recording(lively, 5)).lag("wheels")
    assert lag is not None
    assert 0.5 / (truth.k1 * truth.k2_over_k3) < lag.seconds < 1.1 / (truth.k1 * truth.k2_over_k3)


def test_the_scatter_of_lags_is_as_large_as_their_standard_deviation_says() -> None:
    errors = []
    for seed in range(12):
        lag = next(lag for lag in lags_of(recording(lively, seed)) if lag.sensor == "poses")
        errors.append((lag.seconds - 0.002) / lag.std)
    # The mean square of 12 is above 2.75 in one of 1,000 cases (chi-square); far below 1 the deviations say nothing.
    assert 0.1 < np.mean(np.square(errors)) < 2.75


def test_lags_are_unknown_where_nothing_changes() -> None:
    rest = recording(at_rest, 1)
    assert all(not lag.known and lag.why_unknown for lag in lags_of(rest))
    steady = recording(circle, 1)
    middle = steady.between(EPOCH + 5_000_000, EPOCH + 30_000_000)
    assert check(middle).lag("poses") is None
    assert "cannot be compared" in check(middle)["poses_clock"].sentence
    assert check(middle)["poses_clock"].found == 0


def at_rest(_share: float) -> tuple[float, float]:
    return 0.0, 0.0


def test_absurd_encoder_readings_are_set_aside() -> None:
    whole = recording(lively, 6)
    wrong = np.zeros(len(whole.wheels), np.bool_)
    wrong[[500, 900, 901, 2000]] = True
    fields = {name: values.copy() for name, values in whole.wheels.fields.items()}
    fields["psi_left"][wrong] = 4e4
    findings = check(replace(whole, wheels=replace(whole.wheels, fields=fields)))
    assert np.array_equal(set_aside(findings, "encoder_spikes", "wheels"), wrong)
    assert findings["pose_outliers"].found == findings["encoder_stuck"].found == 0


def test_a_single_wild_counter_is_a_spike_and_one_that_starts_anew_a_reset() -> None:
    whole = recording(lively, 6)
    ticks = whole.wheels["ticks_right"].copy()
    ticks[1000] += 1e6
    ticks[2000:] -= ticks[2000] + 5e4
    fields = whole.wheels.fields | {"ticks_right": ticks}
    findings = check(replace(whole, wheels=replace(whole.wheels, fields=fields)))
    assert np.flatnonzero(set_aside(findings, "encoder_spikes", "wheels")).tolist() == [1000]
    assert findings["encoder_resets"].found == 1


@pytest.mark.parametrize("since", [0.0, 15.0])
def test_an_encoder_that_says_nothing_any_more_is_found_and_its_readings_set_aside(since: float) -> None:
    whole = recording(figure_eight, 6)
    dead = whole.wheels.seconds >= since
    fields = dict(whole.wheels.fields)
    fields["psi_right"] = np.where(dead, 0.0, fields["psi_right"])
    fields["ticks_right"] = np.where(dead, fields["ticks_right"][np.argmax(dead)], fields["ticks_right"])
    findings = check(replace(whole, wheels=replace(whole.wheels, fields=fields)))
    assert findings["encoder_stuck"].found > 100
    mask = set_aside(findings, "encoder_stuck", "wheels")
    assert mask[whole.wheels.seconds > since + 0.02].all()
    assert not mask[whole.wheels.seconds < since - 0.02].any()
    assert findings["pose_outliers"].found == findings["pose_jumps"].found == 0


def test_a_drive_about_a_wheel_that_is_not_driven_is_no_fault() -> None:
    def pivot(_share: float) -> tuple[float, float]:
        return 0.0, 0.4

    assert check(recording(pivot, 1))["encoder_stuck"].found == 0


def test_gaps_repeats_late_messages_and_damaged_values_are_told_with_their_numbers() -> None:
    recorder = Recorder(0)
    drive = messages(duties=lively)
    poses = [k for k, (channel, _) in enumerate(drive) if channel == "POSE_0"]
    skipped = set(poses[400:430]) | set(poses[900:950])
    late = poses[600]
    order = [k for k in range(len(drive)) if k not in skipped and k != late]
    order.insert(order.index(poses[602]) + 1, late)
    for k in order:
        channel, message = drive[k]
        for _ in range(2 if k == poses[700] else 1):
            recorder.handle(message.utime, channel, message)
    for utime, x in ((-5, 0.0), (EPOCH + 10_001, 1e300), (EPOCH + 20_001, math.nan)):
        recorder.handle(utime, "POSE_0", make(pose_xyt_t, utime=utime, robot_id=0, x=x, y=0.0, theta=0.0))
    findings = check(recorder.recording())
    found = {finding.check: finding.found for finding in findings.all if finding.found}
    assert found == {"gaps": 2, "repeated_times": 1, "late_messages": 1, "damaged_samples": 2, "unusable_messages": 1}
    assert "the longest is 1.02 s" in findings["gaps"].sentence
    assert "1 x poses not a finite number" in findings["unusable_messages"].sentence
    assert len(findings.cleaned(recorder.recording()).poses) == len(poses) - len(skipped)
    assert findings.rates["poses"] == pytest.approx(50.0)


def test_a_robot_that_never_moves_starts_late_or_is_cut_off_is_told() -> None:
    assert [finding.check for finding in check(recording(at_rest, 1)).all if finding.found] == ["never_moved"]
    whole = recording(figure_eight, 1)
    late = replace(whole, wheels=shifted_start(whole.wheels, 20.0), commands=shifted_start(whole.commands, 20.0))
    assert "21.5 s" in check(late)["late_start"].sentence
    cut = check(whole.between(EPOCH, EPOCH + 20_000_000))
    assert cut["cut_off"].found == 1
    assert check(whole)["cut_off"].found == 0


def shifted_start(signal: Signal, seconds: float) -> Signal:
    """Return the signal with a first sample, the same as at rest, so much earlier."""
    utime = np.append(signal.utime[0] - round(seconds * 1e6), signal.utime)
    fields = {name: np.append(values[0], values) for name, values in signal.fields.items()}
    return Signal(utime, fields)


def test_findings_are_those_of_the_recording_that_was_checked_and_name_its_samples() -> None:
    faulty, wrong = scattered(recording(figure_eight, 3), 5, 1.0)
    x = faulty.poses["x"].copy()
    x[:100:7] = 1e200  # damaged ones before, so that places shift
    faulty = replace(faulty, poses=replace(faulty.poses, fields=faulty.poses.fields | {"x": x}))
    findings = check(faulty)
    outliers = set_aside(findings, "pose_outliers", "poses")
    assert np.array_equal(outliers[100:], wrong[100:])
    assert np.count_nonzero(set_aside(findings, "damaged_samples", "poses")) == 15
    assert len(findings.cleaned(faulty).poses) == len(wrong) - np.count_nonzero(outliers) - 15
    assert check(findings.cleaned(faulty))["pose_outliers"].found == 0


def test_the_checks_need_no_scipy_whose_import_takes_most_of_a_second() -> None:
    code = "import sys, cmr.recordings.checks; sys.exit(any(name.split('.')[0] == 'scipy' for name in sys.modules))"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


TIMES = st.one_of(st.integers(0, 2_000_000), st.sampled_from([0, -(2**63), 2**63 - 1, EPOCH, EPOCH + 1]))
NUMBERS = st.one_of(
    st.floats(allow_nan=False, allow_infinity=False), st.sampled_from([0.0, 1.0, -0.0, 1e300, 1e9, 1e-300, math.nan])
)
MESSAGES = st.lists(
    st.tuples(st.sampled_from("CWGP"), TIMES, NUMBERS, NUMBERS, NUMBERS, st.integers(-(2**63), 2**63 - 1)), max_size=60
)


@settings(max_examples=200, deadline=None)
@given(messages=MESSAGES, spacing=st.sampled_from([0, 1, 10_000, 100_000, 2_000_000]))
def test_no_recording_is_so_odd_that_it_cannot_be_checked(
    messages: list[tuple[str, int, float, float, float, int]], spacing: int
) -> None:
    recorder = Recorder(0)
    for k, (kind, utime, a, b, c, ticks) in enumerate(messages):
        utime = EPOCH + k * spacing if spacing else utime
        if kind == "C":
            message = make(motor_command_t, utime=utime, robot_id=0, left=a, right=b)
            recorder.handle(utime, "MOTOR_COMMAND_0", message)
        elif kind == "G":
            message = make(gyro_t, utime=utime, robot_id=0, yaw_rate=a, valid=ticks % 2, received_utime=utime)
            recorder.handle(utime, "GYRO_0", message)
        elif kind == "P":
            recorder.handle(utime, "POSE_0", make(pose_xyt_t, utime=utime, robot_id=0, x=a, y=b, theta=c))
        else:
            values = dict.fromkeys(motor_feedback_t.__slots__, 0) | {
                "utime": utime,
                "ticks_left": ticks,
                "ticks_right": k,
                "psi_left": a,
                "psi_right": b,
                "applied_left": c,
            }
            recorder.handle(utime, "MOTOR_FEEDBACK_0", make(motor_feedback_t, **values))
    whole = recorder.recording()
    findings = check(whole)
    assert all(finding.sentence and finding.found >= 0 for finding in findings.all)
    kept = findings.cleaned(whole)
    again = check(kept)
    assert again["damaged_samples"].found == 0
    for name, signal in whole.signals.items():
        masks = [finding.set_aside[name] for finding in findings.all if name in finding.set_aside]
        dropped = np.logical_or.reduce(masks) if masks else np.zeros(len(signal), np.bool_)
        assert len(kept.signals[name]) == len(signal) - np.count_nonzero(dropped)

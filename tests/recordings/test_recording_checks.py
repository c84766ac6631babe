"""What the checks promise: faults put into a drive are found, and a drive without faults stays as it is."""

import itertools
import math
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cmr.bus.messages import make
from cmr.msg import gyro_t, motor_command_t, motor_feedback_t, pose_xyt_t
from cmr.recordings import Recorder, Recording
from cmr.recordings.arrivals import KEPT, Kept
from cmr.recordings.faults.checks import check
from cmr.recordings.signal import Floats, Signal
from tests.support.emulated_drive import EPOCH, figure_eight, messages, write_log
from tests.support.faulty_drive import (
    at_rest,
    circle,
    lively,
    recording,
    scattered,
    set_aside,
)

pytestmark = pytest.mark.slow

# What finds nothing in a drive without faults.
FAULTS = {
    "pose_outliers",
    "pose_jumps",
    "pose_headings_turned",
    "poses_held",
    "stale_poses",
    "wheels_late",
    "encoder_spikes",
    "encoder_resets",
    "encoder_stuck",
    "dead_sensors",
    "gyro_reversed",
    "gyro_factor",
    "damaged_samples",
    "poses_clock",
    "gyro_clock",
    "never_moved",
    "late_start",
    "commands_not_in_force",
    "cut_off",
    "gaps",
    "uneven_rates",
    "uneven_stamps",
    "held_up_readings",
    "damaged_log",
    "rejected_messages",
    "unusable_messages",
    "repeated_times",
    "late_messages",
}


def test_drives_without_faults_stay_as_they_are() -> None:
    for duties, seed in itertools.product((figure_eight, lively, circle), (1, 2)):
        whole = recording(duties, seed)
        findings = check(whole)
        assert {finding.check for finding in findings.all} == FAULTS
        assert findings.sentences() == []
        assert [found["found"] for found in findings.data_checks()] == [0] * len(FAULTS)
        for name, signal in findings.cleaned(whole).signals.items():
            assert signal is whole.signals[name]


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


def test_counters_that_went_on_through_a_gap_are_no_reset_and_those_that_did_not_are() -> None:
    whole = recording(lively, 6)
    seconds = whole.wheels.seconds
    gap = whole.where({"wheels": (seconds < 12.0) | (seconds > 14.5)})
    assert check(gap)["gaps"].found == 1
    assert check(gap)["encoder_resets"].found == 0
    after = gap.wheels.seconds > 13.0
    ticks = {name: gap.wheels[name] - 1e6 * after for name in ("ticks_left", "ticks_right")}
    again = replace(gap, wheels=replace(gap.wheels, fields=gap.wheels.fields | ticks))
    assert check(again)["encoder_resets"].found == 2


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


@pytest.mark.parametrize("dead", ["wheels", "gyro"])
def test_a_sensor_that_always_says_the_same_is_set_aside_if_the_robot_moves(dead: str) -> None:
    for duties, found in ((figure_eight, 1), (at_rest, 0)):
        whole = recording(duties, 6)
        silent = {name: np.zeros_like(values) for name, values in whole.signals[dead].fields.items()}
        kinds: dict[str, Signal] = {dead: replace(whole.signals[dead], fields=silent)}
        whole = replace(whole, **kinds)  # type: ignore[arg-type]
        findings = check(whole)
        assert findings["dead_sensors"].found == found
        assert len(findings.cleaned(whole).signals[dead]) == (0 if found else len(whole.signals[dead]))
        assert findings["never_moved"].found == 1 - found
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


def test_what_a_log_has_lost_is_told(tmp_path: Path) -> None:
    log = write_log(tmp_path / "run.lcm", messages(duties=lively, seconds=10.0))
    foreign = make(pose_xyt_t, utime=EPOCH, robot_id=1, x=0.0, y=0.0, theta=0.0)
    whole = log.read_bytes()
    write_log(log, [("POSE_0", foreign), ("NOBODYS", foreign)])
    log.write_bytes(log.read_bytes() + whole[: len(whole) // 2])
    findings = check(Recording.read(log))
    assert findings["rejected_messages"].found == 2
    assert "1 x POSE_0 wrong_robot" in findings["rejected_messages"].sentence
    assert "1 x NOBODYS unknown_channel" in findings["rejected_messages"].sentence
    assert 0 < findings["damaged_log"].found < 200  # one event
    assert findings["cut_off"].found == 1


def test_uneven_intervals_are_told_and_unequal_rates_of_sensors_are_no_fault() -> None:
    whole = recording(figure_eight, 1)
    seldom = whole.where({"poses": np.arange(len(whole.poses)) % 5 == 0})
    assert check(seldom)["uneven_rates"].found == 0
    assert check(seldom).rates == pytest.approx({"commands": 50.0, "wheels": 100.0, "gyro": 100.0, "poses": 10.0})
    uneven = whole.where({"poses": np.arange(len(whole.poses)) % 7 < 5})
    assert check(uneven)["uneven_rates"].found == 1
    assert "poses" in check(uneven)["uneven_rates"].sentence


def test_a_robot_that_never_moves_starts_late_or_is_cut_off_is_told() -> None:
    assert [finding.check for finding in check(recording(at_rest, 1)).all if finding.found] == ["never_moved"]
    whole = recording(figure_eight, 1)
    late = replace(whole, wheels=shifted_start(whole.wheels, 20.0), commands=shifted_start(whole.commands, 20.0))
    assert "21.5 s" in check(late)["late_start"].sentence
    cut = check(whole.between(EPOCH, EPOCH + 20_000_000))
    assert cut["cut_off"].found == 1
    assert check(whole)["cut_off"].found == 0


def shifted_start(signal: Signal, seconds: float) -> Signal:
    """Return the signal with samples, the same as at rest, from so much earlier on."""
    before = signal.utime[0] - np.arange(round(seconds * 1e6), 0, -100_000)
    utime = np.append(before, signal.utime)
    fields = {name: np.append(np.full(len(before), values[0]), values) for name, values in signal.fields.items()}
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
    code = (
        "import sys, cmr.recordings.faults.checks; sys.exit(any(name.split('.')[0] == 'scipy' for name in sys.modules))"
    )
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


TIMES = st.one_of(st.integers(0, 2_000_000), st.sampled_from([0, -(2**63), 2**63 - 1, EPOCH, EPOCH + 1]))
NUMBERS = st.one_of(
    st.floats(allow_nan=False, allow_infinity=False), st.sampled_from([0.0, 1.0, -0.0, 1e300, 1e9, 1e-300, math.nan])
)
MESSAGES = st.lists(
    st.tuples(st.sampled_from("CWGP"), TIMES, NUMBERS, NUMBERS, NUMBERS, st.integers(-(2**63), 2**63 - 1)), max_size=60
)


def values_of_a_kind(rng: np.random.Generator, count: int) -> Floats:
    """Return values as a broken sensor gives them, of one of several kinds."""
    return (
        np.zeros(count),
        np.full(count, rng.normal()),
        rng.normal(0.0, 10.0 ** rng.uniform(-6, 6), count),
        np.cumsum(rng.normal(size=count)),
        np.sin(np.arange(count) * rng.uniform(0.0, 2.0)),
        np.repeat(rng.normal(size=count // 7 + 1), 7)[:count],
        np.where(rng.uniform(size=count) < 0.1, 1e300, rng.normal(size=count)),
        np.where(rng.uniform(size=count) < 0.5, 1e-300, 0.0),
    )[rng.integers(8)]


def signal_of_a_kind(rng: np.random.Generator, kept: Kept) -> Signal:
    """Return a signal of any length and any kind of time steps."""
    count = int(rng.choice([0, 1, 2, 3, 11, 12, 60, 250, 1000]))
    steps = (
        np.full(count, 10_000),
        np.ones(count, np.int64),
        rng.integers(1, 50_000, count),
        np.where(rng.uniform(size=count) < 0.05, 10**9, 20_000),
    )[rng.integers(4)]
    utime = EPOCH + rng.integers(10**6) + np.cumsum(steps)
    return Signal(utime, {name: values_of_a_kind(rng, count) for name in kept.fields}, rng.permutation(count))


@pytest.mark.filterwarnings("error")
def test_sensors_broken_in_any_way_neither_stop_the_checks_nor_make_them_overflow() -> None:
    for seed in range(150):
        rng = np.random.default_rng(seed)
        signals = {name: signal_of_a_kind(rng, kept) for name, kept in KEPT.items()}
        whole = Recording(0, **signals)  # type: ignore[arg-type]
        findings = check(whole)
        values = {
            name: [of for key, of in signal.fields.items() if not key.endswith("utime")]
            for name, signal in whole.signals.items()
        }
        assert findings["damaged_samples"].found == sum(
            int(np.count_nonzero(np.any(np.abs(of) > 1e9, axis=0))) for of in values.values()
        )
        findings.cleaned(whole)


@settings(max_examples=100, deadline=None)
@given(messages=MESSAGES, spacing=st.sampled_from([0, 1, 10_000, 100_000, 2_000_000]))
def test_no_recording_is_so_odd_that_it_cannot_be_checked(
    messages: list[tuple[str, int, float, float, float, int]], spacing: int
) -> None:
    recorder = Recorder(0)
    for k, (kind, utime, a, b, c, ticks) in enumerate(messages):
        utime = EPOCH + k * spacing if spacing else utime
        if kind == "C":
            command = make(motor_command_t, utime=utime, robot_id=0, left=a, right=b)
            recorder.handle(utime, "MOTOR_COMMAND_0", command)
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

"""What a diagnosis does with recordings that lack something: it says so, sets them aside, and makes nothing up."""

from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from cmr.diagnosis.diagnose import diagnose
from cmr.diagnosis.document import extended_file
from cmr.diagnosis.job import Job, JobError, perform
from cmr.diagnosis.result import BAD_DATA, Diagnosis
from cmr.estimation.estimates import EstimationError
from cmr.geometry.manoeuvres import MANOEUVRES
from cmr.model.parameters import DEFINITIONS as PAPER
from cmr.parameters.file import ParameterFile, Value, load
from cmr.recordings.arrivals import NOT_FINITE
from cmr.recordings.lags import Lag, lags_of
from cmr.recordings.recording import Recording
from tests.hidden_effects import hidden_recording
from tests.hidden_effects.logs import write_log
from tests.reference_plant import NEUTRAL, REALISTIC, packets, recording
from tests.support.faulty_drive import later, without
from tests.support.lanes import further

pytestmark = pytest.mark.slow

RADIUS = Value(NEUTRAL.wheel_radius)
WIDTH = Value(NEUTRAL.base_width)


@cache
def drive(begin: float = 0.0, end: float = 30.0) -> Recording:
    """Return a part of a rich drive [s] of a robot without any effect."""
    whole = hidden_recording(manoeuvre="rich", seed=21).recording
    first = int(whole.wheels.utime[0])
    return whole.between(first + round(begin * 1e6), first + round(end * 1e6))


def named(*recordings: Recording) -> Diagnosis:
    """Return the diagnosis of recordings that are called 0.lcm, 1.lcm and so on."""
    return diagnose(recordings, sources=[f"{number}.lcm" for number in range(len(recordings))])


@cache
def sound() -> Diagnosis:
    """Return the diagnosis of a drive that lacks nothing."""
    return named(drive())


@pytest.mark.parametrize(
    ("lost", "missing"),
    [(("poses", "gyro"), "POSE_N"), *further((("wheels", "commands"), "MOTOR_FEEDBACK_N"))],
)
def test_of_several_recordings_one_that_lacks_a_sensor_is_set_aside_by_name(lost: Sequence[str], missing: str) -> None:
    found = named(without(drive(30.0, 60.0), *lost), drive())
    (note,) = [note for note in found.notes if "set aside" in note]
    assert note.startswith("0.lcm is set aside. ")
    assert missing in note
    assert found.sources == ("1.lcm",)
    assert [path.label for path in found.evidence.paths] == ["1.lcm"]
    assert found.parameters == pytest.approx(sound().parameters)


def test_of_several_recordings_none_of_use_are_refused_each_with_its_reason() -> None:
    found = named(without(drive(), "wheels", "commands"), without(drive(), "poses", "gyro"))
    assert found.verdict == BAD_DATA
    assert found.sentence.startswith("0.lcm: Neither wheels (MOTOR_FEEDBACK_N) nor commands")
    assert "1.lcm: Neither poses (POSE_N) nor a gyro (GYRO_N) were recorded" in found.sentence


def faults(found: Diagnosis) -> set[str]:
    return {one.check for one in found.checks if one.found}


def gyro_times(whole: Recording, factor: float) -> Recording:
    return replace(whole, gyro=replace(whole.gyro, fields={"yaw_rate": factor * whole.gyro["yaw_rate"]}))


@pytest.mark.parametrize(
    ("factor", "fault", "said"),
    [(-1.0, "gyro_reversed", "--invert-gyro"), (np.degrees(1.0), "gyro_factor", "degrees per second")],
)
def test_a_gyro_that_is_upside_down_or_in_degrees_is_told_and_no_fault_of_the_robot(
    factor: float, fault: str, said: str
) -> None:
    found = named(gyro_times(drive(), factor))
    assert faults(found) - faults(sound()) == {fault}
    assert any(said in one.sentence for one in found.checks)
    assert found.verdict == "no_effect"


def test_where_only_a_gyro_that_is_upside_down_tells_of_the_motion_it_is_named() -> None:
    found = named(gyro_times(without(drive(), "poses"), -1.0))
    assert found.verdict == BAD_DATA
    assert "--invert-gyro" in found.sentence
    assert "were recorded" not in found.sentence


@pytest.mark.parametrize(("share", "verdict"), [(1.0, BAD_DATA), (0.6, BAD_DATA), (0.05, "no_effect")])
def test_poses_that_are_not_numbers_are_counted_and_most_of_them_refused(share: float, verdict: str) -> None:
    whole = drive()
    wrong = np.random.default_rng(1).permutation(len(whole.poses)) < share * len(whole.poses)
    kept = whole.poses.where(~wrong)
    found = named(replace(whole, poses=replace(kept, left_out={NOT_FINITE: int(wrong.sum())})))
    assert found.verdict == verdict
    if verdict == BAD_DATA:
        assert f"{wrong.sum()} of {len(wrong)} cannot be true ({wrong.sum()} are not numbers)" in found.sentence
    assert [one.found for one in found.checks if one.check == "unusable_messages"] == [wrong.sum()]


def test_headings_that_a_jump_of_the_tracker_turned_are_no_effect() -> None:
    whole = drive()
    poses, before = whole.poses, whole.poses.seconds < 8.0
    theta = np.remainder(poses["theta"] + 0.3 * before + np.pi, 2.0 * np.pi) - np.pi
    found = named(replace(whole, poses=replace(poses, fields={**poses.fields, "theta": theta})))
    assert faults(found) - faults(sound()) == {"pose_jumps", "pose_headings_turned"}
    assert found.verdict == "no_effect"


def test_recordings_with_and_without_commands_are_diagnosed_together() -> None:
    alone, both = sound(), named(drive(), without(drive(30.0, 60.0), "commands"))
    assert both.verdict == alone.verdict
    for name in PAPER:
        assert both.parameters[name] == pytest.approx(alone.parameters[name], rel=0.02)


def test_a_late_clock_of_held_out_poses_is_set_right_and_told_and_the_checks_run_once(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    checked = []

    def counting(recording: Recording) -> list[Lag]:
        checked.append(recording)
        return lags_of(recording)

    monkeypatch.setattr("cmr.recordings.faults.checks.lags_of", counting)
    other = drive(30.0, 60.0)
    found = diagnose(
        drive(), held_out=[later(other, "poses", 2.0)], sources=["fitted.lcm"], held_out_sources=["late.lcm"]
    )
    assert len(checked) == 2
    (note,) = [note for note in found.notes if note.startswith("late.lcm: ")]
    assert "later than the wheels: their times were corrected" in note
    clocks = [finding.sentence for finding in found.checks if finding.check == "poses_clock" and finding.found]
    assert [sentence.startswith("late.lcm: ") for sentence in clocks] == [True]
    in_time = diagnose(drive(), held_out=[other])
    assert found.baseline is not None
    assert in_time.baseline is not None
    assert found.baseline.held_out_path_rmse == pytest.approx(in_time.baseline.held_out_path_rmse, rel=0.1)


@pytest.mark.parametrize(
    ("useless", "why"),
    [
        (drive(20.0, 20.8), "too short: it lasts 0.8 s"),
        (drive(20.0, 21.3), "no stretch of 1.5 s over which the error of a path"),
        (without(drive(), "poses"), "no stretch of 1.5 s over which the error of a path"),
        (without(drive(), "wheels", "commands"), "Neither wheels .* nor commands"),
    ],
    ids=["0.8 s", "1.3 s", "no poses", "no wheels"],
)
def test_a_recording_on_which_no_gain_can_be_measured_is_not_held_out_silently(useless: Recording, why: str) -> None:
    with pytest.raises(EstimationError, match=rf"^bad\.lcm cannot be held out: .*{why}.*Leave it out"):
        diagnose(drive(), held_out=[drive(30.0, 40.0), useless], held_out_sources=["good.lcm", "bad.lcm"])


def test_a_log_that_cannot_be_held_out_fails_the_job_by_name(tmp_path: Path) -> None:
    log, short = write_log(tmp_path / "log.lcm", drive()), write_log(tmp_path / "short.lcm", drive(20.0, 20.8))
    with pytest.raises(JobError, match=r"short\.lcm cannot be held out: "):
        perform(Job(logs=(log,), robot_id=None, folder=tmp_path / "out", held_out=(short,)), lambda _sentence: None)


def test_a_log_that_was_set_aside_is_not_among_those_that_the_parameters_come_from(tmp_path: Path) -> None:
    logs = (write_log(tmp_path / "a.lcm", drive()), write_log(tmp_path / "b.lcm", drive(20.0, 20.8)))
    _, files = perform(Job(logs=logs, robot_id=None, folder=tmp_path / "out", report=False), lambda _sentence: None)
    assert load(files[-1]).provenance["log"] == str(logs[0])


def straight(nominal: ParameterFile) -> Recording:
    run = MANOEUVRES["straight_runs"].duties()
    driven = recording(packets(run.at, run.duration), {}, run.duration, REALISTIC, 1)
    return replace(driven, parameters=nominal)


def test_a_straight_drive_does_not_tell_the_base_width_and_leaves_the_nominal_one() -> None:
    found = diagnose(straight(ParameterFile(0, {"wheel_radius": RADIUS, "base_width": WIDTH})))
    assert found.baseline is not None
    assert "base_width" not in found.baseline.estimates
    assert found.parameters["base_width"] == WIDTH.value
    assert any("The turns of this drive determine" in note and "stays at the nominal" in note for note in found.notes)


def test_a_straight_drive_without_a_nominal_base_width_is_refused_with_what_to_drive() -> None:
    found = diagnose(straight(ParameterFile(0, {"wheel_radius": RADIUS})))
    assert found.verdict == BAD_DATA
    assert "The turns of this drive determine" in found.sentence
    assert "figure-eight" in found.sentence


def test_motors_of_which_nothing_was_recorded_are_left_out_of_the_results() -> None:
    rolling = without(drive(), "commands")
    assert rolling.parameters is not None
    known = {name: value for name, value in rolling.parameters.values.items() if name == "wheel_radius"}
    found = diagnose(rolling, ParameterFile(0, known))
    assert {"wheel_radius", "base_width"} <= set(found.parameters)
    assert not {"k1", "k2_over_k3"} & set(found.parameters)
    assert not extended_file(found, {}).has("k1")
    assert any("No commands were recorded (MOTOR_COMMAND_N)" in note and "k1" in note for note in found.notes)


def test_motors_of_which_nothing_was_recorded_keep_their_nominal_parameters() -> None:
    given = {"wheel_radius": RADIUS, "k1": Value(0.05), "k2_over_k3": Value(100.0)}
    found = diagnose(without(drive(), "commands"), ParameterFile(0, given))
    assert (found.parameters["k1"], found.parameters["k2_over_k3"]) == (0.05, 100.0)
    assert any("k1 are the nominal ones" in note for note in found.notes)


def test_without_commands_and_poses_the_wheel_radius_is_not_fitted() -> None:
    found = diagnose(without(drive(), "commands", "poses"))
    assert found.baseline is not None
    assert list(found.baseline.estimates) == ["base_width"]


@pytest.mark.parametrize("seconds", [2.0, *further(3600.0)])
def test_a_clock_that_was_set_right_stays_found(seconds: float) -> None:
    found = diagnose(later(drive(), "poses", seconds))
    (clock,) = [finding for finding in found.checks if finding.check == "poses_clock"]
    assert clock.found == 1
    assert clock.sentence.endswith("later than the wheels: they come late, or their clock is ahead.")
    assert any("were corrected" in note for note in found.notes)
    assert found.verdict == "no_effect"


def test_the_check_of_a_clock_gives_the_lateness_that_the_effect_has() -> None:
    found = diagnose(later(drive(), "poses", 0.15))
    (late,) = [effect for effect in found.effects if effect.name == "pose_latency"]
    (clock,) = [finding for finding in found.checks if finding.check == "poses_clock"]
    (size,) = late.estimates.values()
    expected = f"The poses are stamped {size.value:.3f} +- {size.std:.3f} s later than the wheels: they come late, "
    assert clock.sentence == f"{expected}or their clock is ahead."


@pytest.mark.parametrize("seed", [2, *further(4)])
def test_a_harmless_explanation_is_named_beside_one_that_matters(seed: int) -> None:
    """Without a gyro, wheels that slip while they accelerate look like poses that are late by a harmless 7.5 ms."""
    recording = later(hidden_recording(seed=seed).recording, "poses", 0.0075)
    found = diagnose(replace(recording, gyro=recording.gyro.between(0, 0)))
    assert [effect.indistinguishable_from for effect in found.effects] in ([], [("pose_latency",)])


@pytest.mark.parametrize(("seconds", "said"), [(0.8, "it lasts 0.8 s"), (2.5, "2.5 s of use")])
def test_a_drive_that_is_too_short_is_called_so_with_how_long_it_must_be(seconds: float, said: str) -> None:
    found = diagnose(drive(20.0, 20.0 + seconds))
    assert found.verdict == BAD_DATA
    assert said in found.sentence
    assert "takes 5 s of driving at least" in found.sentence


def test_without_poses_the_first_thing_to_do_is_to_record_them() -> None:
    found = diagnose(without(drive(), "poses"))
    assert found.next_experiment is not None
    assert found.next_experiment.startswith("No poses were recorded (POSE_N)")


def test_a_piece_between_gaps_without_gyro_and_poses_is_passed_over() -> None:
    whole = drive(0.0, 40.0)
    seconds = {name: (signal.utime - whole.wheels.utime[0]) * 1e-6 for name, signal in whole.signals.items()}
    late = {name: seconds[name] < 25.0 for name in ("poses", "gyro")}
    gap = whole.where({**late, "wheels": (seconds["wheels"] < 23.0) | (seconds["wheels"] > 26.0)})
    found = diagnose(gap)
    assert found.verdict == "no_effect"
    assert np.isfinite(found.parameters["base_width"])


def test_one_command_that_comes_late_is_no_law_of_a_place() -> None:
    """The largest change of the commands takes effect 60 ms late, as the wheels see it: one moment in two minutes."""
    sound = hidden_recording("coulomb_friction", seed=1).recording
    commands = sound.commands
    change = 1 + int(np.argmax(np.abs(np.diff(commands["left"]))))
    utime = np.asarray(commands.utime)
    kept = (utime < utime[change]) | (utime >= utime[change] + 60_000)
    found = diagnose(sound.where({"commands": kept}))
    assert [one.name for one in found.effects] == ["coulomb_friction"]
    assert not found.laws.found, found.sentence

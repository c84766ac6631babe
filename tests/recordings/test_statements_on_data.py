"""Statements on data claim no more than was seen in them."""

from dataclasses import replace

import numpy as np
import pytest

from cmr.calibration.fitting import _statements
from cmr.calibration.linear import COMMAND_TIME, POSE_TIME
from cmr.calibration.preparing import Prepared
from cmr.estimation.checks import looked_at, refusal
from cmr.estimation.estimates import Estimate
from cmr.recordings.faults.checks import check
from cmr.recordings.recording import Recording
from tests.recordings.clean_drives import clean_drive
from tests.support.faulty_drive import placed, without

WHOLE = 35  # random turns of a robot with duties: 100 s with all sensors, poses at 25 Hz


@pytest.fixture(scope="module")
def whole() -> Recording:
    return clean_drive(WHOLE)[1]


def part(recording: Recording, begin: float, end: float) -> Recording:
    """Return the part from `begin` to `end` [s] after the first reading of the wheels, or the first command."""
    first = int((recording.wheels if len(recording.wheels) else recording.commands).utime[0])
    return recording.between(first + round(1e6 * begin), first + round(1e6 * end))


def said_of(recording: Recording) -> str:
    """Return why a recording cannot be diagnosed."""
    return refusal(looked_at([recording]))


def test_poses_that_were_recorded_are_counted_where_they_are_of_no_use(whole: Recording) -> None:
    poses = part(whole, 45.0, 46.0).poses
    said = said_of(replace(without(part(whole, 10.0, 40.0), "gyro"), poses=poses))
    assert said.startswith(f"{len(poses)} poses were recorded, but no stretch")
    assert "Neither" not in said
    assert said_of(without(whole, "gyro", "poses")).startswith(
        "Neither poses (POSE_N) nor a gyro (GYRO_N) were recorded"
    )


def test_a_short_recording_without_wheels_is_said_to_be_short(whole: Recording) -> None:
    assert "too short: it lasts 0." in said_of(part(without(whole, "wheels"), 10.0, 10.8))


def test_a_gyro_alone_is_refused_for_what_is_missing(whole: Recording) -> None:
    assert said_of(without(whole, "wheels", "commands", "poses")).startswith("Neither wheels (MOTOR_FEEDBACK_N) nor")


def test_poses_that_are_published_five_times_are_repeats_but_not_untrue_nor_late(whole: Recording) -> None:
    source = np.arange(len(whole.poses)) // 5 * 5
    often = placed(whole, *(whole.poses[name][source] for name in ("x", "y", "theta")))
    (looked,) = looked_at([often])
    assert looked.useless == ""
    assert [finding.check for finding in looked.findings.all if finding.found] == ["poses_held"]
    once = check(whole.where({"poses": np.arange(len(whole.poses)) % 5 == 0}))
    lag, expected = looked.findings.lag("poses"), once.lag("poses")
    assert lag is not None
    assert expected is not None
    assert abs(lag.seconds - expected.seconds) < 3.0 * (lag.std + expected.std)


def test_a_recording_with_few_readings_of_turning_wheels_is_not_said_to_rest(whole: Recording) -> None:
    short = without(part(whole, 10.0, 16.0), "commands", "poses")
    few = short.where({"wheels": np.arange(len(short.wheels)) % 40 == 0})
    assert 2 < len(few.wheels) < 20
    assert np.all(few.wheels["psi_left"] != 0.0)
    assert check(few)["never_moved"].found == 0
    assert check(without(whole, "wheels", "commands", "poses"))["never_moved"].found == 0


@pytest.mark.parametrize("seconds", [-0.261, 0.261])
def test_no_command_is_said_to_take_effect_before_it_is_sent(seconds: float) -> None:
    offsets = {COMMAND_TIME: Estimate(seconds, 0.004), POSE_TIME: Estimate(0.0, 0.001)}
    (said,) = _statements(Prepared([], []), offsets)
    assert "0.261 s" in said
    assert said.startswith("Commands take effect 0.261 s later" if seconds > 0.0 else "The path fits best if commands")


def test_a_gyro_in_pieces_is_compared_within_them_and_its_factor_is_right() -> None:
    recording = clean_drive(5)[1]
    assert len(recording.pieces) > 5
    gyro = replace(recording.gyro, fields={"yaw_rate": 2.0 * recording.gyro["yaw_rate"]})
    said = check(replace(recording, gyro=gyro))["gyro_factor"].sentence
    assert 1.9 < float(said.split("reports ")[1].split(" times")[0]) < 2.1  # turn slip is at most 5 %
    assert check(recording)["gyro_factor"].found == 0


def test_a_counter_that_jumps_and_comes_back_has_not_started_again() -> None:
    recording = clean_drive(5)[1]
    ticks = recording.wheels["ticks_left"].copy()
    lasts = np.flatnonzero(recording.pieces.borders(recording.wheels.utime)) - 1
    ticks[[200, 201, 777, *lasts[:2]]] += 5e4  # also in the last readings of two pieces
    fields = recording.wheels.fields | {"ticks_left": ticks}
    findings = check(replace(recording, wheels=replace(recording.wheels, fields=fields)))
    assert findings["encoder_resets"].found == 0
    assert findings["encoder_spikes"].found == 5


def test_a_pause_in_which_nothing_was_recorded_is_no_gap_and_one_of_a_sensor_is(whole: Recording) -> None:
    first = int(whole.wheels.utime[0])
    parts = {name: (signal.utime - first) * 1e-6 for name, signal in whole.signals.items()}
    paused = whole.where({name: (seconds < 20.0) | (seconds > 25.0) for name, seconds in parts.items()})
    assert check(paused)["gaps"].found == 0
    lost = whole.where({"poses": (parts["poses"] < 20.0) | (parts["poses"] > 25.0)})
    assert "poses 1; the longest is 5.0" in check(lost)["gaps"].sentence


def test_a_recording_is_cut_off_where_the_robot_still_moves_and_was_not_commanded_to_stop(whole: Recording) -> None:
    assert check(part(whole, 0.0, 30.0))["cut_off"].found == 1
    assert check(without(part(whole, 0.0, 30.0), "commands"))["cut_off"].found == 1
    rolling = part(whole, 0.0, 30.0)
    stopped = rolling.commands.seconds > rolling.commands.seconds[-1] - 0.5
    fields = {side: np.where(stopped, 0.0, rolling.commands[side]) for side in ("left", "right")}
    assert check(replace(rolling, commands=replace(rolling.commands, fields=fields)))["cut_off"].found == 0

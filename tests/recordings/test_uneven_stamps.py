"""Wheels that were read at even intervals and stamped unevenly are found by their motion, and set right."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cmr.calibration.preparing import prepare
from cmr.diagnosis.diagnose import diagnose
from cmr.recordings.faults.checks import check
from cmr.recordings.faults.uneven_stamps import even_stamps
from cmr.recordings.recording import Recording
from cmr.recordings.signal import Floats, Signal, no_times
from tests.hidden_effects import hidden_recording
from tests.hidden_effects.cases import EIGHT

INTERVAL, JITTER = 0.02, 0.004  # s
TICK = 2.0 * np.pi / 2000.0  # rad
TO_A_NEIGHBOUR = 1.3 * JITTER * (np.pi / 2.0 / 51.0) ** 0.5  # s: of a median of 51 stamps, with room for its skew


def angle(time: Floats) -> Floats:
    """How far a wheel has turned [rad] whose speed swings between 2 and 10 rad/s."""
    return 6.0 * time - 2.0 * np.cos(2.0 * time) + 2.0


def recorded(read: Floats, stamped: Floats) -> Recording:
    """Return the recording of a robot whose wheels were `read` at these times [s] and `stamped` with those."""
    utime = np.round(1e6 * stamped).astype(np.int64)
    fields: dict[str, Floats] = {}
    for side, scale in (("left", 1.0), ("right", 0.8)):
        ticks = np.floor(scale * angle(read) / TICK)
        speeds = np.diff(ticks, prepend=ticks[:1]) * TICK / np.diff(1e-6 * utime, prepend=-1.0)
        fields |= {f"ticks_{side}": ticks, f"psi_{side}": speeds, f"applied_{side}": np.full(len(read), np.nan)}
    nothing = Signal(no_times(), {"left": np.empty(0), "right": np.empty(0)})
    empty = Signal(no_times(), {"x": np.empty(0), "y": np.empty(0), "theta": np.empty(0), "yaw_rate": np.empty(0)})
    return Recording(0, commands=nothing, wheels=Signal(utime, fields), gyro=empty, poses=empty)


def late(count: int, seed: int) -> Floats:
    return np.asarray(np.random.default_rng(seed).exponential(JITTER, count))


def read_at(pauses: bool = False, lost: bool = False) -> Floats:
    number = np.arange(3000)
    time = number * INTERVAL * 1.0003 + (5.0 * (number // 300) if pauses else 0.0)
    return np.asarray(time[number % 97 != 5] if lost else time)


@pytest.mark.parametrize(("pauses", "lost"), [(False, False), (True, False), (False, True)])
def test_even_readings_get_even_stamps(pauses: bool, lost: bool) -> None:
    read = read_at(pauses, lost)
    stamped = np.sort(read + late(len(read), 1))
    recording = recorded(read, stamped)
    (found,) = even_stamps(recording)
    assert found.jitter == pytest.approx(JITTER, rel=0.2)
    away = 1e-6 * found.utime - read
    assert np.std(away) < 2.0 * TO_A_NEIGHBOUR  # the median of neighbours is as far off again at a loss
    assert check(recording)["uneven_stamps"].found == 1
    set_right = found.of(recording).wheels
    expected = np.diff(set_right["ticks_left"])[1:] * TICK / (np.diff(set_right.utime)[1:] * 1e-6)
    assert set_right["psi_left"][2:] == pytest.approx(expected, rel=1e-9)


def test_what_was_stamped_together_with_the_wheels_was_taken_with_them() -> None:
    """In a table each row has one stamp, for all of its columns."""
    read = read_at(lost=True)
    wheels = recorded(read, np.sort(read + late(len(read), 1)))
    rows = wheels.wheels.utime
    gyro = Signal(rows, {"yaw_rate": np.zeros(len(rows))})
    commands = Signal(rows[::5], {"left": np.zeros(len(rows[::5])), "right": np.zeros(len(rows[::5]))})
    of_wheels, of_commands, of_gyro = found = even_stamps(replace(wheels, gyro=gyro, commands=commands))
    assert [one.signal for one in found] == ["wheels", "commands", "gyro"]
    np.testing.assert_array_equal(of_gyro.utime, of_wheels.utime)
    np.testing.assert_array_equal(of_commands.utime, of_wheels.utime[::5])
    # Another process stamped these.
    strangers = replace(wheels, gyro=replace(gyro, utime=rows + 1), commands=replace(commands, utime=rows[::5] + 1))
    assert [one.signal for one in even_stamps(strangers)] == ["wheels"]


def test_poses_that_were_interpolated_at_uneven_stamps_stay() -> None:
    read = read_at()
    stamped = np.sort(read + late(len(read), 1))
    wheels = recorded(read, stamped)
    path = {"x": 0.05 * angle(stamped), "y": 0.03 * angle(stamped), "theta": np.zeros(len(read))}
    found = even_stamps(replace(wheels, poses=Signal(wheels.wheels.utime, path)))
    assert [one.signal for one in found] == ["wheels"]


def test_stamps_that_are_true_stay() -> None:
    read = np.sort(read_at() + late(3000, 2))
    recording = recorded(read, read)
    assert even_stamps(recording) == []
    assert check(recording)["uneven_stamps"].found == 0


@given(st.integers(0, 2**32 - 1), st.floats(0.0, 1.0))
@settings(max_examples=25, deadline=None)
def test_stamps_stay_in_order(seed: int, share: float) -> None:
    """What part of the unevenness is true, `share`, does not matter."""
    read, lateness = read_at(), late(3000, seed)
    found = even_stamps(recorded(read + share * lateness, np.sort(read + lateness)))
    assert all(np.all(np.diff(one.utime) > 0) for one in found)


@pytest.mark.further  # even stamps are what it rests on
@pytest.mark.slow
def test_uneven_stamps_make_no_gyro_read_too_little() -> None:
    recording = hidden_recording(manoeuvre=EIGHT, seed=4).recording
    nothing = Signal(no_times(), {"left": np.empty(0), "right": np.empty(0)})
    wheels = recording.wheels.where(np.arange(len(recording.wheels)) % 2 == 0)
    seconds = np.sort(wheels.seconds + late(len(wheels), 3))
    utime = wheels.utime[0] + np.round(1e6 * seconds).astype(np.int64) + np.arange(len(wheels))
    before, now = np.diff(wheels.utime, prepend=0), np.diff(utime, prepend=0)
    speeds = {name: wheels[name] * before / now for name in ("psi_left", "psi_right")}
    unknown = dict.fromkeys(("applied_left", "applied_right"), np.full(len(wheels), np.nan))
    stamped = replace(recording, commands=nothing, wheels=Signal(utime, {**wheels.fields, **speeds, **unknown}))
    assert [effect.name for effect in diagnose(stamped).effects] == []


def test_the_paper_s_method_cuts_the_path_at_stamps_that_were_evened_out() -> None:
    recording = hidden_recording(manoeuvre=EIGHT, seed=4).recording
    poses = recording.poses
    seconds = np.sort(poses.seconds + late(len(poses), 5))
    utime = poses.utime[0] + np.round(1e6 * seconds).astype(np.int64) + np.arange(len(poses))
    fields = poses.fields | {"x": poses["x"] + np.where(np.arange(len(poses)) < 1500, 0.0, 1.0)}
    ready = prepare([replace(recording, poses=Signal(utime, fields))])
    assert any("stamped unevenly" in note for note in ready.notes)
    (splits,) = ready.splits
    assert len(splits) == 1
    assert set(splits) <= set(ready.recordings[0].poses.utime.tolist())

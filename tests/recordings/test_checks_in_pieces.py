"""What data checks promise of any recording: nothing is found in a clean one, and faults are found in pieces, too."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from cmr.estimation.checks import with_clocks_set
from cmr.recordings.faults.checks import check
from cmr.recordings.recording import Recording
from cmr.recordings.signal import SECONDS, Mask, Signal
from tests.recordings.clean_drives import clean_drive
from tests.recordings.complaints import complaints
from tests.support.faulty_drive import later, moved, placed
from tests.support.lanes import further

pytestmark = pytest.mark.slow

# In each of these a check fired once. They have poses that are rounded (16, 149), wheel speeds of the moment at 10 Hz
# (24, 125, 144), commands recorded at 5 Hz (39, 498), controllers slower than motors (54, 88), a speed that
# hardly changes (432, 7080), a lag of the poses that is unknown (3074), or rounded poses of 200 Hz (383, 5061).
ONCE_FOUND_FAULT_WITH = (16, 24, 39, 54, 88, 125, 144, 149, 383, 432, 498, 3074, 5061, 7080)
# Recordings in pieces with all sensors: random turns, a controller, a rich drive, circles. In the last two each piece
# has a frame of its own.
IN_PIECES = (5, 47, 38, 97, 8)


@pytest.mark.parametrize("seed", ONCE_FOUND_FAULT_WITH)
def test_nothing_is_found_in_recordings_without_a_fault(seed: int) -> None:
    assert complaints(clean_drive(seed)[1]) == {}


def on_the_way(recording: Recording, name: str, seconds: float) -> Mask:
    """Tell which samples lie so near [s] to the moment, 0.7 s within a piece, around which the robot is fastest."""
    wheels, pieces = recording.wheels, recording.pieces
    speed = np.minimum(np.abs(wheels["psi_left"]), np.abs(wheels["psi_right"]))
    width = max(round(1.0 / (float(np.median(np.diff(wheels.utime))) * SECONDS)), 1)
    lasting = np.convolve(speed, np.ones(width) / width, "same")
    piece = pieces.number(wheels.utime)
    inside = np.minimum(wheels.utime - pieces.first[piece], pieces.last[piece] - wheels.utime) * SECONDS > 0.7
    moment = wheels.utime[np.argmax(np.where(inside, lasting, 0.0))]
    return np.asarray(np.abs(recording.signals[name].utime - moment) * SECONDS < seconds)


def changed(recording: Recording, name: str, field: str, values: np.typing.NDArray[np.float64]) -> Recording:
    signal = recording.signals[name]
    parts: dict[str, Signal] = {name: replace(signal, fields=signal.fields | {field: values})}
    return replace(recording, **parts)  # type: ignore[arg-type]


def one_pose_off(recording: Recording) -> Recording:
    at = np.flatnonzero(on_the_way(recording, "poses", 0.5))[:1]
    wrong = np.zeros(len(recording.poses), np.bool_)
    wrong[at] = True
    return moved(recording, wrong, 1.0 + 0.5j)


def a_jump(recording: Recording) -> Recording:
    middle = int(recording.poses.utime[on_the_way(recording, "poses", 0.2)][0])
    piece = recording.pieces.number(recording.poses.utime)
    after = recording.poses.utime >= middle
    return moved(recording, after & (piece == piece[np.argmax(after)]), 2.0 - 1.0j)


def held(recording: Recording) -> Recording:
    at = np.flatnonzero(on_the_way(recording, "poses", 0.3))
    source = np.arange(len(recording.poses))
    source[at] = at[0]
    return placed(recording, *(recording.poses[name][source] for name in ("x", "y", "theta")))


def a_spike(recording: Recording) -> Recording:
    psi = recording.wheels["psi_left"].copy()
    psi[np.flatnonzero(on_the_way(recording, "wheels", 0.3))[0]] = 4e3
    return changed(recording, "wheels", "psi_left", psi)


def a_reset(recording: Recording) -> Recording:
    at = np.flatnonzero(on_the_way(recording, "wheels", 0.3))[0]
    ticks = recording.wheels["ticks_right"].copy()
    ticks[at:] -= ticks[at] + 1e6
    return changed(recording, "wheels", "ticks_right", ticks)


def gyro_times(factor: float) -> Callable[[Recording], Recording]:
    return lambda recording: changed(recording, "gyro", "yaw_rate", factor * recording.gyro["yaw_rate"])


def without_a_while(recording: Recording) -> Recording:
    return recording.where({"poses": ~on_the_way(recording, "poses", 0.4)})


def some_lost(recording: Recording) -> Recording:
    return recording.where({"gyro": np.arange(len(recording.gyro)) % 7 < 5})


FAULTS: dict[str, Callable[[Recording], Recording]] = {
    "pose_outliers": one_pose_off,
    "pose_jumps": a_jump,
    "poses_held": held,
    "encoder_spikes": a_spike,
    "encoder_resets": a_reset,
    "gyro_reversed": gyro_times(-1.0),
    "gyro_factor": gyro_times(57.3),
    "dead_sensors": gyro_times(0.0),
    "poses_clock": lambda recording: later(recording, "poses", 0.3),
    "gyro_clock": lambda recording: later(recording, "gyro", 0.3),
    "gaps": without_a_while,
    "uneven_rates": some_lost,
}


@pytest.mark.parametrize("seed", [*IN_PIECES[::2], *further(*IN_PIECES[1::2])])
@pytest.mark.parametrize("fault", FAULTS)
def test_a_fault_in_a_recording_in_pieces_is_found(fault: str, seed: int) -> None:
    findings = check(FAULTS[fault](clean_drive(seed)[1]))
    assert findings[fault].found > 0


@pytest.mark.parametrize("seconds", [0.8, -1.5])
def test_commands_on_another_clock_are_moved_and_the_note_tells_what_was_seen(seconds: float) -> None:
    recording = clean_drive(35)[1]
    _, findings, note = with_clocks_set(later(recording, "commands", seconds))
    lag = findings.lag("wheels")
    assert lag is not None
    assert f"{abs(lag.seconds):.2f} s" in note
    assert ("before it is commanded" if seconds > 0.0 else "follows its command") in note


def test_poses_that_are_rounded_and_held_are_told_from_those_that_repeat_by_rounding() -> None:
    whole = clean_drive(16)[1]
    findings = check(held(whole))
    set_aside = findings["poses_held"].set_aside["poses"]
    assert on_the_way(whole, "poses", 0.3)[set_aside].all()
    assert set_aside.sum() > 0.5 * on_the_way(whole, "poses", 0.3).sum()

"""Commands that were recorded and not in force are found and set aside; those that were are kept."""

from dataclasses import replace

import numpy as np
import pytest

from cmr.model.command_kinds import VELOCITY
from cmr.recordings.faults.checks import check
from cmr.recordings.recording import Recording
from cmr.recordings.signal import Floats, Signal

PERIOD, RESPONSE, NOISE = 0.05, 0.3, 0.05  # s, s, rad/s
SECONDS = 120.0
JOYSTICK, EMERGENCY_STOP, LATE = (30.0, 60.0), (100.0, SECONDS), 0.4  # s


def drive(*, joystick: bool = False, stop: bool = False, kind: str = VELOCITY) -> Recording:
    """Return a drive of steps of 4 s each, with rests between, of a robot that follows its commands slowly and late."""
    time = np.arange(0.0, SECONDS, PERIOD)
    rng = np.random.default_rng(3)
    steps = rng.uniform(0.2, 1.0, (int(SECONDS / 4.0) + 1, 2))
    steps[::3] = 0.0
    asked = steps[(time / 4.0).astype(np.int64)]
    asked[(time >= JOYSTICK[0]) & (time < JOYSTICK[1])] = 0.0
    acted = 8.0 * asked[np.searchsorted(time, np.maximum(time - LATE, 0.0))]
    by_hand = (time > JOYSTICK[0] + 5.0) & (time < JOYSTICK[1] - 2.0)
    acted[by_hand & joystick] = 3.0 + np.stack([np.sin(time), np.cos(time)], axis=1)[by_hand & joystick]
    acted[(time >= EMERGENCY_STOP[0]) & stop] = 0.0
    return recording(time, asked, followed(acted) + rng.normal(0.0, NOISE, acted.shape), kind)


def followed(wanted: Floats) -> Floats:
    """Return speeds that follow the wanted ones, of the same shape, with the time constant RESPONSE."""
    speeds, share = np.zeros_like(wanted), PERIOD / RESPONSE
    for k in range(1, len(wanted)):
        speeds[k] = speeds[k - 1] + share * (wanted[k] - speeds[k - 1])
    return speeds


def recording(time: Floats, asked: Floats, speeds: Floats, kind: str) -> Recording:
    """Return the recording of commands, as duties that stand for them, and wheels."""
    utime = np.round(1e6 * (time + 1.0)).astype(np.int64)
    angles = np.cumsum(speeds, axis=0) * PERIOD
    wheels = {f"ticks_{side}": np.round(angles[:, k] / 1e-3) for k, side in enumerate(("left", "right"))}
    wheels |= {f"psi_{side}": speeds[:, k] for k, side in enumerate(("left", "right"))}
    wheels |= {f"applied_{side}": np.full(len(time), np.nan) for side in ("left", "right")}
    nothing = Signal(utime[:0], {name: np.empty(0) for name in ("yaw_rate", "x", "y", "theta")})
    commands = Signal(utime, {"left": asked[:, 0], "right": asked[:, 1]})
    return Recording(
        0, commands=commands, wheels=Signal(utime, wheels), gyro=nothing, poses=nothing, converted_from=kind
    )


def set_aside(recording: Recording) -> Floats:
    """Return the times [s] of the commands that were set aside."""
    findings = check(recording)
    mask = findings["commands_not_in_force"].set_aside.get("commands", np.zeros(len(recording.commands), np.bool_))
    return np.asarray(recording.commands.seconds[mask])


def test_a_robot_that_follows_its_commands_slowly_and_late_keeps_all_of_them() -> None:
    assert len(set_aside(drive())) == 0


def test_the_zeros_recorded_while_somebody_drives_by_hand_are_set_aside() -> None:
    times = set_aside(drive(joystick=True))
    assert (times.min(), times.max()) == pytest.approx(JOYSTICK, abs=8.0)  # with the rests around
    assert np.all(np.diff(times) < 2.0 * PERIOD)


def test_commands_to_a_robot_that_was_stopped_are_set_aside_from_when_it_slows_down() -> None:
    whole = drive(stop=True)
    times = set_aside(whole)
    commanded = whole.commands["left"] > 0.0
    late = (whole.commands.seconds >= EMERGENCY_STOP[0] + 1.0) & commanded
    assert set(whole.commands.seconds[late]) <= set(times)
    assert times.min() > EMERGENCY_STOP[0] - 1.0


def test_a_command_that_is_recorded_once_is_in_force_although_the_robot_stands_when_it_comes() -> None:
    whole = drive()
    changes = np.any(np.diff([whole.commands[side] for side in ("left", "right")], prepend=-1.0) != 0.0, axis=0)
    assert len(set_aside(whole.where({"commands": changes}))) == 0


def test_of_duties_nothing_is_set_aside() -> None:
    assert len(set_aside(replace(drive(joystick=True), converted_from=""))) == 0

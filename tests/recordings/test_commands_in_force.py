"""Commands that were recorded and not in force are found and set aside; those that were are kept."""

from dataclasses import replace

import numpy as np
import pytest

from cmr.model.command_kinds import VELOCITY
from cmr.recordings.faults.checks import check
from cmr.recordings.faults.commands_in_force import _allowed
from cmr.recordings.recording import Recording
from cmr.recordings.signal import Floats, Mask, Signal

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


def with_wheels(whole: Recording, keep: Mask) -> Recording:
    return whole.where({"wheels": keep})


def rests(seconds: float, share: float) -> Recording:
    """Return 20 s of a drive, then a rest in which a tick comes and goes in this `share` of the readings."""
    short = drive()
    short = short.between(int(short.wheels.utime[0]), int(short.wheels.utime[0]) + 20_000_000)
    time = np.arange(0.0, 20.0 + seconds, PERIOD)
    count, rng = len(short.wheels), np.random.default_rng(5)
    asked, speeds = np.zeros((2, len(time), 2))
    asked[:count] = np.stack([short.commands[side] for side in ("left", "right")], axis=1)
    speeds[:count] = np.stack([short.wheels[f"psi_{side}"] for side in ("left", "right")], axis=1)
    speeds[count:] = np.where(rng.uniform(size=(len(time) - count, 2)) < share, 1.0, 0.0)
    return recording(time, asked, speeds, VELOCITY)


@pytest.mark.parametrize(
    "whole",
    [
        rests(2000.0, 0.0),
        rests(100.0, 0.05),
        recording(np.arange(0.0, 60.0, PERIOD), np.zeros((1200, 2)), np.full((1200, 2), 0.02), VELOCITY),
        with_wheels(drive(), (drive().wheels.seconds < 64.0) | (drive().wheels.seconds > 74.0)),
        with_wheels(drive(), drive().wheels.seconds < 14.0),
        replace(drive(), wheels=replace(drive().wheels, utime=drive().wheels.utime + 2_300_000)),
        replace(drive(), wheels=replace(drive().wheels, utime=drive().wheels.utime - 1_500_000)),
    ],
    ids=["long rest", "ticks at rest", "never driven", "gap of wheels", "wheels end", "clock late", "clock early"],
)
def test_what_else_recordings_have_sets_no_command_aside(whole: Recording) -> None:
    assert len(set_aside(whole)) == 0


def test_slow_driving_beside_a_fast_joystick_is_no_standing() -> None:
    whole = drive(joystick=True)
    slow = {f"psi_{side}": np.where(abs(whole.wheels[f"psi_{side}"]) > 2.0, 10.0, 0.1) for side in ("left", "right")}
    hand = (whole.wheels.seconds > JOYSTICK[0] + 5.0) & (whole.wheels.seconds < JOYSTICK[1] - 2.0)
    fields = {name: np.where(hand, slow[name], 0.05 * whole.wheels[name]) for name in slow}
    times = set_aside(replace(whole, wheels=replace(whole.wheels, fields={**whole.wheels.fields, **fields})))
    assert len(times) > 0
    assert np.all((times > JOYSTICK[0] - 8.0) & (times < JOYSTICK[1] + 8.0))


def test_a_damaged_command_beside_a_joystick_is_set_aside_with_the_others() -> None:
    whole = drive(joystick=True)
    left = whole.commands["left"].copy()
    left[100] = 1e10
    damaged = replace(whole, commands=replace(whole.commands, fields={**whole.commands.fields, "left": left}))
    assert len(check(damaged).cleaned(damaged).commands) == len(left) - 1 - len(set_aside(damaged))


def test_of_duties_nothing_is_set_aside() -> None:
    assert len(set_aside(replace(drive(joystick=True), converted_from=""))) == 0


def test_long_after_a_beginning_that_was_not_seen_any_speed_is_allowed() -> None:
    with np.errstate(all="raise"):
        allowed = _allowed(np.array([1.0]), np.array([0]), np.array([1e6]), np.array([True]))
    assert allowed.tolist() == [np.inf]

"""What recordings really contain does not move the parameters: within 3 standard deviations of the clean log's."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from cmr.calibration import CalibrationResult, EstimationError, calibrate
from cmr.calibration.noise import ORDER, Series, noise_of
from cmr.recordings.recording import Recording
from cmr.recordings.signal import Floats, Mask, Signal
from tests.calibration.test_calibrate import recording_of
from tests.reference_plant import REALISTIC, packets, recording
from tests.reference_plant.manoeuvres import Manoeuvre, figure_eight
from tests.support.emulated_drive import IDEAL, messages, write_log
from tests.support.lanes import further

pytestmark = pytest.mark.slow

SECONDS = 40.0
NOISE = replace(REALISTIC, torque=0.0, slip=0.0)
DRIVE = figure_eight(SECONDS, 1)


def recorded(manoeuvre: Manoeuvre = DRIVE, seconds: float = SECONDS) -> Recording:
    return recording(packets(manoeuvre, seconds), {}, seconds, NOISE, seed=5)


@pytest.fixture(scope="module")
def clean() -> Recording:
    return recorded()


@pytest.fixture(scope="module")
def expected(clean: Recording) -> CalibrationResult:
    return calibrate(clean)


def assert_agree(result: CalibrationResult, expected: CalibrationResult) -> None:
    assert set(result.estimates) == set(expected.estimates)
    for name, estimate in expected.estimates.items():
        found = result.estimates[name]
        assert abs(found.value - estimate.value) < 4.0 * np.hypot(found.std, estimate.std), name
        assert found.std < 0.1 * found.value, name


def assert_same(result: CalibrationResult, expected: CalibrationResult) -> None:
    assert set(result.estimates) == set(expected.estimates)
    for name, estimate in expected.estimates.items():
        assert abs(result.estimates[name].value - estimate.value) < 3.0 * estimate.std, name


def with_poses(clean: Recording, change: Callable[[dict[str, Floats]], None]) -> Recording:
    fields = {name: values.copy() for name, values in clean.poses.fields.items()}
    change(fields)
    return replace(clean, poses=replace(clean.poses, fields=fields))


def without(signal: Signal, dropped: Mask) -> Signal:
    return signal.where(~dropped)


def late(signal: Signal, seconds: float) -> Signal:
    return replace(signal, utime=signal.utime + round(seconds * 1e6))


def between(signal: Signal, first: float, last: float) -> Mask:
    """Tell which samples were taken between these times [s] since the beginning."""
    return np.asarray((signal.seconds >= first) & (signal.seconds < last))


def test_two_in_a_hundred_poses_metres_off_do_not_matter(clean: Recording, expected: CalibrationResult) -> None:
    random = np.random.default_rng(1)
    wrong = random.random(len(clean.poses)) < 0.02

    def change(fields: dict[str, Floats]) -> None:
        for name in ("x", "y"):
            fields[name][wrong] += random.normal(0.0, 2.0, np.count_nonzero(wrong))

    result = calibrate(with_poses(clean, change))
    assert_same(result, expected)
    assert any(str(np.count_nonzero(wrong)) in note for note in result.notes)


@pytest.mark.parametrize("size", [0.3, *further(3.0)])
def test_a_tracker_that_jumps_does_not_matter(clean: Recording, expected: CalibrationResult, size: float) -> None:
    after = clean.poses.seconds > 22.0

    def change(fields: dict[str, Floats]) -> None:
        fields["x"][after] += size
        fields["y"][after] -= size / 2.0

    assert_same(calibrate(with_poses(clean, change)), expected)


def test_poses_that_are_held_for_a_while_do_not_matter(clean: Recording, expected: CalibrationResult) -> None:
    held = between(clean.poses, 12.0, 12.6)

    def change(fields: dict[str, Floats]) -> None:
        for values in fields.values():
            values[held] = values[np.flatnonzero(held)[0] - 1]

    assert_same(calibrate(with_poses(clean, change)), expected)


@pytest.mark.parametrize(("first", "last"), [*further((15.0, 15.5)), (15.0, 19.0)])
def test_gaps_in_the_poses_do_not_matter(
    clean: Recording, expected: CalibrationResult, first: float, last: float
) -> None:
    poses = without(clean.poses, between(clean.poses, first, last))
    assert_same(calibrate(replace(clean, poses=poses)), expected)


@pytest.mark.parametrize("last", [15.1, *further(15.4, 17.0)])
def test_gaps_in_all_signals_do_not_matter(clean: Recording, expected: CalibrationResult, last: float) -> None:
    lost = {name: ~between(signal, 15.0, last) for name, signal in clean.signals.items()}
    assert_same(calibrate(clean.where(lost)), expected)


@pytest.mark.parametrize("last", further(15.1, 16.0))  # gaps in all signals are those of the wheels, too
def test_gaps_in_the_wheels_do_not_matter(clean: Recording, expected: CalibrationResult, last: float) -> None:
    wheels = without(clean.wheels, between(clean.wheels, 15.0, last))
    # The driver's next speed is the average since its message before.
    after = int(np.argmax(wheels.seconds >= last))
    dt = wheels.seconds[after] - wheels.seconds[after - 1]
    fields = {name: values.copy() for name, values in wheels.fields.items()}
    for side in ("left", "right"):
        ticks = fields[f"ticks_{side}"]
        fields[f"psi_{side}"][after] = (ticks[after] - ticks[after - 1]) / 480.0 * 2.0 * np.pi / dt
    assert_same(calibrate(replace(clean, wheels=replace(wheels, fields=fields))), expected)


def test_poses_that_come_twice_or_too_late_do_not_matter(expected: CalibrationResult, clean: Recording) -> None:
    poses = clean.poses
    order = np.arange(len(poses))
    order[100:110] = order[100:110][::-1]
    order = np.repeat(order, np.where(order % 37 == 0, 2, 1))
    rows = Signal(poses.utime[order], {name: values[order] for name, values in poses.fields.items()})
    utime, first = np.unique(rows.utime, return_index=True)
    gathered = Signal(utime, {name: values[first] for name, values in rows.fields.items()})
    assert_same(calibrate(replace(clean, poses=gathered)), expected)


@pytest.mark.parametrize("seconds", [0.05, *further(-0.3, -0.05, 0.3, 1.0)])
def test_poses_on_another_clock_do_not_matter(clean: Recording, expected: CalibrationResult, seconds: float) -> None:
    result = calibrate(replace(clean, poses=late(clean.poses, seconds)))
    assert_agree(result, expected)
    # A clock that is far off, or ahead, is set right; poses that are a little late are late.
    assert any("clock of the poses" in note or "poses" in note.lower() for note in result.notes)


@pytest.mark.parametrize("seconds", [-0.4, *further(-0.05, 0.3, 1.0)])
def test_commands_on_another_clock_do_not_matter(clean: Recording, expected: CalibrationResult, seconds: float) -> None:
    # How late commands come, and how slow the motors are, can hardly be told apart: the intervals say so.
    assert_agree(calibrate(replace(clean, commands=late(clean.commands, seconds))), expected)


def test_unequal_rates_do_not_matter(clean: Recording, expected: CalibrationResult) -> None:
    seldom = {
        "wheels": without(clean.wheels, np.arange(len(clean.wheels)) % 3 > 0),
        "poses": without(clean.poses, np.arange(len(clean.poses)) % 5 > 0),
    }
    wheels = seldom["wheels"]
    fields = dict(wheels.fields)
    for side in ("left", "right"):
        ticks = np.diff(wheels[f"ticks_{side}"], prepend=0.0)
        fields[f"psi_{side}"] = ticks / 480.0 * 2.0 * np.pi / 0.03
    result = calibrate(replace(clean, wheels=replace(wheels, fields=fields), poses=seldom["poses"]))
    for name, estimate in expected.estimates.items():
        assert abs(result.estimates[name].value - estimate.value) < 3.0 * result.estimates[name].std, name


def test_a_robot_that_starts_late_is_no_other_robot(expected: CalibrationResult) -> None:
    wait = 25.0
    result = calibrate(recorded(lambda time: DRIVE(time - wait), SECONDS + wait))
    for name, estimate in expected.estimates.items():
        assert abs(result.estimates[name].value - estimate.value) < 3.0 * np.hypot(
            estimate.std, result.estimates[name].std
        )


def test_a_truncated_log_gives_what_its_intact_part_gives(tmp_path: Path) -> None:
    drive = messages(IDEAL, seed=3)
    whole = calibrate(recording_of(drive))
    log = write_log(tmp_path / "run.lcm", drive)
    log.write_bytes(log.read_bytes()[: log.stat().st_size * 9 // 10 + 7])
    cut = calibrate(Recording.read(log))
    for name, estimate in whole.estimates.items():
        assert abs(cut.estimates[name].value - estimate.value) < 3.0 * cut.estimates[name].std, name


def test_a_log_that_ends_before_the_robot_moves_is_refused_in_words(clean: Recording) -> None:
    with pytest.raises(EstimationError, match="never moves"):
        calibrate(clean.between(int(clean.wheels.utime[0]), int(clean.wheels.utime[150])))


@pytest.mark.parametrize("length", range(1, ORDER + 2))
def test_a_piece_of_a_few_samples_between_gaps_says_nothing_wrong_of_the_noise(length: int) -> None:
    random = np.random.default_rng(length)
    whole = Series(random.standard_normal((1, 2000)), (), 0.01 * np.arange(2000.0))
    piece = Series(random.standard_normal((1, length)), (), 0.01 * np.arange(float(length)))
    alone, both = noise_of([whole]), noise_of([whole, piece])
    assert len(both.coefficients) == ORDER
    assert both.whiten(piece.rows, piece.times).shape == (1, max(length - ORDER, 0))
    # One sample more among 2,000 moves a mean of squares by about a thousandth.
    np.testing.assert_allclose(both.coefficients, alone.coefficients, atol=5e-3)
    assert both.size == pytest.approx(alone.size, rel=5e-3)

"""Wheels whose readings are older than their stamps are found beside the gyro, and nothing is late that is not."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from cmr.calibration import calibrate
from cmr.calibration.scoring import path_rmse
from cmr.diagnosis.diagnose import diagnose
from cmr.diagnosis.result import Diagnosis
from cmr.estimation.checks import looked_at
from cmr.model.parameters import RobotParameters
from cmr.recordings.faults.checks import check
from cmr.recordings.recording import Recording
from cmr.recordings.signal import Signal
from tests.hidden_effects import hidden_recording
from tests.hidden_effects.cases import BEGINNING, CONTROLLED_WINDOWS, EIGHT, RICH
from tests.hidden_effects.hiding import HiddenRecording
from tests.support.lanes import further

pytestmark = pytest.mark.slow

LATE = "wheel_speed_latency"
CERTAIN = 3.5  # standard deviations
STAMPS = 0.001  # s; readings and poses lie on rasters of their own


def sizes(found: Diagnosis) -> dict[str, tuple[float, float]]:
    return {name: (one.value, one.std) for effect in found.effects for name, one in effect.estimates.items()}


def assert_found(found: Diagnosis, hidden: HiddenRecording) -> None:
    assert {effect.name for effect in found.effects} == set(hidden.truth.effects)
    for name, (value, std) in sizes(found).items():
        assert value == pytest.approx(hidden.truth.parameters[name], abs=CERTAIN * std + STAMPS), name


@pytest.mark.parametrize(
    ("effects", "manoeuvre", "seed"),
    [
        ((LATE, "gyro_latency"), BEGINNING, 5),
        *further(((LATE, "pose_latency"), CONTROLLED_WINDOWS, 1)),
    ],
)
def test_late_wheels_are_told_from_other_latencies(effects: tuple[str, ...], manoeuvre: str, seed: int) -> None:
    hidden = hidden_recording(*effects, manoeuvre=manoeuvre, seed=seed)
    assert_found(diagnose(hidden.recording), hidden)


def shifted(recording: Recording, seconds: float, *names: str) -> Recording:
    parts: dict[str, Any] = {}
    for name in names:
        signal = getattr(recording, name)
        parts[name] = Signal(signal.utime + round(1e6 * seconds), dict(signal.fields))
    return replace(recording, **parts)


@pytest.mark.further  # of poses: tests/diagnosis/test_awkward_data.py
def test_calibration_check_and_effect_give_one_number() -> None:
    hidden = hidden_recording(LATE, manoeuvre=EIGHT, seed=2)
    late = check(hidden.recording).wheels_late
    assert late is not None
    result = calibrate(hidden.recording)
    found = diagnose(hidden.recording)
    assert_found(found, hidden)
    assert late.seconds == pytest.approx(sizes(found)[LATE][0])
    assert late.seconds == pytest.approx(result.parameters[LATE])
    for name, estimate in result.estimates.items():
        assert abs(estimate.value - hidden.truth.robot[name]) < CERTAIN * estimate.std, name


def test_slow_wheels_that_are_filtered_are_late_although_by_less_than_their_interval() -> None:
    """A tracker and a gyro see a turn 0.03 s before 20 Hz odometry does: poses do not come from the future."""
    recording = hidden_recording(manoeuvre=RICH, seed=4).recording
    slow = recording.where({"wheels": np.arange(len(recording.wheels)) % 5 == 0})
    assert check(slow).wheels_late is None
    late = check(shifted(slow, 0.03, "wheels")).wheels_late
    assert late is not None
    assert late.seconds == pytest.approx(0.03, abs=CERTAIN * late.std + STAMPS)


@pytest.mark.further  # late poses have tests of their own
def test_a_trackers_clock_that_is_ahead_is_reported_with_its_sign() -> None:
    """Without a gyro nobody knows whether the wheels are late; what the search found is what is reported."""
    recording = hidden_recording(manoeuvre=EIGHT, seed=3).recording
    recording = recording.where({"gyro": np.zeros(len(recording.gyro), np.bool_)})
    [(name, (value, std))] = sizes(diagnose(shifted(recording, -0.025, "poses"))).items()
    assert name == "pose_latency"
    assert value == pytest.approx(-0.025, abs=CERTAIN * std + STAMPS)


@pytest.mark.further  # late wheels are distinguished from other latencies above
def test_all_sensors_late_together_are_a_delay_of_the_commands_and_no_late_wheels() -> None:
    hidden = hidden_recording(manoeuvre=EIGHT, seed=3)
    found = diagnose(shifted(hidden.recording, 0.1, "wheels", "gyro", "poses"))
    assert [effect.name for effect in found.effects] == ["command_delay"]
    assert sizes(found)["command_delay"][0] == pytest.approx(0.1, abs=0.01)


def test_wheels_that_the_driver_stamped_or_that_would_turn_before_their_commands_are_not_late() -> None:
    recording = shifted(hidden_recording(manoeuvre=EIGHT, seed=3).recording, -0.4, "gyro")
    assert check(recording).wheels_late is None  # motors follow within 0.2 s: it is the gyro's clock that is behind
    recording = hidden_recording(LATE, manoeuvre=EIGHT, seed=2).recording
    assert check(recording).wheels_late is not None
    fields = {**recording.wheels.fields, "applied_utime": recording.wheels.utime.astype(np.float64)}
    stamped = replace(recording, wheels=Signal(recording.wheels.utime, fields))
    assert stamped.driven_on_the_bus
    assert check(stamped).wheels_late is None


@pytest.mark.further  # of recordings of one's own: the tests before
def test_held_out_recordings_have_the_wheels_of_those_that_are_fitted() -> None:
    hidden = hidden_recording(LATE, manoeuvre=EIGHT, seed=2)
    short = hidden.recording.between(int(hidden.recording.wheels.utime[0]), int(hidden.recording.wheels.utime[3000]))
    found = diagnose(hidden.recording, held_out=[short])
    sentences = [one.sentence for one in found.checks if one.check == "wheels_late" and one.found]
    assert len(sentences) == 2
    assert len({sentence.partition(": ")[2] for sentence in sentences}) == 1


def test_many_short_recordings_tell_together_that_wheels_are_late() -> None:
    hidden = hidden_recording(LATE, "pose_latency", manoeuvre=CONTROLLED_WINDOWS, seed=1)
    whole = hidden.recording
    pieces = [whole.between(first, first + 2_000_000) for first in whole.pieces.first.tolist()]
    assert not any(check(piece).wheels_late for piece in pieces)
    found = {one.findings.wheels_late for one in looked_at(pieces)}
    assert len(found) == 1
    late = found.pop()
    assert late is not None
    assert late.seconds == pytest.approx(hidden.truth.parameters[LATE], abs=CERTAIN * late.std + STAMPS)


def test_poses_as_late_as_the_wheels_are_not_late_beside_them() -> None:
    recording = hidden_recording("pose_latency", manoeuvre=EIGHT, seed=2).recording
    values = {"wheel_radius": 0.04, "k2_over_k3": 100.0, "k1": 0.05, "base_width": 0.16}
    late = {**values, "pose_latency": 0.3, LATE: 0.2}
    errors = [path_rmse(recording, RobotParameters.of(of), by_wheels=True) for of in (late, values)]
    beside = path_rmse(recording, RobotParameters.of({**values, "pose_latency": 0.1}), by_wheels=True)
    assert errors[0] == pytest.approx(beside)
    assert errors[0] != pytest.approx(errors[1], rel=1e-3)

"""What the checks of the gyro promise: one of a wrong sign or unit is set aside by name, and a true one stays."""

import math
from dataclasses import replace

import numpy as np
import pytest

from cmr.calibration import calibrate
from cmr.parameters.file import ParameterFile, Value
from cmr.recordings import Recording
from cmr.recordings.faults.checks import check
from tests.support.emulated_drive import figure_eight
from tests.support.faulty_drive import Duties, at_rest, circle, later, lively, recording, without

pytestmark = pytest.mark.slow

FAULTS = ("gyro_reversed", "gyro_factor")
DRIVES = (figure_eight, lively, circle)


def gyro_times(whole: Recording, factor: float, bias: float = 0.0, noise: float = 0.0) -> Recording:
    gyro = whole.gyro
    rate = factor * gyro["yaw_rate"] + bias + np.random.default_rng(1).normal(0.0, noise, len(gyro))
    return replace(whole, gyro=replace(gyro, fields={"yaw_rate": rate}))


def mirrored(whole: Recording) -> Recording:
    fields = whole.poses.fields | {"y": -whole.poses["y"], "theta": -whole.poses["theta"]}
    return replace(whole, poses=replace(whole.poses, fields=fields))


def swapped(whole: Recording) -> Recording:
    wheels = whole.wheels.fields
    sides = {"left": "right", "right": "left"}
    other = {f"{what}_{side}": wheels[f"{what}_{sides[side]}"] for what in ("psi", "ticks") for side in sides}
    return replace(whole, wheels=replace(whole.wheels, fields=wheels | other))


def known(whole: Recording) -> Recording:
    """Return the recording with the robot's wheel radius and base width, as its driver announces them."""
    geometry = {"wheel_radius": Value(0.04), "base_width": Value(0.1)}
    return replace(whole, parameters=ParameterFile(0, geometry))


def found(whole: Recording) -> list[str]:
    findings = check(whole)
    return [name for name in FAULTS if findings[name].found]


@pytest.mark.parametrize("duties", DRIVES)
@pytest.mark.parametrize("seconds", [0.0, -0.7, 0.4])
@pytest.mark.parametrize("lost", [(), ("poses",), ("wheels",), ("wheels", "commands"), ("wheels", "poses")])
def test_a_gyro_that_is_upside_down_is_set_aside_and_its_clock_is_not_blamed(
    duties: Duties, seconds: float, lost: tuple[str, ...]
) -> None:
    whole = without(later(recording(duties, 2), "gyro", seconds), *lost)
    assert found(whole) == []
    faulty = gyro_times(whole, -1.0)
    findings = check(faulty)
    assert found(faulty) == ["gyro_reversed"]
    assert "--invert-gyro" in findings["gyro_reversed"].sentence
    assert len(findings.cleaned(faulty).gyro) == findings["gyro_clock"].found == 0
    bare = check(without(whole, "gyro"))
    for name in ("pose_outliers", "pose_jumps"):
        assert findings[name].found == bare[name].found


@pytest.mark.parametrize("duties", DRIVES)
@pytest.mark.parametrize(
    ("factor", "said"),
    [(math.degrees(1.0), "degrees per second"), (math.radians(1.0), "pi / 180"), (3.0, "3"), (0.4, "0.4")],
)
def test_a_gyro_in_another_unit_is_set_aside_and_the_factor_told(duties: Duties, factor: float, said: str) -> None:
    whole = gyro_times(recording(duties, 2), factor)
    assert found(whole) == ["gyro_factor"]
    assert said in check(whole)["gyro_factor"].sentence
    assert not len(check(whole).cleaned(whole).gyro)
    both = gyro_times(recording(duties, 2), -factor)
    assert found(both) == list(FAULTS)


@pytest.mark.parametrize("geometry", [False, True])
def test_without_poses_degrees_are_told_by_the_wheels_and_a_wrong_base_width_is_no_fault(geometry: bool) -> None:
    whole = without(recording(lively, 2), "poses")
    whole = known(whole) if geometry else whole
    assert found(gyro_times(whole, math.degrees(1.0))) == ["gyro_factor"]
    assert found(gyro_times(whole, math.radians(1.0))) == ["gyro_factor"]
    for scrub in (0.35, 1.0, 2.0):
        assert found(gyro_times(whole, scrub)) == []


@pytest.mark.parametrize("duties", [*DRIVES, at_rest])
@pytest.mark.parametrize(
    ("factor", "bias", "noise"),
    [(1.02, 0.0, 0.0), (0.8, 0.0, 0.0), (1.3, 0.0, 0.0), (1.0, -0.3, 0.0), (1.0, 0.3, 0.0), (1.0, 0.0, 0.5)],
)
def test_what_the_catalogue_knows_of_gyros_stays_an_effect(
    duties: Duties, factor: float, bias: float, noise: float
) -> None:
    for lost in ((), ("poses",), ("wheels",)):
        whole = gyro_times(without(recording(duties, 2), *lost), factor, bias, noise)
        assert found(whole) == []


@pytest.mark.parametrize("duties", DRIVES)
def test_a_gyro_is_not_blamed_for_what_poses_or_wheels_have_wrong(duties: Duties) -> None:
    whole = recording(duties, 2)
    assert found(mirrored(whole)) == []
    assert found(without(mirrored(whole), "wheels")) == []
    assert found(swapped(whole)) == []
    degrees = replace(whole.poses, fields=whole.poses.fields | {"theta": np.degrees(np.unwrap(whole.poses["theta"]))})
    assert found(replace(whole, poses=degrees)) == []
    assert found(known(replace(whole, poses=degrees))) == []


def test_a_clock_that_is_half_a_swing_late_does_not_make_the_gyro_reversed() -> None:
    def swinging(share: float) -> tuple[float, float]:
        turning = 0.3 * math.sin(2.0 * math.pi * 20.0 * share)  # every 1.6 s
        return 0.2 + turning, 0.2 - turning

    for seconds in (0.4, 0.8, 1.2):
        assert found(later(recording(swinging, 1), "gyro", seconds)) == []
        assert "gyro_reversed" not in found(later(gyro_times(recording(swinging, 1), 1.2), "gyro", -seconds))


@pytest.mark.further  # by a diagnosis: tests/diagnosis/test_awkward_data.py
def test_a_calibration_says_what_is_wrong_with_the_gyro_and_does_without_it() -> None:
    whole = recording(figure_eight, 2)
    nominal = ParameterFile(0, {"wheel_radius": Value(0.04)})
    clean = calibrate(whole, nominal)
    for factor, said in ((-1.0, "--invert-gyro"), (math.degrees(1.0), "degrees per second")):
        result = calibrate(gyro_times(whole, factor), nominal)
        assert any(said in note for note in result.notes)
        for name, estimate in clean.estimates.items():
            assert abs(result.estimates[name].value - estimate.value) < 3.0 * estimate.std, name


def test_a_base_width_is_not_fitted_to_a_gyro_that_is_upside_down() -> None:
    whole = without(recording(figure_eight, 2), "poses")
    nominal = ParameterFile(0, {"wheel_radius": Value(0.04)})
    assert "base_width" in calibrate(whole, nominal).estimates
    result = calibrate(gyro_times(whole, -1.0), nominal)
    assert "base_width" not in result.estimates
    assert any("--invert-gyro" in note for note in result.notes)

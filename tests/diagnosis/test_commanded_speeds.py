"""Of robots that are told how fast to go, calibration and diagnosis find how they follow, and invent nothing."""

from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cmr.calibration import CalibrationResult, calibrate
from cmr.commands.calibrate import main as calibrate_command
from cmr.diagnosis.diagnose import diagnose
from cmr.diagnosis.document import document, extended_file
from cmr.diagnosis.result import EFFECTS_FOUND, NO_EFFECT, Diagnosis
from cmr.estimation.estimates import Estimate, EstimationError
from cmr.model.motion import RobotState, drive
from cmr.parameters.file import ParameterFile, Value, load
from cmr.recordings.recording import Recording
from cmr.recordings.signal import hold
from tests.hidden_effects.logs import write_log
from tests.reference_plant.drives import NOMINAL_TICKS
from tests.support.lanes import further
from tests.support.speed_commanded import SpeedRobot, driven

pytestmark = pytest.mark.slow

SLOW = SpeedRobot()
QUICK = SpeedRobot(base_width=1.0, delay=0.0, response_time=0.15)  # on skidding wheels


def near(estimate: Estimate, truth: float) -> bool:
    """Tell whether an estimate is within 10 % or 3 standard deviations."""
    return abs(estimate.value - truth) < max(0.1 * truth, 3.0 * estimate.std)


def named(diagnosis: Diagnosis) -> list[str]:
    return [effect.name for effect in diagnosis.effects]


@cache
def quick() -> Diagnosis:
    """Return the diagnosis of a robot that hides nothing."""
    return diagnose(driven(QUICK, seed=2))


def estimates(diagnosis: Diagnosis) -> dict[str, Estimate]:
    assert diagnosis.extended is not None
    return dict(diagnosis.extended.estimates)


def without(recording: Recording, *signals: str) -> Recording:
    parts: dict[str, Any] = {name: getattr(recording, name).between(0, 0) for name in signals}
    return replace(recording, **parts)


@pytest.mark.parametrize("wheel_speeds", [False, *further(True)], ids=["body", "wheels"])
def test_response_and_delay_of_a_slow_robot_are_found_and_nothing_else_is_named(wheel_speeds: bool) -> None:
    found = diagnose(driven(SLOW, seed=1, wheel_speeds=wheel_speeds))
    assert found.verdict == EFFECTS_FOUND
    assert named(found) == ["command_delay"]
    assert not found.notes
    of = estimates(found)
    assert near(of["response_time"], SLOW.response_time)
    assert near(of["command_delay"], SLOW.delay)
    assert near(of["speed_scale"], 1.0)
    assert near(of["base_width"], SLOW.base_width)


def test_nothing_is_named_where_nothing_is_hidden() -> None:
    found = quick()
    assert found.verdict == NO_EFFECT
    assert near(estimates(found)["response_time"], QUICK.response_time)
    assert near(estimates(found)["base_width"], QUICK.base_width)


@pytest.mark.further  # such a robot: test_response_and_delay_of_a_slow_robot_are_found
def test_a_robot_that_takes_its_time_is_no_wrong_clock() -> None:
    slow = SpeedRobot(response_time=0.8, delay=0.2)
    found = diagnose(driven(slow, seed=3))
    assert not [note for note in found.notes if "clock" in note]
    assert near(estimates(found)["response_time"], slow.response_time)
    assert near(estimates(found)["command_delay"], slow.delay)


@pytest.mark.parametrize(
    ("effect", "size", "said"),
    [
        *further(
            ("turn_rate_limit", 0.4, "Commanded turns are limited to 0.4"),
            ("saturation", 0.18, "wheel speeds stop at 2."),
        ),
    ],
)
def test_limits_of_what_is_commanded_are_found_and_told_as_speeds(effect: str, size: float, said: str) -> None:
    limit: dict[str, Any] = {effect: size}
    found = diagnose(driven(SLOW, seed=1, **limit))
    assert set(named(found)) == {effect, "command_delay"}
    assert near(estimates(found)["response_time"], SLOW.response_time)
    assert said in next(one.cause for one in found.effects if one.name == effect)


@pytest.mark.further  # a limit of the turns leads to none, either
def test_an_acceleration_limit_leads_to_no_other_name() -> None:
    """With the gains of a model that lacks the limit, the gyro seems to read 7 % too little."""
    gentle = SpeedRobot(response_time=0.1)
    found = diagnose(driven(gentle, seed=2, slew_limit=0.3))
    assert set(named(found)) == {"slew_limit", "command_delay"}
    assert f"{0.3 * gentle.top_wheel_speed:.1f}"[:3] in found.effects[0].cause
    assert near(estimates(found)["response_time"], gentle.response_time)


@pytest.mark.further  # such a limit, where duties are commanded: tests/estimation/test_search.py
@pytest.mark.parametrize(("response_time", "seed"), [(0.3, 3), *further((0.1, 2))])
def test_a_limit_of_the_wheels_acceleration_is_not_taken_for_one_of_the_commands(
    response_time: float, seed: int
) -> None:
    """With either limit wheels move nearly alike; with the wrong one there is no delay, and speeds are 7 % too low."""
    robot = SpeedRobot(response_time=response_time)
    found = diagnose(driven(robot, seed=seed, controller_acceleration=3.0))
    assert set(named(found)) == {"current_limit", "command_delay"}
    assert "at most 3.0" in found.effects[0].cause or "at most 2.9" in found.effects[0].cause
    of = estimates(found)
    truth = {"response_time": response_time, "command_delay": robot.delay, "speed_scale": 1.0}
    assert all(near(of[name], value) for name, value in truth.items())


@pytest.mark.further  # the diagnosis reports limits in the same way
def test_a_robot_that_counts_by_another_wheel_separation_is_told_so() -> None:
    other = SpeedRobot(command_base_width=0.67)
    found = diagnose(replace(driven(other, seed=4), parameters=SLOW.nominal))
    assert set(named(found)) == {"wheel_separation_error", "command_delay"}
    assert near(estimates(found)["wheel_separation_error"], 0.67 / SLOW.command_base_width - 1.0)
    assert near(estimates(found)["base_width"], other.base_width)


@pytest.mark.further  # that a written file runs: test_diagnosis_document.py
def test_what_the_command_writes_simulates_the_robot_by_the_same_commands(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    recording = driven(SLOW, seed=1)
    log, out = write_log(tmp_path / "run.lcm", recording), tmp_path / "robot_0.yaml"
    assert calibrate_command(["--log", str(log), "--out", str(out)]) == 0
    said = capsys.readouterr().out
    assert "response_time" in said
    assert "k2_over_k3" not in said
    written = load(out)
    assert written.value("response_time") == pytest.approx(SLOW.response_time, rel=0.1)
    assert written.has("response_time", "speed_scale", "top_wheel_speed", "command_base_width")
    controller = written.velocity_controller
    assert controller is not None
    reported = {name: hold(recording.velocity_commands, name, recording.wheels.utime[:-1]) for name in ("v", "omega")}
    left, right = controller.duties_of_body(reported["v"], reported["omega"])
    moved = drive(left, right, np.full(len(left), 0.01), written.robot_parameters, RobotState.at_rest())
    turned = 2.0 * np.pi / NOMINAL_TICKS * recording.wheels["ticks_left"]
    assert np.abs(moved.angle_left - turned).max() < 0.02 * np.abs(np.diff(turned)).sum()
    assert np.abs(moved.angle_left - turned).max() < 1.0  # rad, of some 60


def test_the_diagnosis_and_its_file_name_the_parameters_of_the_controller() -> None:
    found = quick()
    reported = document(found)["extended"]["parameters"]
    assert reported["response_time"]["unit"] == "s"
    assert reported["response_time"]["std"] > 0.0
    assert "k1" not in reported
    written = extended_file(found, {})
    assert written.has_velocity_controller
    assert written.values["response_time"].value == reported["response_time"]["value"]


NOMINALS = {
    "ideal": {"response_time": 0.05, "top_wheel_speed": 12.0},
    "as_it_is": {"response_time": 0.3, "top_wheel_speed": 12.0, "speed_scale": 1.0},
}
RECORDED: dict[str, tuple[str, ...]] = {"everything": (), "no_gyro": ("gyro",), "poses_alone": ("gyro", "wheels")}


@pytest.mark.parametrize(
    ("recorded", "nominal"),
    [
        ("no_gyro", "as_it_is"),
        *further(*(("everything", nominal) for nominal in ("ideal", "as_it_is")), ("no_gyro", "ideal")),
        *further(*(("poses_alone", nominal) for nominal in ("ideal", "as_it_is"))),
    ],
)
def test_calibration_never_ends_worse_than_the_nominal_robot(recorded: str, nominal: str) -> None:
    recording = without(driven(SLOW, seed=5), *RECORDED[recorded])
    given = {name: Value(value) for name, value in NOMINALS[nominal].items()}
    result = calibrate(recording, ParameterFile(0, {**SLOW.nominal.values, **given}))
    assert result.path_rmse_after <= result.path_rmse_before
    assert not [note for note in result.notes if "earlier than they are stamped" in note]


@pytest.mark.parametrize("seed", further(24, 26))
def test_of_slow_robots_that_run_unevenly_the_truth_is_within_what_is_stated(seed: int) -> None:
    robot = SpeedRobot(response_time=0.4)
    of = estimates(diagnose(driven(robot, seed=seed)))
    truth = {"response_time": robot.response_time, "command_delay": robot.delay, "speed_scale": robot.speed_scale}
    for name, value in truth.items():
        assert abs(of[name].value - value) < 3.0 * of[name].std, name
        assert of[name].std < 0.05 * value, name


def test_poses_alone_tell_the_response_and_the_delay_apart() -> None:
    """The paper's method knew no delay: 0.14 s of it went into a response time of 0.295 s, known to 0.011 s."""
    robot = SpeedRobot(response_time=0.295, delay=0.143, base_width=0.9)
    result = calibrate(without(driven(robot, seed=1), "wheels", "gyro"))
    found = {**result.reported, **result.effects}
    truth = {"response_time": 0.295, "command_delay": 0.143, "speed_scale": 1.0, "base_width": 0.9}
    for name, value in truth.items():
        assert found[name].value == pytest.approx(value, abs=3.0 * found[name].std), name
        assert found[name].std < 0.1 * value, name
    assert not [note for note in result.notes if "k2_over_k3" in note or "k1" in note]


def test_of_poses_alone_a_late_command_is_said_to_be_no_other_than_a_late_pose() -> None:
    found = diagnose(without(driven(SLOW, seed=1), "wheels", "gyro"))
    assert named(found) == ["command_delay"]
    assert {"pose_latency", "longitudinal_slip"} <= set(found.effects[0].indistinguishable_from)


def test_wheels_alone_tell_the_response() -> None:
    robot = SpeedRobot(delay=0.0)
    result: CalibrationResult = calibrate(without(driven(robot, seed=6), "gyro", "poses"))
    assert near(result.reported["response_time"], robot.response_time)
    assert "base_width" in result.unidentified


def test_duties_and_speeds_are_not_calibrated_together() -> None:
    speeds = driven(QUICK, seconds=10.0)
    duties = replace(speeds.with_duties(*np.zeros((2, len(speeds.velocity_commands)))), converted_from="")
    with pytest.raises(EstimationError, match="calibrate them apart"):
        calibrate([speeds, duties])


def test_commands_of_the_body_need_the_width_that_they_are_counted_with() -> None:
    with pytest.raises(EstimationError, match="base_width"):
        calibrate(driven(QUICK, seconds=10.0), ParameterFile(0, {"wheel_radius": Value(0.165)}))

"""What calibrate() promises, on drives of an emulated robot whose truth is known."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from cmr.calibration import CalibrationResult, EstimationError, calibrate
from cmr.calibration.calibrate import PAPER
from cmr.calibration.segments import segments_of
from cmr.model.parameters import RobotParameters
from cmr.parameters.file import ParameterFile, Value, parse
from cmr.recordings import Recorder, Recording
from tests.support.emulated_drive import DEFAULT, IDEAL, NOMINAL, TRUTH, Message, messages, straight, write_log
from tests.support.lanes import further

pytestmark = pytest.mark.slow


def recording_of(drive: list[Message]) -> Recording:
    recorder = Recorder(0)
    for channel, message in drive:
        recorder.handle(message.utime, channel, message)
    return recorder.recording()


def errors_in_deviations(result: CalibrationResult) -> dict[str, float]:
    return {name: (e.value - TRUTH[name]) / e.std for name, e in result.estimates.items()}


@pytest.fixture(scope="module")
def default_drive() -> list[Message]:
    return messages(DEFAULT)


@pytest.fixture(scope="module")
def default_result(default_drive: list[Message]) -> CalibrationResult:
    return calibrate(recording_of(default_drive))


@pytest.mark.parametrize("seed", [1, *further(2, 3)])
def test_parameters_of_an_ideal_robot_are_found_within_three_standard_deviations(seed: int) -> None:
    result = calibrate(recording_of(messages(IDEAL, seed=seed)))
    assert set(result.estimates) == set(TRUTH)
    assert all(abs(error) < 3.0 for error in errors_in_deviations(result).values())
    # The deviations must be worth something: a millisecond of doubt about the commands' moment is 0.6 % of the motor's
    # time constant of 157 ms; everything else is known better than that.
    assert all(e.std < 0.01 * e.value for e in result.estimates.values())


@pytest.mark.parametrize("seed", [0, *further(1, 2)])
def test_parameters_of_an_imperfect_robot_are_found_within_three_percent(
    seed: int, default_result: CalibrationResult
) -> None:
    result = calibrate(recording_of(messages(DEFAULT, seed=seed))) if seed else default_result
    for name, estimate in result.estimates.items():
        assert estimate.value == pytest.approx(TRUTH[name], rel=0.03), name
    assert result.path_rmse_after < result.path_rmse_before / 5.0


def test_a_robot_that_never_turned_has_no_base_width() -> None:
    result = calibrate(recording_of(messages(DEFAULT, seconds=8.0, duties=straight)))
    assert "The turns of this drive determine" in result.unidentified["base_width"]
    assert set(result.estimates) == {"k2_over_k3", "k1"}
    assert result.estimates["k1"].value == pytest.approx(TRUTH["k1"], rel=0.03)
    # The file keeps what was given, without a deviation that nobody estimated.
    assert result.parameter_file({}).values["base_width"] == NOMINAL.values["base_width"]


def test_without_commands_wheel_radius_and_base_width_are_found_and_the_motor_is_not_invented() -> None:
    drive = messages(IDEAL, channels=("MOTOR_FEEDBACK", "POSE", "PARAMETERS"))
    for _channel, message in drive:
        if hasattr(message, "applied_left"):
            message.applied_left = message.applied_right = math.nan
    result = calibrate(recording_of(drive))
    assert set(result.estimates) == {"wheel_radius", "base_width"}
    assert result.estimates["wheel_radius"].value == pytest.approx(0.04, rel=0.005)
    assert result.estimates["base_width"].value == pytest.approx(TRUTH["base_width"], rel=0.005)
    assert all("No motor commands" in result.unidentified[name] for name in ("k2_over_k3", "k1"))


def test_without_poses_motor_and_base_width_are_found_from_wheels_and_gyro() -> None:
    result = calibrate(
        recording_of(messages(IDEAL, channels=("MOTOR_COMMAND", "MOTOR_FEEDBACK", "GYRO", "PARAMETERS")))
    )
    assert set(result.estimates) == set(TRUTH)
    for name, estimate in result.estimates.items():
        assert estimate.value == pytest.approx(TRUTH[name], rel=0.01), name
    assert math.isnan(result.path_rmse_after)


def test_without_poses_and_gyro_the_base_width_is_not_invented() -> None:
    result = calibrate(recording_of(messages(IDEAL, channels=("MOTOR_COMMAND", "MOTOR_FEEDBACK", "PARAMETERS"))))
    assert set(result.estimates) == {"k2_over_k3", "k1"}
    assert "gyro" in result.unidentified["base_width"]


@pytest.mark.parametrize("duty", [0.0612, 0.3446])
def test_a_coarse_encoder_does_not_draw_the_motor_to_whole_ticks(duty: float) -> None:
    channels = ("MOTOR_COMMAND", "MOTOR_FEEDBACK", "PARAMETERS")
    drive = messages(IDEAL, seconds=10.0, duties=lambda _share: (duty, duty), channels=channels)
    assert calibrate(recording_of(drive)).estimates["k1"].value == pytest.approx(TRUTH["k1"], rel=0.002)


def test_a_dead_gyro_leaves_the_base_width_unknown() -> None:
    drive = messages(IDEAL, seconds=8.0, channels=("MOTOR_COMMAND", "MOTOR_FEEDBACK", "GYRO", "PARAMETERS"))
    for channel, message in drive:
        if channel.startswith("GYRO"):
            message.yaw_rate = 0.0
    result = calibrate(recording_of(drive))
    assert "base_width" in result.unidentified
    assert "k1" in result.estimates


def test_a_robot_that_turned_on_the_spot_is_calibrated() -> None:
    def spin(share: float) -> tuple[float, float]:
        return (-0.2, 0.2) if share < 0.5 else (0.2, -0.2)

    result = calibrate(recording_of(messages(IDEAL, seconds=10.0, duties=spin)))
    assert result.method == "average"
    for name, estimate in result.estimates.items():
        assert estimate.value == pytest.approx(TRUTH[name], rel=0.02), name


def test_the_paper_s_method_says_how_far_it_can_be_trusted(default_drive: list[Message]) -> None:
    result = calibrate(recording_of(default_drive), method=PAPER)
    (trust,) = (note for note in result.notes if "trust" in note)
    assert "its halves by themselves give k2_over_k3" in trust
    for name, estimate in result.estimates.items():
        assert estimate.value == pytest.approx(TRUTH[name], rel=0.03), name


def test_the_path_error_told_by_the_paper_s_method_is_that_of_the_whole_drive() -> None:
    recording = recording_of(messages(DEFAULT, seconds=8.0, duties=straight))
    result = calibrate(recording, method=PAPER)
    assert "base_width" not in result.estimates
    (segment,) = segments_of(recording)
    path = segment.simulate(RobotParameters.of(result.values))
    distance = np.hypot(path.x[segment.at] - segment.x, path.y[segment.at] - segment.y)
    assert result.path_rmse_after == pytest.approx(float(np.sqrt(np.mean(distance**2))), rel=1e-9)


def test_poses_and_commands_without_wheels_are_enough_for_the_path() -> None:
    result = calibrate(recording_of(messages(IDEAL, channels=("MOTOR_COMMAND", "POSE", "PARAMETERS"))))
    for name, estimate in result.estimates.items():
        assert estimate.value == pytest.approx(TRUTH[name], rel=0.01), name


def test_a_wrong_wheel_radius_is_told_and_the_path_is_still_right() -> None:
    given = ParameterFile(0, {"wheel_radius": Value(0.044)})
    result = calibrate(recording_of(messages(IDEAL)), given)
    assert result.path_rmse_after < 0.01
    assert any("m would fit instead of 0.044 m" in note for note in result.notes)


@pytest.mark.further  # a sum of information; diagnoses of several recordings show it, too
def test_two_recordings_tell_more_than_one() -> None:
    first, second = (recording_of(messages(IDEAL, seed=seed, seconds=15.0)) for seed in (1, 2))
    alone, together = calibrate(first), calibrate([first, second])
    assert together.samples == alone.samples + calibrate(second).samples
    for name in TRUTH:
        # What both may hide is drawn at random; of these clean drives nothing else is in doubt.
        assert together.estimates[name].std < 1.5 * alone.estimates[name].std


def test_without_a_wheel_radius_it_says_what_to_do(default_drive: list[Message]) -> None:
    recording = replace(recording_of(default_drive), parameters=None)
    with pytest.raises(EstimationError, match="--parameters"):
        calibrate(recording)


def test_a_robot_that_never_moved_is_refused() -> None:
    with pytest.raises(EstimationError, match="Nothing to compare"):
        calibrate(
            recording_of(
                messages(
                    DEFAULT, seconds=3.0, duties=lambda _share: (0.0, 0.0), channels=["MOTOR_FEEDBACK", "PARAMETERS"]
                )
            )
        )


def test_a_robot_that_stood_still_though_commanded_is_refused() -> None:
    drive = messages(DEFAULT, seconds=3.0)
    for channel, message in drive:
        if channel.startswith("POSE"):
            message.x = message.y = message.theta = 0.0
    with pytest.raises(EstimationError, match="poses"):
        calibrate(recording_of(drive))


def test_neither_a_log_on_disk_nor_what_was_believed_before_changes_the_numbers(
    default_drive: list[Message], default_result: CalibrationResult, tmp_path: Path
) -> None:
    other = ParameterFile(0, {"wheel_radius": Value(0.04), "k1": Value(0.02), "k2_over_k3": Value(900.0)})
    recording = Recording.read(write_log(tmp_path / "run.lcm", default_drive))
    assert calibrate(recording, other).estimates == default_result.estimates


def test_the_parameter_file_says_where_the_numbers_come_from(default_result: CalibrationResult) -> None:
    file = parse(default_result.parameter_file({"log": "run.lcm"}).to_yaml())
    assert file.provenance["method"] == "average"
    assert file.provenance["log"] == "run.lcm"
    assert file.values["k1"].std == pytest.approx(default_result.estimates["k1"].std)
    assert file.value("wheel_radius") == 0.04


def test_the_summary_reads_as_a_table(default_result: CalibrationResult) -> None:
    summary = default_result.summary()
    for word in (
        "k2_over_k3",
        "rad/s^2",
        "k1",
        "s/rad",
        "base_width",
        "wheel_radius",
        "as given",
        "95 % interval",
        "before",
        "after",
    ):
        assert word in summary

"""The paper's method on a drive that its model does not explain: its surface, its picture, and no trust."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from cmr.calibration import CalibrationResult, calibrate
from cmr.calibration.calibrate import PAPER
from cmr.calibration.calibrator import Calibrator
from cmr.calibration.contradictions import wheels_against_poses
from cmr.calibration.grid import Grid, told_by_surface
from cmr.calibration.paper import _radius_note
from cmr.calibration.plots import figure_of
from cmr.calibration.segments import segments_of
from cmr.cli.errors import CommandError
from cmr.commands.calibrate import main
from cmr.estimation.estimates import Estimate, EstimationError
from cmr.model.parameters import RobotParameters
from cmr.msg import calibration_status_t
from cmr.parameters.file import Value, parse
from cmr.recordings.recording import Recording
from tests.calibration.test_alone import HIDDEN, NOMINAL, figure_eight
from tests.hidden_effects.logs import write_log

pytestmark = pytest.mark.slow

RADIUS = 0.04  # m


@pytest.fixture(scope="module")
def drive() -> Recording:
    return figure_eight(HIDDEN, "two60")


@pytest.fixture(scope="module")
def result(drive: Recording) -> CalibrationResult:
    return calibrate(drive, method=PAPER)


def test_the_minimum_of_the_surface_is_given_with_the_reason_not_to_trust_it(result: CalibrationResult) -> None:
    assert result.grid is not None
    (distrust,) = (note for note in result.notes if "Do not trust" in note)
    assert "halves by themselves give k2_over_k3" in distrust
    assert "Unequal motors or wheels" in distrust
    # Nothing speaks against the given radius: it is that of the robot.
    assert not any("Check wheel_radius" in note for note in result.notes)
    for name in ("k2_over_k3", "k1", "base_width"):
        assert result.values[name] == result.grid.best[name]


def inside(result: CalibrationResult) -> CalibrationResult:
    """Return the result as if its values were those of a least error inside the grid."""
    assert result.grid is not None
    around = np.array([0.9, 1.0, 1.1])
    axes = [around * result.grid.best[name] for name in ("k2_over_k3", "k1", "base_width")]
    return replace(result, grid=Grid(*axes, np.where(np.arange(27).reshape(3, 3, 3) == 13, 1.0, 2.0)))


def test_its_file_is_one_robot_whose_path_error_is_the_stated_one(result: CalibrationResult) -> None:
    file = parse(inside(result).parameter_file({"log": "run.lcm"}).to_yaml())
    parameters = RobotParameters.of({name: value.value for name, value in file.values.items()})
    (segment,) = result.segments
    path = segment.simulate(parameters)
    error = np.sqrt(np.mean((path.x[segment.at] - segment.x) ** 2 + (path.y[segment.at] - segment.y) ** 2))
    assert file.provenance["path_rmse_m"] == pytest.approx(float(error), abs=0.6e-6)  # it is rounded to micrometres
    assert set(result.estimates) | set(result.unidentified) == {"k2_over_k3", "k1", "base_width"}
    for name in result.unidentified:
        assert file.values[name].std is None


def at_the_edge(result: CalibrationResult) -> CalibrationResult:
    """Return the result as if the least error were at the largest k1 of the grid."""
    grid = inside(result).grid
    assert grid is not None
    k1 = np.append(grid.k1[:1], grid.best["k1"])
    return replace(result, grid=replace(grid, k1=k1, mean_square=grid.mean_square[:, :2]))


def test_values_at_the_edge_of_the_grid_are_no_minimum_and_make_no_file(result: CalibrationResult) -> None:
    """A robot with such values would be another one: nobody knows how far the error falls on beyond the edge."""
    assert inside(result).why_no_file == ""
    edge = at_the_edge(result)
    assert edge.grid is not None
    assert edge.grid.at_the_edge == ("k1",)
    with pytest.raises(EstimationError, match=r"edge of the grid \(k1 .* s/rad\).*Leave out --method paper"):
        edge.parameter_file({"log": "run.lcm"})


def test_the_command_draws_such_a_surface_and_fails_without_a_file(
    result: CalibrationResult, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, drive: Recording
) -> None:
    edge = at_the_edge(result)
    monkeypatch.setattr("cmr.commands.calibrate.calibrate", lambda *_recordings, **_options: edge)
    log, out, picture = write_log(tmp_path / "run.lcm", drive), tmp_path / "robot_0.yaml", tmp_path / "paper.svg"
    with pytest.raises(CommandError, match="No file is written"):
        main([str(log), "--method", "paper", "--out", str(out), "--picture", str(picture)])
    assert picture.exists()
    assert not out.exists()


def test_a_live_calibration_fails_with_the_reason_where_there_is_no_minimum(
    result: CalibrationResult, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("cmr.calibration.calibrator.calibrate", lambda *_recordings, **_options: at_the_edge(result))
    calibrator = Calibrator(0, NOMINAL, method=PAPER)
    assert calibrator.fit() is not None  # for its picture
    status = calibrator.status()
    assert status.state == calibration_status_t.FAILED
    assert "edge of the grid" in status.message


def test_its_picture_shows_the_surface_and_warns(result: CalibrationResult, tmp_path: Path) -> None:
    figure = figure_of(result)
    figure.savefig(tmp_path / "paper.png")
    assert sum(" = " in axes.get_title() for axes in figure.axes) == 3
    assert "do not trust" in figure.get_suptitle()
    labels = {str(line.get_label()) for axes in figure.axes for line in axes.lines}
    assert "best grid point" in labels
    assert "refined" not in labels


def bowl(centre: float, width: float) -> Grid:
    """Return a surface whose error is 1 m at best, and grows with the distance of k1 from `centre`; flat otherwise."""
    k2_over_k3, k1, base_width = np.linspace(50.0, 200.0, 7), np.linspace(0.04, 0.08, 401), np.linspace(0.1, 0.2, 5)
    error = 1.0 + 0.1 * np.abs(k1 - centre) / width
    return Grid(k2_over_k3, k1, base_width, np.broadcast_to(error[None, :, None] ** 2, (7, 401, 5)))


def test_a_parameter_is_told_within_what_changes_the_path_error_by_a_tenth() -> None:
    estimates, untold = told_by_surface(bowl(0.06, 0.005), ("k2_over_k3", "k1", "base_width"))
    assert set(estimates) == {"k1"}
    assert set(untold) == {"k2_over_k3", "base_width"}
    step = 1e-4
    assert estimates["k1"].value == pytest.approx(0.06, abs=step)
    assert estimates["k1"].std == pytest.approx(0.005, abs=step)


def test_a_parameter_whose_alike_values_reach_the_edge_is_not_told() -> None:
    _estimates, untold = told_by_surface(bowl(0.042, 0.005), ("k1",))
    assert "edge" in untold["k1"]


def test_wheels_and_poses_agree_in_each_moment_whatever_bends_the_path(drive: Recording) -> None:
    segments = segments_of(drive)
    # Noise of 3 mm adds 2 (3 mm)^2 to the square of each way, of 0.1 m and more: 0.1 % of the root.
    assert wheels_against_poses(segments, RADIUS) == pytest.approx(1.0, abs=0.005)
    assert wheels_against_poses(segments, 1.1 * RADIUS) == pytest.approx(1.1, abs=0.0055)


def test_the_radius_is_blamed_only_where_wheels_and_poses_contradict_each_other(drive: Recording) -> None:
    segments, bent = segments_of(drive), Estimate(1.5, 0.01)
    (neutral,) = _radius_note(segments, RADIUS, bent)
    assert "wheel_radius" not in neutral
    assert "unequal motors" in neutral
    (blamed,) = _radius_note(segments, 1.1 * RADIUS, bent)
    fitting = re.search(r"Check wheel_radius \(([\d.]+) m would fit instead of 0.044 m\)", blamed)
    assert fitting is not None
    assert float(fitting[1]) == pytest.approx(RADIUS, rel=0.005)
    assert _radius_note(segments, 1.1 * RADIUS, Estimate(1.01, 0.001)) == ()


def test_the_drive_that_goes_on_is_told_by_the_method_that_was_asked_for(drive: Recording) -> None:
    nominal = replace(NOMINAL, values={**NOMINAL.values, "wheel_radius": Value(RADIUS)})
    calibrator = Calibrator(0, nominal, method=PAPER)
    calibrator.look(drive)
    assert calibrator.preview is not None
    assert calibrator.preview.method == "grid"
    assert calibrator.averages == 1


def test_paper_only_with_the_paper_s_method_is_wrong_usage(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as wrong:
        main(["--log", "run.lcm", "--method", "paper", "--paper-only"])
    assert wrong.value.code == 2
    assert "--paper-only" in capsys.readouterr().err

"""What the figure of a calibration shows."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.colors import to_hex
from matplotlib.figure import Figure

from cmr.calibration.grid import Grid, axes_for, search
from cmr.calibration.plots import figure_of
from cmr.calibration.result import CalibrationResult
from cmr.calibration.seen_path import seen_path
from cmr.calibration.segments import path_error, segments_of
from cmr.estimation.estimates import Estimate
from cmr.model.parameters import RobotParameters
from cmr.recordings.recording import Recorder
from cmr.report.colours import REAL_COLOUR, TWIN_COLOUR
from tests.support.emulated_drive import IDEAL, NOMINAL, TRUTH, messages


@pytest.fixture(scope="module")
def result() -> CalibrationResult:
    """A result made of a real drive's segments and grid, and of the truth as the refined parameters."""
    recorder = Recorder(0)
    for channel, message in messages(IDEAL, seconds=12.0):
        recorder.handle(message.utime, channel, message)
    segments = segments_of(recorder.recording())
    before = {name: value.value for name, value in NOMINAL.values.items()}
    errors = [
        path_error(segments, [segment.simulate(RobotParameters.of(values)) for segment in segments])
        for values in (before, before | dict(TRUTH))
    ]
    return CalibrationResult(
        robot_id=0,
        estimates={name: Estimate(value, 0.01 * value) for name, value in TRUTH.items()},
        unidentified={},
        nominal=NOMINAL,
        method="grid+refine",
        samples=len(segments[0].x),
        covariance=np.diag([(0.01 * value) ** 2 for value in TRUTH.values()]),
        path_rmse_before=errors[0],
        path_rmse_after=errors[1],
        segments=segments,
        grid=search(segments, 0.04, axes_for(segments, 0.04, None)),
    )


def titled(figure: Figure, beginning: str) -> Axes:
    (axes,) = (axes for axes in figure.axes if axes.get_title().startswith(beginning))
    return axes


def titles(figure: Figure) -> list[str]:
    return [axes.get_title().partition("\n")[0] for axes in figure.axes if axes.get_title()]


def test_real_paths_are_yellow_and_simulated_ones_blue_before_and_after(result: CalibrationResult) -> None:
    figure = figure_of(result)
    for title, error in (("before", result.path_rmse_before), ("after", result.path_rmse_after)):
        axes = titled(figure, title)
        real, simulated, start = axes.lines
        assert (to_hex(real.get_color()), to_hex(simulated.get_color())) == (REAL_COLOUR, TWIN_COLOUR)
        assert f"{error:.3g} m" in axes.get_title()
        np.testing.assert_array_equal(np.asarray(real.get_xdata())[:-1], result.segments[0].x)
        np.testing.assert_array_equal(start.get_xdata(), result.segments[0].x[:1])


def test_the_position_error_in_time_is_that_of_the_titles(result: CalibrationResult) -> None:
    axes = titled(figure_of(result), "Residual over time")
    for line, error in zip(axes.lines, (result.path_rmse_before, result.path_rmse_after), strict=True):
        distances = np.asarray(line.get_ydata(), dtype=float)
        assert np.sqrt(np.nanmean(distances**2)) == pytest.approx(error)
        times = np.asarray(line.get_xdata(), dtype=float)
        assert np.nanmax(times) == pytest.approx(result.segments[0].border_times[-1])


def test_wheel_speeds_of_the_true_model_differ_by_encoder_steps_only(result: CalibrationResult) -> None:
    (axes,) = (axes for axes in figure_of(result).axes if "wheel speed" in axes.get_ylabel())
    step = 2.0 * np.pi / IDEAL.robot.ticks_per_turn  # rad
    for side in axes.lines[:2]:
        residuals = np.asarray(side.get_ydata(), dtype=float)
        assert np.nanmax(np.abs(residuals)) < 2.0 * step / 0.1  # an angle may be a step off at either end of 0.1 s
        assert np.count_nonzero(np.isfinite(residuals)) > 100


def test_the_error_surface_is_cut_through_its_best_point(result: CalibrationResult) -> None:
    grid = result.grid
    assert grid is not None
    figure = figure_of(result)
    pairs = {"base_width": ("k2_over_k3", "k1"), "k2_over_k3": ("k1", "base_width"), "k1": ("k2_over_k3", "base_width")}
    for fixed, names in pairs.items():
        axes = titled(figure, f"{fixed} = {grid.best[fixed]:.4g}")
        assert (axes.get_xscale(), axes.get_yscale()) == ("log", "log")
        assert [label.split()[0] for label in (axes.get_xlabel(), axes.get_ylabel())] == list(names)
        marks = {str(line.get_label()): (line.get_xdata()[0], line.get_ydata()[0]) for line in axes.lines}  # type: ignore[index]
        assert marks == {
            "best grid point": tuple(grid.best[name] for name in names),
            "refined": tuple(TRUTH[name] for name in names),
        }


def test_the_colours_reach_from_the_smallest_to_the_largest_error_shown(result: CalibrationResult) -> None:
    grid = result.grid
    assert grid is not None
    (bar,) = (axes for axes in figure_of(result).axes if "path error" in axes.get_ylabel())
    lowest, highest = bar.get_ylim()
    assert lowest == pytest.approx(float(np.sqrt(grid.mean_square.min())))
    assert lowest < highest <= float(np.sqrt(grid.mean_square.max())) * (1.0 + 1e-8)
    assert bar.get_yscale() == "log"


def test_without_a_grid_the_paths_are_drawn_alone(result: CalibrationResult) -> None:
    assert titles(figure_of(replace(result, grid=None))) == [
        "before calibration",
        "after calibration",
        "Residual over time",
    ]


def test_a_grid_with_one_base_width_is_cut_once(result: CalibrationResult) -> None:
    whole = result.grid
    assert whole is not None
    grid = Grid(whole.k2_over_k3, whole.k1, whole.base_width[:1], whole.mean_square[:, :, :1])
    width = {"base_width": "the robot never turned"}
    figure = figure_of(replace(result, grid=grid, unidentified=width))
    assert [title for title in titles(figure) if " = " in title] == [f"base_width = {grid.base_width[0]:.4g} m"]


def test_without_parameters_before_only_the_path_after_is_drawn(result: CalibrationResult) -> None:
    nominal = replace(NOMINAL, values={"wheel_radius": NOMINAL.values["wheel_radius"]})
    figure = figure_of(replace(result, nominal=nominal, path_rmse_before=math.nan))
    assert titles(figure)[:2] == ["after calibration", "Residual over time"]
    assert len(titled(figure, "Residual over time").lines) == 1


def test_a_path_that_follows_the_wheels_has_no_wheel_residuals(result: CalibrationResult) -> None:
    figure = figure_of(replace(result, by_wheels=True, grid=None))
    assert not any("wheel speed" in axes.get_ylabel() for axes in figure.axes)
    (segment,) = result.segments
    path = seen_path(segment, RobotParameters.of(result.values), by_wheels=True)
    np.testing.assert_array_equal(np.asarray(titled(figure, "after").lines[1].get_xdata())[:-1], path.x)


def test_without_a_path_the_figure_is_the_table(result: CalibrationResult) -> None:
    figure = figure_of(replace(result, segments=[], grid=None))
    assert not figure.axes
    assert [text.get_text() for text in figure.texts] == [replace(result, segments=[], grid=None).summary()]


def test_several_drives_are_drawn_one_after_the_other(result: CalibrationResult) -> None:
    figure = figure_of(replace(result, segments=result.segments * 2, grid=None))
    times = np.asarray(titled(figure, "Residual over time").lines[0].get_xdata(), dtype=float)
    assert np.nanmax(times) == pytest.approx(2.0 * result.segments[0].border_times[-1])
    assert np.count_nonzero(np.isnan(times)) == 2  # a line breaks behind each drive


@pytest.mark.slow
def test_the_figure_can_be_written_as_a_file(result: CalibrationResult, tmp_path: Path) -> None:
    figure_of(result).savefig(tmp_path / "calibration.png")
    assert (tmp_path / "calibration.png").read_bytes().startswith(b"\x89PNG")

"""Plot a calibration: the path before and after, residuals over time, and the error surface."""

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from cmr.calibration.grid import Grid
from cmr.calibration.preparing import prepare
from cmr.calibration.result import GRID, CalibrationResult
from cmr.calibration.seen_path import seen_path
from cmr.calibration.segments import Segment
from cmr.estimation import free_runs
from cmr.model.motion import Trajectory
from cmr.model.parameters import DEFINITIONS, RobotParameters
from cmr.recordings.signal import Floats
from cmr.report.colours import TWIN_COLOUR
from cmr.report.paths import draw_paths

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.axis import Axis
    from matplotlib.contour import QuadContourSet
    from matplotlib.figure import Figure, SubFigure

SLICES = (("k2_over_k3", "k1"), ("k1", "base_width"), ("k2_over_k3", "base_width"))
BEFORE_COLOUR, RIGHT_COLOUR, REFINED_COLOUR = "#9db4f0", "#d8581f", "#ffd700"  # pale blue, orange, gold
WINDOW_OF_ERRORS = free_runs.WINDOW  # s
WINDOW = 0.1  # s over which wheel speeds are averaged; over less, encoder quantisation dominates
LEVELS = 25  # of the error surface
COARSE_TICKS, FINE_TICKS = (1.0, 2.0, 5.0), (1.0, 1.5, 2.0, 2.5, 3.0, 4.0, 5.0, 6.0, 8.0)  # of a logarithmic axis

UNEXPLAINED = "  (the model does not explain this drive: do not trust the numbers)"

Paths = list[Trajectory] | None  # one for each segment; None where parameters are missing


def figure_of(result: CalibrationResult) -> "Figure":
    """Return a figure of a result: paths, residuals in time and slices of the error surface, if available.

    Real paths are yellow and simulated ones blue. The slices go through the best grid point. Without a path, the
    figure holds the table of the estimates.
    """
    from matplotlib.figure import Figure  # slow to import, and few want a picture

    if not result.segments and result.recordings and math.isfinite(result.path_rmse_after):
        result = replace(result, segments=prepare(result.recordings).segments())
    grid = result.grid if result.grid is not None and _slices(result.grid) else None
    figure = Figure(figsize=(16.0, 9.5 if grid else 5.5), dpi=100, layout="constrained")
    if not result.segments:
        figure.text(0.05, 0.95, result.summary(), family="monospace", fontsize=13, va="top")
        return figure
    figure.suptitle(_title(result), fontsize=15)
    rows = figure.subfigures(2 if grid else 1, 1, squeeze=False, hspace=0.04)[:, 0]
    nominal = {name: value.value for name, value in result.nominal.values.items()}
    before = _paths(result, nominal, result.path_rmse_before)
    _draw_drives(rows[0], result, before, _paths(result, result.values, result.path_rmse_after))
    if grid:
        _draw_surface(rows[1], grid, {} if result.method == GRID else result.values)
    return figure


def _title(result: CalibrationResult) -> str:
    """Return a one-line summary."""
    estimates = result.estimates.items()
    found = (f"{name} {e.value:.4g} \u00b1 {e.std:.2g} {DEFINITIONS[name].unit}" for name, e in estimates)
    trust = UNEXPLAINED if result.method == GRID else ""
    return f"Calibration of robot {result.robot_id}:  {',  '.join(found)}{trust}"


def _paths(result: CalibrationResult, values: Mapping[str, float], error: float) -> Paths:
    """Simulate all segments; None if the path error is unknown. Unidentifiable parameters do not matter."""
    if not math.isfinite(error):
        return None
    parameters = RobotParameters.of(dict.fromkeys(result.unidentified, 1.0) | dict(values))
    return [
        seen_path(s, parameters, by_wheels=True) if result.by_wheels else s.simulate(parameters)
        for s in result.segments
    ]


def _draw_drives(figure: "SubFigure", result: CalibrationResult, before: Paths, after: Paths) -> None:
    """Draw the paths beside the residuals in time."""
    wheels = not result.by_wheels and all(len(segment.angle_left) for segment in result.segments)
    columns = [*(["before"] if before else []), "after"]
    rows = ["errors", "wheels"] if wheels else ["errors"]
    axes = figure.subplot_mosaic([[*columns, row] for row in rows])
    over = f"over {WINDOW_OF_ERRORS:g} s" if result.recordings else "over the whole drive"
    if before:
        _draw_path(axes["before"], result.segments, before, "before calibration", result.path_rmse_before, over)
    if after:
        _draw_path(axes["after"], result.segments, after, "after calibration", result.path_rmse_after, over)
        _draw_position_errors(axes["errors"], result.segments, before, after)
    if after and wheels:
        _draw_wheel_residuals(axes["wheels"], result.segments, after)
        axes["errors"].tick_params(labelbottom=False)
        axes["errors"].set_xlabel("")
        axes["wheels"].sharex(axes["errors"])


def _draw_path(
    axes: "Axes", segments: list[Segment], paths: list[Trajectory], title: str, error: float, over: str
) -> None:
    """Draw real and simulated positions of all segments; the path `error` [m] is that `over` some time."""
    real = _joined([s.x for s in segments]), _joined([s.y for s in segments])
    simulated = _joined([p.x for p in paths]), _joined([p.y for p in paths])
    starts = np.array([s.x[0] for s in segments]), np.array([s.y[0] for s in segments])
    draw_paths(axes, real, simulated, starts, f"{title}\npath error {error:.3g} m (root mean square {over})")


def _draw_position_errors(axes: "Axes", segments: list[Segment], before: Paths, after: list[Trajectory]) -> None:
    """Draw the distance between real and simulated position in time."""
    times = _joined([time[s.at] for s, time in zip(segments, _driven(segments), strict=True)])
    for paths, label, colour in ((before, "before", BEFORE_COLOUR), (after, "after", TWIN_COLOUR)):
        if paths:
            distances = [np.hypot(p.x[s.at] - s.x, p.y[s.at] - s.y) for s, p in zip(segments, paths, strict=True)]
            axes.plot(times, _joined(distances), color=colour, linewidth=1.2, label=label)
    axes.set_yscale("log")
    axes.set_title("Residual over time")
    axes.set_xlabel("time driven [s]")
    axes.set_ylabel("position error [m]")
    axes.grid(alpha=0.3)
    axes.legend(loc="best", frameon=False, ncols=2)


def _draw_wheel_residuals(axes: "Axes", segments: list[Segment], paths: list[Trajectory]) -> None:
    """Draw simulated minus measured wheel speeds in time."""
    for side, colour in (("left", TWIN_COLOUR), ("right", RIGHT_COLOUR)):
        times, residuals = [], []
        for segment, path, time in zip(segments, paths, _driven(segments), strict=True):
            ahead = getattr(path, f"angle_{side}") - getattr(segment, f"angle_{side}")
            borders = np.unique(np.searchsorted(time, np.arange(time[0], time[-1], WINDOW)))
            times.append((time[borders[1:]] + time[borders[:-1]]) / 2.0)
            residuals.append(np.diff(ahead[borders]) / np.diff(time[borders]))
        axes.plot(_joined(times), _joined(residuals), color=colour, linewidth=0.9, label=side)
    axes.axhline(0.0, color="black", linewidth=0.6)
    axes.set_xlabel("time driven [s]")
    axes.set_ylabel("wheel speed,\nsimulated - measured [rad/s]")
    axes.grid(alpha=0.3)
    axes.legend(loc="best", frameon=False, ncols=2)


def _draw_surface(figure: "SubFigure", grid: Grid, values: Mapping[str, float]) -> None:
    """Draw slices of the error surface through the best grid point, in one scale of colours."""
    slices = _slices(grid)
    errors = [np.sqrt(_slice(grid, *names)) for names in slices]
    lowest, highest = min(float(error.min()) for error in errors), max(float(error.max()) for error in errors)
    # Includes the highest error, and keeps levels distinct.
    levels = np.geomspace(lowest, highest * (1.0 + 1e-9), LEVELS)
    places = figure.subplots(1, len(slices), squeeze=False)[0]
    for place, names, error in zip(places, slices, errors, strict=True):
        filled = _draw_slice(place, grid, names, error, levels)
        for point, marker, colour, label in (
            (grid.best, "o", "white", "best grid point"),
            (values, "*", REFINED_COLOUR, "refined"),
        ):
            if set(names) <= set(point):
                at = [point[name] for name in names]
                place.plot(
                    *at, marker, color=colour, markeredgecolor="black", markersize=12, label=label, clip_on=False
                )
    places[0].legend(loc="best", facecolor="white", framealpha=0.8)
    bar = figure.colorbar(filled, ax=places, label="path error [m], root mean square", pad=0.01)
    _plain_ticks(bar.ax.yaxis, levels)


def _slices(grid: Grid) -> list[tuple[str, str]]:
    """Return the pairs of parameters with more than one value in the grid."""
    return [(first, second) for first, second in SLICES if len(getattr(grid, first)) > 1 < len(getattr(grid, second))]


def _slice(grid: Grid, first: str, second: str) -> Floats:
    """Return the mean square error [m^2] over two parameters, the third as at the best point; shape (second, first)."""
    names = ("k2_over_k3", "k1", "base_width")
    (fixed,) = (name for name in names if name not in (first, second))
    (at,) = np.flatnonzero(getattr(grid, fixed) == grid.best[fixed])[:1]
    return np.asarray(np.take(grid.mean_square, int(at), axis=names.index(fixed)).T)


def _draw_slice(place: "Axes", grid: Grid, names: tuple[str, str], error: Floats, levels: Floats) -> "QuadContourSet":
    """Draw one slice; all axes and colours are logarithmic."""
    from matplotlib.colors import LogNorm

    first, second = (getattr(grid, name) for name in names)
    filled = place.contourf(first, second, error, levels=levels, norm=LogNorm(levels[0], levels[-1]), cmap="viridis")
    place.contour(first, second, error, levels=levels, colors="white", linewidths=0.4, alpha=0.5)
    (fixed,) = set(grid.best) - set(names)
    place.set_title(f"{fixed} = {grid.best[fixed]:.4g} {DEFINITIONS[fixed].unit}")
    place.set_xscale("log")
    place.set_yscale("log")
    for axis, name, values in ((place.xaxis, names[0], first), (place.yaxis, names[1], second)):
        _plain_ticks(axis, values)
        axis.set_label_text(f"{name} [{DEFINITIONS[name].unit}]")
    return filled


def _plain_ticks(axis: "Axis", values: Floats) -> None:
    """Label a logarithmic axis with plain numbers: powers of ten may not even occur on it."""
    from matplotlib.ticker import FuncFormatter, LogLocator, NullLocator

    digits = COARSE_TICKS if np.max(values) > 10.0 * np.min(values) else FINE_TICKS
    axis.set_major_locator(LogLocator(subs=digits))
    axis.set_major_formatter(FuncFormatter(lambda value, _position: f"{value:g}"))
    axis.set_minor_locator(NullLocator())


def _driven(segments: list[Segment]) -> list[Floats]:
    """Return the times of each segment's borders [s]; the segments follow one another without pause."""
    ends = np.cumsum([0.0, *(float(np.sum(segment.dt)) for segment in segments)])
    return [segment.border_times + begin for segment, begin in zip(segments, ends[:-1], strict=True)]


def _joined(pieces: list[Floats]) -> Floats:
    """Return the pieces as one array with a NaN behind each, at which a drawn line breaks."""
    return np.concatenate([np.append(piece, np.nan) for piece in pieces])

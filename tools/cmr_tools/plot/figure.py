"""Draw fields over time, or one against the other; several logs in the same panels."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cmr.recordings.thinning import broken_at_gaps, thinned, thinned_path
from cmr.report.colours import REAL_COLOUR, TWIN_COLOUR

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.lines import Line2D

Floats = NDArray[np.float64]
COLOURS = (REAL_COLOUR, TWIN_COLOUR, "#c0392b", "#2e8b57", "#7b4fb5", "#555555")
STYLES = ("-", "--", ":", "-.")
WIDTH, PANEL_HEIGHT, PATH_HEIGHT = 9.0, 2.8, 6.5  # inches
FEW = 60  # values, each of which is marked
LONGEST_Y_LABEL = 34  # characters that fit beside a panel in one line


class Curve(NamedTuple):
    """A line: its label, its points, and the numbers of its log and of its field, which set its style."""

    label: str
    x: Floats
    y: Floats
    log: int
    field: int


class Panel(NamedTuple):
    """Curves that share their axes. If these are lengths, both have the same scale."""

    x_label: str
    y_label: str
    curves: list[Curve]
    over_time: bool
    same_scale: bool = False


def figure_of(panels: Sequence[Panel], title: str, logs: int) -> "Figure":
    """Return a figure with one panel below the other; panels over time share their time axis."""
    from matplotlib.figure import Figure  # slow to import

    heights = [PANEL_HEIGHT if panel.over_time else PATH_HEIGHT for panel in panels]
    figure = Figure(figsize=(WIDTH, sum(heights) + 0.8), dpi=110, layout="constrained")
    draw(figure, panels, title, logs)
    return figure


def draw(figure: "Figure", panels: Sequence[Panel], title: str, logs: int) -> None:
    """Draw the panels into a figure. With several logs colours distinguish the logs, else the fields.

    Points are reduced to the visible resolution; zooming in shows all of them.
    """
    heights = [PANEL_HEIGHT if panel.over_time else PATH_HEIGHT for panel in panels]
    grid = figure.add_gridspec(len(panels), 1, height_ratios=heights)
    first: Axes | None = None
    for place, panel in enumerate(panels):
        axes = figure.add_subplot(grid[place], sharex=first if panel.over_time else None)
        if panel.over_time:
            first = first or axes
        _draw(axes, panel, logs)
    figure.suptitle(title, fontsize=11)


def _draw(axes: "Axes", panel: Panel, logs: int) -> None:
    whole = []
    for curve in panel.curves:
        colour, style = (curve.log, curve.field) if logs > 1 else (curve.field, 0)
        x, y = broken_at_gaps(curve.x, curve.y) if panel.over_time else (curve.x, curve.y)
        [line] = axes.plot(
            *(thinned(x, y) if panel.over_time else thinned_path(x, y)),
            color=COLOURS[colour % len(COLOURS)],
            linestyle=STYLES[style % len(STYLES)],
            linewidth=1.3,
            marker="." if len(curve.x) <= FEW else "",
            label=curve.label,
        )
        whole.append((line, x, y))
    if panel.over_time:
        axes.callbacks.connect("xlim_changed", lambda _axes: _look_closely(axes, whole))
    axes.set_xlabel(panel.x_label)
    fits = len(panel.y_label) <= LONGEST_Y_LABEL
    axes.set_ylabel(panel.y_label if fits else panel.y_label.replace(".", "\n", 1))
    axes.grid(color="#dddddd", linewidth=0.6)
    axes.ticklabel_format(useOffset=False)
    if panel.same_scale:
        axes.set_aspect("equal", adjustable="datalim")
    if len(panel.curves) > 1:
        axes.legend(loc="best", fontsize=8, framealpha=0.8)


def _look_closely(axes: "Axes", whole: "Sequence[tuple[Line2D, Floats, Floats]]") -> None:
    """Draw the visible part of the time at the visible resolution."""
    begin, end = sorted(axes.get_xlim())
    for line, seconds, values in whole:
        # One more on each side, so that lines extend to the edge.
        first = max(int(np.searchsorted(seconds, begin)) - 1, 0)
        part = slice(first, int(np.searchsorted(seconds, end, side="right")) + 1)
        line.set_data(*thinned(seconds[part], values[part]))

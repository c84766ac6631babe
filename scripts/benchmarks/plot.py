"""The plot: what a step costs against the number of robots, ours and the peers'."""

from collections.abc import Sequence
from pathlib import Path

from matplotlib.figure import Figure

from benchmarks.report import Point
from cmr.colours import TWIN_COLOUR

OURS = "CMR"  # what the names of our own series begin with
STEP = 0.01  # s
MARKERS = "osDv^P"


def draw(points: Sequence[Point], path: Path) -> None:
    """Draw a line for each series: ours in blue, the peers' in grey; dotted, what takes as long as a step lasts."""
    figure = Figure(figsize=(7.0, 4.2), layout="constrained")
    axes = figure.subplots()
    names = list(dict.fromkeys(point.series for point in points))
    for number, name in enumerate(names):
        # What was measured by itself, too, counts as it was beside the peers, later.
        line = {point.robots: point.seconds for point in points if point.series == name}
        robots, seconds = zip(*sorted(line.items()), strict=True)
        colour = TWIN_COLOUR if name.startswith(OURS) else "0.45"
        axes.loglog(robots, [1e3 * each for each in seconds], color=colour, marker=MARKERS[number % len(MARKERS)])
        axes.annotate(
            name, (robots[-1], 1e3 * seconds[-1]), (6, -2), textcoords="offset points", va="top", color=colour
        )
    axes.axhline(1e3 * STEP, color="0.6", linestyle=":", linewidth=1.0)
    axes.annotate("real time on one core", (axes.get_xlim()[0], 1e3 * STEP), (4, 3), textcoords="offset points")
    axes.set_xlim(right=max(point.robots for point in points) * 12.0)
    axes.set_xlabel("robots")
    axes.set_ylabel("CPU time of a step of 10 ms [ms]")
    axes.grid(color="0.9")
    figure.savefig(path, dpi=150)

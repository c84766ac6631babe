"""Plot the CPU time of a step against the number of robots, for CMR and the peers."""

import math
from collections.abc import Sequence
from pathlib import Path

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from benchmarks.report import Point
from cmr.report.colours import TWIN_COLOUR

OURS = "CMR"  # prefix of the names of CMR's series
STEP = 0.01  # s
MARKERS = "osDv^P"
LINE_HEIGHT = 14.0  # points between names that would otherwise overlap


def draw(points: Sequence[Point], path: Path) -> None:
    """Draw a line for each series: CMR's in blue, the peers' in grey; a dotted line marks real time."""
    figure = Figure(figsize=(7.0, 4.2), layout="constrained")
    axes = figure.subplots()
    names = list(dict.fromkeys(point.series for point in points))
    ends: list[tuple[int, float, str, str]] = []
    for number, name in enumerate(names):
        # Of repeated measurements, the later one counts, which alternates with the peers.
        line = {point.robots: point.seconds for point in points if point.series == name}
        robots, seconds = zip(*sorted(line.items()), strict=True)
        colour = TWIN_COLOUR if name.startswith(OURS) else "0.45"
        axes.loglog(robots, [1e3 * each for each in seconds], color=colour, marker=MARKERS[number % len(MARKERS)])
        ends.append((robots[-1], 1e3 * seconds[-1], name, colour))
    axes.axhline(1e3 * STEP, color="0.6", linestyle=":", linewidth=1.0)
    axes.annotate("real time on one core", (axes.get_xlim()[0], 1e3 * STEP), (4, 3), textcoords="offset points")
    axes.set_xlim(right=max(point.robots for point in points) * 12.0)
    axes.set_xlabel("robots")
    axes.set_ylabel("CPU time of a step of 10 ms [ms]")
    axes.grid(color="0.9")
    figure.draw_without_rendering()  # computes the positions of the ends of the lines
    _name_ends(axes, ends)
    figure.savefig(path, dpi=150)


def _name_ends(axes: Axes, ends: Sequence[tuple[int, float, str, str]]) -> None:
    """Write the names, (robots, milliseconds, name, colour), beside the ends of the lines, one below the other."""
    lowest: dict[int, float] = {}
    for robots, milliseconds, name, colour in sorted(ends, key=lambda end: -end[1]):
        place = axes.transData.transform((robots, milliseconds))[1] * 72.0 / axes.figure.dpi
        height = min(place, lowest.get(robots, math.inf) - LINE_HEIGHT)
        lowest[robots] = height
        offset = (8, height - place)
        axes.annotate(name, (robots, milliseconds), offset, textcoords="offset points", va="center", color=colour)

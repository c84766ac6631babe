"""Plot a study: each experiment as a point, and below it the distance of each set from real teams."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from cmr.experiments.fidelity.findings import Finding
from cmr.experiments.fidelity.study import PREPARATIONS, REAL_A, REAL_B
from cmr.report.colours import REAL_COLOUR, TWIN_COLOUR

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

BESIDE = 0.25  # of a column's width, over which points are spread to be visible
LABELS = {REAL_A: "all real, A", REAL_B: "all real, B"}


def figure_of(findings: Sequence[Finding]) -> "Figure":
    """Return a figure with a column for each metric: values of all experiments above, distances below.

    Real teams are yellow, those with one real robot blue. The yellow band is the distance between real teams.
    """
    from matplotlib.figure import Figure  # slow to import

    figure = Figure(figsize=(max(4.2 * len(findings), 8.0), 8.5), dpi=100, layout="constrained")
    if not findings:
        figure.text(0.05, 0.5, "No metric is defined for this team.")
        return figure
    axes = figure.subplots(2, len(findings), squeeze=False)
    for column, finding in enumerate(findings):
        _draw_values(axes[0, column], finding)
        _draw_distances(axes[1, column], finding)
    axes[0, 0].set_ylabel("value in each experiment; line: mean")
    axes[1, 0].set_ylabel("Wasserstein distance to real teams A; bar: 95 %")
    handles, labels = axes[1, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower left", ncols=len(labels), fontsize=9, frameon=False)
    figure.suptitle("Does a team with one real robot stand for a team of real ones?", fontsize=15)
    return figure


def _draw_values(axes: "Axes", finding: Finding) -> None:
    names = [name for name in (REAL_A, REAL_B, *PREPARATIONS) if name in finding.values]
    random = np.random.default_rng(0)
    for place, name in enumerate(names):
        values = finding.values[name]
        beside = place + BESIDE * random.uniform(-1.0, 1.0, len(values))
        axes.plot(beside, values, "o", color=_colour(name), markersize=5, alpha=0.6, markeredgewidth=0.0)
        axes.hlines(np.mean(values), place - 0.4, place + 0.4, color="black", linewidth=1.6)
    axes.set_title(f"{finding.metric.replace('_', ' ')} [{finding.unit}]")
    _name_columns(axes, [LABELS.get(name, name) for name in names])


def _draw_distances(axes: "Axes", finding: Finding) -> None:
    floor = finding.floor
    axes.axhspan(
        floor.low, floor.high, color=REAL_COLOUR, alpha=0.2, linewidth=0.0, label="95 %, two sets of real teams"
    )
    axes.axhline(floor.value, color=REAL_COLOUR, linewidth=2.0, label="two sets of real teams")
    for place, one in enumerate(finding.distances.values()):
        axes.plot([place, place], [one.low, one.high], color=TWIN_COLOUR, linewidth=2.0)
        axes.plot(place, one.value, "o", color=TWIN_COLOUR, markersize=8)
    for place, name in enumerate(finding.distances):
        if name in finding.closings:
            axes.annotate(
                finding.closings[name].verdict.replace(" to close", "").replace(" the gap", ""),
                (place, 0.0),
                xytext=(0, 4),
                textcoords="offset points",
                ha="center",
                fontsize=8,
            )
    axes.set_ylim(bottom=0.0)
    axes.set_title(f"distance [{finding.unit}]")
    _name_columns(axes, list(finding.distances))


def _name_columns(axes: "Axes", names: Sequence[str]) -> None:
    axes.set_xticks(range(len(names)), names, rotation=30, ha="right")
    axes.set_xlim(-0.6, len(names) - 0.4)
    axes.grid(axis="y", alpha=0.3)


def _colour(name: str) -> str:
    return REAL_COLOUR if name in (REAL_A, REAL_B) else TWIN_COLOUR

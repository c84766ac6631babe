"""The rows of a sweep as a Parquet file and as a plot."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TypeAlias

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from cmr.experiments.sweep.settings import Value
from cmr.experiments.team.metrics import UNITS
from cmr.report.colours import REAL_COLOUR, TWIN_COLOUR

LONGEST_LABELS = 80  # characters of all labels together that fit side by side
SMALLEST_SPAN = 0.01  # smallest range of an axis, relative to the values, so that rounding differences are invisible
Row: TypeAlias = Mapping[str, Value]  # settings and results of a run by name
PAGE, WIDEST = 12.0, 60.0  # inches: of panels side by side, and of one with many combinations


def write_tables(
    rows: Sequence[Row], settings: Sequence[str], metrics: Sequence[str], out: Path, name: str
) -> list[str]:
    """Write runs.parquet and summary.png below `out`; return lines with the results and file names."""
    shown = [metric for metric in metrics if all(metric in row for row in rows)]
    table, picture = out / "runs.parquet", out / "summary.png"
    write_parquet(rows, table)
    draw_summary(rows, settings, shown, f"{name}: {len(rows)} runs", picture)
    return [*medians(rows, settings, shown), f"{table}: a row for each of {len(rows)} runs", f"{picture}: a picture"]


def write_parquet(rows: Sequence[Row], path: Path) -> None:
    """Write a row for each run; atomically. Settings of mixed types become text."""
    names = list(dict.fromkeys(name for row in rows for name in row))
    columns = {name: _column([row.get(name) for row in rows]) for name in names}
    temporary = path.with_name(f".{path.name}.part")
    pq.write_table(pa.table(columns), temporary)
    temporary.replace(path)


def _column(values: list[Value]) -> list[Value]:
    kinds = {type(value) for value in values if value is not None}
    return values if len(kinds) < 2 or kinds == {int, float} else [str(value) for value in values]


def draw_summary(rows: Sequence[Row], settings: Sequence[str], metrics: Sequence[str], title: str, path: Path) -> None:
    """Plot each metric: its distribution over the seeds, side by side for each combination."""
    groups: dict[str, list[Row]] = {}
    for row in rows:
        groups.setdefault("\n".join(f"{key} = {row[key]}" for key in settings) or "all seeds", []).append(row)
    shown = [name for name in metrics if any(np.isfinite(_measured(row, name)) for row in rows)]
    crowded = len(groups) * max(map(len, groups)) > LONGEST_LABELS
    width = float(np.clip((0.4 if crowded else 1.4) * len(groups) + 1.5, 3.6, WIDEST))
    across = max(1, min(len(shown), int(PAGE / width)))
    down = max(1, -(-len(shown) // across))
    figure = Figure(figsize=(across * width, down * (4.6 if crowded else 3.0) + 0.6), layout="constrained")
    figure.suptitle(
        f"{title}\nEach point is a run; beside them the median and the middle 90 % of the runs", fontsize=10
    )
    panels = list(figure.subplots(down, across, squeeze=False).flat)
    for axes, name in zip(panels, shown, strict=False):
        _draw_metric(axes, name, [[_measured(row, name) for row in members] for members in groups.values()])
        axes.set_xticks(range(len(groups)), list(groups), rotation=90 if crowded else 0, fontsize=8)
    for axes in panels[len(shown) :]:
        axes.set_visible(False)
    figure.savefig(path, dpi=120)


def _measured(row: Row, name: str) -> float:
    """Return a metric of a run. Raises TypeError if it is not a number."""
    value = row[name]
    if not isinstance(value, (int, float)):
        raise TypeError(f"{name} is {value!r}, no number")
    return float(value)


def _draw_metric(axes: Axes, name: str, groups: Sequence[Sequence[float]]) -> None:
    """Draw one metric: each run of each group as a point, and beside them the median and the middle 90 %."""
    finite = [values[np.isfinite(values)] for values in (np.array(group, dtype=float) for group in groups)]
    spread = [place + np.linspace(-0.25, 0.1, len(values)) for place, values in enumerate(finite)]
    axes.plot(np.concatenate(spread), np.concatenate(finite), ".", color=REAL_COLOUR, markersize=5)
    places = [place + 0.25 for place, values in enumerate(finite) if len(values)]
    bottom, middle, top = np.transpose([np.percentile(values, [5, 50, 95]) for values in finite if len(values)])
    axes.vlines(places, bottom, top, color=TWIN_COLOUR, linewidth=2)
    axes.plot(places, middle, "o", color=TWIN_COLOUR)
    axes.set_xlim(-0.6, len(groups) - 0.4)
    axes.set_title(f"{name.replace('_', ' ')} [{UNITS.get(name, '-')}]", fontsize=10)
    axes.ticklabel_format(axis="y", useOffset=False)
    low, high = axes.get_ylim()
    least = SMALLEST_SPAN * max(abs(low), abs(high))
    if high - low < least:
        axes.set_ylim((low + high - least) / 2.0, (low + high + least) / 2.0)
    axes.grid(axis="y", alpha=0.3)


def medians(rows: Sequence[Row], settings: Sequence[str], metrics: Sequence[str]) -> list[str]:
    """Return a line for each combination of settings: the median of each metric over the seeds, with its unit."""
    groups: dict[str, list[Row]] = {}
    for row in rows:
        groups.setdefault(repr([row[key] for key in settings]), []).append(row)  # a value may be a list
    return [_median_line({key: group[0][key] for key in settings}, group, metrics) for group in groups.values()]


def _median_line(values: Row, rows: Sequence[Row], metrics: Sequence[str]) -> str:
    numbers = {name: [value for row in rows if np.isfinite(value := _measured(row, name))] for name in metrics}
    written = [f"{name} {np.median(found):.4g} {UNITS.get(name, '')}" for name, found in numbers.items() if found]
    away = sum(row.get("waypoints_reached") is False for row in rows)
    if away and "time_to_goal" in metrics:
        written.append(f"waypoints not reached in {away}, whose time to goal is that of the run")
    where = ", ".join(f"{key}={value}" for key, value in values.items()) or "all seeds"
    return f"{where}: {', '.join(written) or 'nothing could be measured'} (median of {len(rows)} runs)"

"""Confusion matrices: hidden effect against the effect named first, as a table and as a picture."""

import csv
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.figure import Figure

from cmr.model.catalogue import CATALOGUE
from cmr.recordings.signal import Floats
from tests.hidden_effects.rows import Row

GROUPS = tuple(dict.fromkeys(effect.group for effect in CATALOGUE.values()))
NAMES = [effect.name for group in GROUPS for effect in CATALOGUE.values() if effect.group == group]
OTHER = ("no_effect", "unexplained", "bad_data", "error")  # if no effect was named
BLUES = LinearSegmentedColormap.from_list("share", ["white", "#1f4fd8"])


def confusion_matrix(rows: Sequence[Row]) -> Floats:
    """Count which effect was named first for each hidden effect; shape (len(NAMES), len(NAMES) + len(OTHER))."""
    columns = [*NAMES, *OTHER]
    counts = np.zeros((len(NAMES), len(columns)))
    for row in rows:
        first = row.names[0] if row.names else (row.verdict or "error")
        counts[NAMES.index(row.case.effects[0]), columns.index(first)] += 1.0
    return counts


def write_table(counts: Floats, path: Path) -> None:
    """Write the counts as CSV."""
    with path.open("w", newline="", encoding="utf-8") as stream:
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow(["hidden", *NAMES, *OTHER])
        for name, line in zip(NAMES, counts, strict=True):
            writer.writerow([name, *(int(count) for count in line)])


def read_table(path: Path) -> tuple[list[str], list[str], Floats]:
    """Read a table; return hidden effects, named effects, and counts. It may be older than the catalogue."""
    with path.open(newline="", encoding="utf-8") as stream:
        head, *rows = csv.reader(stream)
    return [row[0] for row in rows], head[1:], np.array([row[1:] for row in rows], float)


def write_picture(
    counts: Floats, title: str, path: Path, hidden: Sequence[str] = NAMES, named: Sequence[str] = (*NAMES, *OTHER)
) -> None:
    """Write a picture of the counts; the shade of a cell is its share of the logs with that hidden effect."""
    figure = Figure(figsize=(14.0, 13.0), dpi=110, layout="constrained")
    axes = figure.subplots()
    shares = counts / np.maximum(counts.sum(axis=1, keepdims=True), 1.0)
    axes.imshow(shares, cmap=BLUES, vmin=0.0, vmax=1.0, aspect="equal")
    for line, column in np.argwhere(counts > 0.0):
        colour = "white" if shares[line, column] > 0.5 else "black"
        axes.text(column, line, f"{counts[line, column]:.0f}", ha="center", va="center", fontsize=7, color=colour)
    _label(axes, hidden, named)
    axes.set_title(title)
    figure.savefig(path)


def _label(axes: Axes, hidden: Sequence[str], named: Sequence[str]) -> None:
    axes.set_xticks(range(len(named)), [name.replace("_", " ") for name in named], rotation=90, fontsize=8)
    axes.set_yticks(range(len(hidden)), [name.replace("_", " ") for name in hidden], fontsize=8)
    axes.set_xlabel("named first")
    axes.set_ylabel("hidden in the log")
    axes.set_xticks(np.arange(len(named) + 1) - 0.5, minor=True)
    axes.set_yticks(np.arange(len(hidden) + 1) - 0.5, minor=True)
    axes.grid(which="minor", color="#e4e4e4", linewidth=0.5)
    axes.tick_params(which="both", length=0)
    ends = np.cumsum([sum(CATALOGUE[name].group == group for name in hidden) for group in GROUPS]) - 0.5
    for end in ends:
        axes.axvline(end, color="black", linewidth=0.9)
        axes.axhline(end, color="black", linewidth=0.9)
    for group, end, begin in zip(GROUPS, ends, [-0.5, *ends[:-1]], strict=True):
        axes.text(len(named) - 0.2, (begin + end) / 2.0, group, rotation=270, va="center", ha="left", fontsize=9)

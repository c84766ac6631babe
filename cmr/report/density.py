"""Density of many paths: how many robots passed each cell of a grid, in a drawing of bounded size."""

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from cmr.report.keys import area_key
from cmr.report.markup import Html, tag
from cmr.report.style import DENSITY, DENSITY_STEPS
from cmr.report.svg import Floats, Frame

# More lines would hide one another on a map of this size, and each takes some 10 kB.
MOST_LINES = 40
# Length of a cell in units of the plot, of which a map has some 500 across. A map as high as it may be then has 35,000
# cells and takes 350 kB at most, whatever the number of robots is; a thousand lines would take 2 MB and more.
CELL = 3.0


def density(frame: Frame, paths: Iterable[tuple[Floats, Floats]]) -> Html:
    """Draw the cells that paths pass, given as x and y of shape (n,), coloured by their number.

    Each colour is one element, whose title says the number: a browser shows it at the pointer.
    """
    counts = passes(frame, paths)
    return tag(
        "g",
        *(_level(counts, step) for step in range(len(DENSITY_STEPS))),
        transform=f"scale({CELL:g}) translate(0 .5)",
        stroke_width=1,
        shape_rendering="crispEdges",
    )


def passes(frame: Frame, paths: Iterable[tuple[Floats, Floats]]) -> NDArray[np.int64]:
    """Return how many paths pass each cell, shape (rows, columns) from the top left; a path counts once in a cell."""
    shape = (int(np.ceil(frame.inner_height / CELL)), int(np.ceil(frame.inner_width / CELL)))
    counts = np.zeros(shape, np.int64)
    for x, y in paths:
        column, row = _cells(frame.across(x) / CELL, frame.down(y) / CELL)
        inside = (column >= 0) & (column < shape[1]) & (row >= 0) & (row < shape[0])
        counts.flat[np.unique(row[inside] * shape[1] + column[inside])] += 1
    return counts


def density_keys() -> list[Html]:
    """Return legend entries for the colours."""
    return [area_key(f"{_number(step)} robots", colour) for step, colour in enumerate(DENSITY)]


def _cells(across: Floats, down: Floats) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the columns and rows of the cells that a path passes: points on it no farther apart than half a cell."""
    length = np.concatenate([[0.0], np.cumsum(np.hypot(np.diff(across), np.diff(down)))])
    along = np.union1d(length, np.arange(0.0, length[-1], 0.5))
    column, row = (np.interp(along, length, places) for places in (across, down))
    return np.floor(column).astype(np.int64), np.floor(row).astype(np.int64)


def _level(counts: NDArray[np.int64], step: int) -> Html:
    """Return the cells of one colour, drawn as horizontal strokes, one per run of adjacent cells."""
    ends = (*DENSITY_STEPS, np.iinfo(np.int64).max)
    here = (counts >= ends[step]) & (counts < ends[step + 1])
    edges = np.diff(np.pad(here, ((0, 0), (1, 1))).astype(np.int8), axis=1)
    rows, begins = np.nonzero(edges == 1)
    lengths = np.nonzero(edges == -1)[1] - begins
    strokes = "".join(f"M{x} {y}h{n}" for x, y, n in zip(begins, rows, lengths, strict=True))
    return tag("path", tag("title", f"{_number(step)} robots passed here"), d=strokes, stroke=DENSITY[step])


def _number(step: int) -> str:
    """Return the range of robots for a colour."""
    if step + 1 == len(DENSITY_STEPS):
        return f"{DENSITY_STEPS[step]} or more"
    first, last = DENSITY_STEPS[step], DENSITY_STEPS[step + 1] - 1
    return f"{first} or {last}" if last == first + 1 else f"{first} to {last}"

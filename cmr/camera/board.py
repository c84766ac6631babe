"""Printable PDFs in true size: the calibration board, and tags for floor and robots."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import cv2
import numpy as np
from numpy.typing import NDArray

from cmr.camera.paper import PAPERS
from cmr.camera.tags import FAMILY

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    Save = Callable[[Figure], None]

COLUMNS, ROWS = 7, 5  # squares of the board
CELLS_OF_SQUARE, CELLS_OF_MARKER = 9, 7  # so that squares and markers are made of the same cells
CELL = 0.004  # m
SQUARE = CELLS_OF_SQUARE * CELL  # m
BOARD_FAMILY = cv2.aruco.DICT_5X5_100  # none of the robots'
INCH = 0.0254  # m
TAG_CELLS = 8  # with the black border
QUIET_CELLS = 1  # of white around a tag, at least


class BoardError(Exception):
    """Something cannot be printed; the text says why."""


def board() -> "cv2.aruco.CharucoBoard":
    """Return the board that `save_board` prints, measured in m."""
    dictionary = cv2.aruco.getPredefinedDictionary(BOARD_FAMILY)
    return cv2.aruco.CharucoBoard((COLUMNS, ROWS), SQUARE, CELLS_OF_MARKER * CELL, dictionary)


def board_cells() -> NDArray[np.uint8]:
    """Return the board as one pixel a cell, 0 black and 255 white."""
    pixels = board().generateImage((COLUMNS * CELLS_OF_SQUARE, ROWS * CELLS_OF_SQUARE), marginSize=0, borderBits=1)
    return np.asarray(pixels, np.uint8)


def tag_cells(number: int) -> NDArray[np.uint8]:
    """Return a tag of 36h11 as one pixel a cell, 0 black and 255 white."""
    dictionary = cv2.aruco.getPredefinedDictionary(FAMILY)
    return np.asarray(cv2.aruco.generateImageMarker(dictionary, number, TAG_CELLS, borderBits=1), np.uint8)


def save_board(path: Path, paper: str = "a4") -> None:
    """Write the board as a PDF of one page. Raises OSError."""
    text = (
        f"cmr-camera calibrate · print at 100 %: a square is {1000.0 * SQUARE:.0f} mm wide (measure it) · "
        "glue it onto something flat"
    )
    with _pages(path) as save:
        _page(save, PAPERS[paper], board_cells(), CELL, text)


def save_tags(path: Path, numbers: Sequence[int], size: float, paper: str = "a4") -> None:
    """Write tags as a PDF, one a page; `size` [m] is the edge of the black square. Raises BoardError, OSError."""
    wide, high = PAPERS[paper]
    cell = size / TAG_CELLS
    most = (high - 0.005) * TAG_CELLS / (TAG_CELLS + 2 * QUIET_CELLS)
    if size > most + 1e-9:
        raise BoardError(f"A tag of {size:g} m does not fit {paper} with white around it: {most:.3f} m at most.")
    with _pages(path) as save:
        for number in numbers:
            # Upright as the tag is, so that its top edge is known.
            text = f"36h11, tag {number}\n\nblack square {1000.0 * size:.0f} mm\n(measure it)\n\n↑ top: ahead"
            _page(save, (wide, high), tag_cells(number), cell, text, upright=True)


@contextmanager
def _pages(path: Path) -> Iterator["Save"]:
    """Open a PDF; yields a function that appends a figure as a page."""
    from matplotlib.backends.backend_pdf import PdfPages  # takes half a second, and only printing needs it

    path.parent.mkdir(parents=True, exist_ok=True)
    with PdfPages(path) as pages:
        yield pages.savefig


def _page(
    save: "Save",
    paper: tuple[float, float],
    cells: NDArray[np.uint8],
    cell: float,
    text: str,
    *,
    upright: bool = False,
) -> None:
    """Add a page with rows of square cells in its middle, and text at the left, `upright` or a line along the edge."""
    from matplotlib.figure import Figure

    wide, high = paper
    rows, columns = cells.shape
    figure = Figure(figsize=(wide / INCH, high / INCH))
    axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    axes.set_axis_off()
    axes.set_xlim(0.0, wide)
    axes.set_ylim(0.0, high)
    left, top = (wide - columns * cell) / 2.0, (high + rows * cell) / 2.0
    for row, column in np.argwhere(cells == 0):  # vector graphics, so that printers keep the edges sharp
        x, y = left + column * cell, top - (row + 1) * cell
        axes.fill(
            [x, x + cell, x + cell, x], [y, y, y + cell, y + cell], color="black", linewidth=0.0, antialiased=False
        )
    place, turn = ((left - QUIET_CELLS * cell) / 2.0, 0.0) if upright else (left / 2.0, 90.0)
    axes.text(place, high / 2.0, text, rotation=turn, ha="center", va="center", fontsize=8)
    save(figure)

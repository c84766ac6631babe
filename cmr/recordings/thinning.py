"""Reduce curves to fewer points that look the same, by keeping minima and maxima."""

from array import array
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
PIECES = 3000  # of a curve over time, drawn by their minima and maxima: more than the pixels of a plot
CELLS = 3000  # of the extent of a path in x and y: also more than its pixels
GAP = 10.0  # times the usual interval: no line is drawn across a longer one
SHORTEST_GAP = 0.5  # s
ROWS_AT_ONCE = 50_000  # rows thinned together while a log is read


def extremes(values: Floats, size: int) -> Integers:
    """Return which values to keep: the minimum and maximum of each `size`; NaN if there is nothing else.

    A remainder at the end is kept completely.
    """
    is_nan = np.isnan(values)
    whole = len(values) // size * size
    pieces = (whole // size, size)
    lowest = np.where(is_nan, np.inf, values)[:whole].reshape(pieces).argmin(axis=1)
    highest = np.where(is_nan, -np.inf, values)[:whole].reshape(pieces).argmax(axis=1)
    starts = np.arange(0, whole, size)
    return np.unique(np.concatenate([starts + lowest, starts + highest, np.arange(whole, len(values))]))


def thinned(seconds: Floats, values: Floats, pieces: int = PIECES) -> tuple[Floats, Floats]:
    """Return a curve over time that looks the same in a picture of so many pixels, with the same gaps."""
    size = len(values) // pieces
    if size < 4:
        return seconds, values
    is_nan = np.isnan(values)
    breaks = np.flatnonzero(is_nan[1:] != is_nan[:-1])
    kept = np.unique(np.concatenate([[0], extremes(values, size), breaks, breaks + 1]))
    return seconds[kept], values[kept]


def broken_at_gaps(seconds: Floats, values: Floats) -> tuple[Floats, Floats]:
    """Insert a NaN at the end of each gap of a curve."""
    if len(seconds) < 3:
        return seconds, values
    steps = np.diff(seconds)
    gaps = np.flatnonzero(steps > max(GAP * float(np.median(steps)), SHORTEST_GAP)) + 1
    return np.insert(seconds, gaps, seconds[gaps]), np.insert(values, gaps, np.nan)


def thinned_path(x: Floats, y: Floats) -> tuple[Floats, Floats]:
    """Return a path that looks the same: within a pixel, only its entry and exit are kept."""
    cells = np.stack([_cells(x), _cells(y)])
    moves = np.flatnonzero((cells[:, 1:] != cells[:, :-1]).any(axis=0))
    kept = np.unique(np.concatenate([[0], moves, moves + 1, [len(x) - 1]])) if len(x) else moves
    return x[kept], y[kept]


def _cells(values: Floats) -> Integers:
    """Return the cell of each value within their extent; -1 for NaN."""
    is_number = np.isfinite(values)
    if not is_number.any():
        return np.full(len(values), -1)
    lowest, highest = values[is_number].min(), values[is_number].max()
    size = (highest - lowest) / CELLS or 1.0
    return np.where(is_number, (np.where(is_number, values, lowest) - lowest) / size, -1.0).astype(np.int64)


class Rows:
    """Values of some fields [unit] at their times [us], reduced to at most `most` rows.

    Additional rows are thinned as they arrive; the minimum and maximum of each field in each piece are kept.
    """

    def __init__(self, fields: int, most: int) -> None:
        self._fields, self._most = fields, most
        self._size = 1  # rows of a piece
        self._new_times, self._new_values = array("q"), array("d")
        self._times: Integers = np.empty(0, np.int64)
        self._values: Floats = np.empty((0, fields))

    def add(self, utime: int, values: Sequence[float]) -> None:
        """Take a row."""
        self._new_times.append(utime)
        self._new_values.extend(values)
        if len(self._new_times) >= ROWS_AT_ONCE:
            self._settle()

    def all(self) -> tuple[Integers, Floats]:
        """Return the times (n,) and the values (n, fields), in order of arrival."""
        self._settle()
        return self._times, self._values

    def _settle(self) -> None:
        """Merge new rows into the rest."""
        new = np.array(self._new_times, np.int64), np.array(self._new_values).reshape(-1, self._fields)
        self._new_times, self._new_values = array("q"), array("d")
        times, values = _thinned_rows(*new, self._size)
        self._times, self._values = np.concatenate([self._times, times]), np.concatenate([self._values, values])
        while len(self._times) > self._most:
            two_pieces = 4 * self._fields  # rows, as each field keeps two of a piece
            self._size = max(2 * self._size, two_pieces)
            self._times, self._values = _thinned_rows(self._times, self._values, two_pieces)


def _thinned_rows(times: Integers, values: Floats, size: int) -> tuple[Integers, Floats]:
    if size < 2 or not len(times):
        return times, values
    kept = np.unique(np.concatenate([extremes(column, size) for column in values.T]))
    return times[kept], values[kept]

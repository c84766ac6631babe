"""The values of a mapped signal at the rows of the message that it goes into, which may be of another table."""

from collections.abc import Collection
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cmr_tools.importing.layout import Column
from cmr_tools.importing.mapping_types import Signal
from cmr_tools.importing.sources import Table

AGAIN = 50_000  # us after which a command in force is repeated; CMR's robots discard it after 500 ms
MOST_AGAIN = 20_000_000  # messages, eleven days of them; more are due to a damaged time


class SamplingError(Exception):
    """The recording's times contradict the mapping; the text says why."""


@dataclass(frozen=True)
class Again:
    """Times at which values in force are repeated, `utime` [us], and the row of each; both of shape (n,)."""

    rows: NDArray[np.int64]
    utime: NDArray[np.int64]


def recorded(signal: Signal, table: Table, own: Table, period: float | None = None) -> Column:
    """Return the recorded values of a signal in table `own` at the rows of `table`; NaN where there are none.

    Between its rows a signal is interpolated, or held. A signal that wraps around at `period` is unwrapped. No value is
    carried from one piece to the next.
    """
    values = _heading(*(own.columns[name] for name in signal.columns)) if len(signal.columns) > 1 else None
    values = own.columns[signal.columns[0]] if values is None else values
    if own is table and not signal.holds:
        return values
    known = np.isfinite(values)
    values, times, pieces = values[known], own.utime[known], own.segment[known]
    if not len(values):
        return np.full(len(table.utime), np.nan)
    before = np.searchsorted(times, table.utime, side="right") - 1
    begun = (before >= 0) & (pieces[before] == table.segment)
    if signal.holds:
        return np.where(begun, values[before], np.nan)
    after = np.minimum(before + 1, len(times) - 1)
    between = (times[before] == table.utime) | ((after > before) & (pieces[after] == table.segment))
    values = values if period is None else np.unwrap(values, period=period)
    return np.where(begun & between, np.interp(table.utime, times, values), np.nan)


def in_force_again(table: Table, tables: Collection[Table]) -> Again:
    """Repeat the values of each row of `table` until the next row of the piece, or the end of the recording.

    Raises SamplingError if there would be too many.
    """
    if not len(table.utime):
        return Again(np.empty(0, np.int64), table.utime)
    end = np.zeros(1 + max(int(one.segment.max(initial=0)) for one in tables), np.int64)
    for one in tables:
        np.maximum.at(end, one.segment, one.utime)
    until = end[table.segment] + 1
    continues = table.segment[1:] == table.segment[:-1]
    until[:-1][continues] = table.utime[1:][continues]
    counts = np.maximum(-((table.utime - until) // AGAIN), 1)
    if counts.sum() > MOST_AGAIN:
        longest = float((until - table.utime).max()) / 1e6
        raise SamplingError(f"motor_command: holds: a command would hold for {longest:.4g} s: a time is damaged")
    rows = np.repeat(np.arange(len(counts)), counts)
    number = np.arange(len(rows)) - np.repeat(np.cumsum(counts) - counts, counts)
    return Again(rows, table.utime[rows] + number * AGAIN)


def rows_of(table: Table, rows: NDArray[np.bool_] | NDArray[np.int64], utime: NDArray[np.int64] | None = None) -> Table:
    """Return these rows of a table, by a mask or by their numbers; at other times if `utime` [us] is given."""
    columns = {name: values[rows] for name, values in table.columns.items()}
    times = (table.utime[rows], table.received_utime[rows]) if utime is None else (utime, utime)
    return Table(*times, table.segment[rows], columns)


def _heading(w: Column, *others: Column) -> Column:
    """Return the heading [rad] of a quaternion, from its members w, z or w, x, y, z."""
    z = others[-1]
    if len(others) == 1:
        return np.asarray(np.arctan2(2 * w * z, w * w - z * z))
    x, y = others[:2]
    return np.asarray(np.arctan2(2 * (w * z + x * y), w * w + x * x - y * y - z * z))

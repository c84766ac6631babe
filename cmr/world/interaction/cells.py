"""A cell list: finds pairs of nearby points in linear time.

The plane is divided into square cells as large as the search radius, so that all points near a point are in its cell or
in one of the eight around it. Cells are numbered row by row where there are few; otherwise they are hashed into about
two bins per point, so their number does not depend on the extent of the points. Points of different cells may share a
bin; the distance test removes false pairs.
"""

from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from cmr.model.compiled import compiled, inlined

Floats = NDArray[np.float64]
Indices = NDArray[np.int32]
Codes = NDArray[np.uint64]
Bins: TypeAlias = tuple[Codes, Indices, Indices, np.uint64, Codes, np.int64]  # as `_binned` returns them

ALL_PAIRS = 50  # points up to which trying all pairs costs less
FEWEST_BITS = 6
MOST_CELLS = 8  # per point; with more, they are hashed
# A cell's bin is the leading bits of its column and row times these: fractions of 2^64 that fill the circle evenly
# (Roberts, The unreasonable effectiveness of quasirandom sequences, 2018). Cells at most two columns and rows apart
# differ by at least 0.06 of the circle, so the nine cells around a point have bins of their own, of 64 or more.
COLUMN = np.uint64(0xC13FA9A902A6328F)
ROW = np.uint64(0x91E10DA5C79E7B1D)
SLACK = 1.0 + 1e-6  # enlarges a cell's side, for rounding
MOST_COLUMNS = 2.0**26  # cells along a side of the world; their columns are then exact enough for SLACK
SMALLEST = 1e-300  # m; the side of a cell if all points coincide


@compiled("Tuple((i4[::1], i4[::1]))(f8[::1], f8[::1], f8)")
def close_pairs(x: Floats, y: Floats, reach: float) -> tuple[Indices, Indices]:
    """Return all pairs of points at most `reach` [m] apart, each once, as two arrays of indices."""
    n = len(x)
    room = 4 * n + 16
    first, second = np.empty(room, np.int32), np.empty(room, np.int32)
    if n <= ALL_PAIRS:
        found = _try_all(x, y, reach * reach, first, second)
        if found > room:
            first, second = np.empty(found, np.int32), np.empty(found, np.int32)
            _try_all(x, y, reach * reach, first, second)
        return first[:found], second[:found]
    code, begin, members, shift, ahead, span = _binned(x, y, reach)
    found = _try_around(x, y, reach * reach, code, begin, members, shift, ahead, span, first, second)
    if found > room:
        first, second = np.empty(found, np.int32), np.empty(found, np.int32)
        _try_around(x, y, reach * reach, code, begin, members, shift, ahead, span, first, second)
    return first[:found], second[:found]


@compiled("i8(f8[::1], f8[::1], f8, i4[::1], i4[::1])")
def _try_all(x: Floats, y: Floats, nearest: float, first: Indices, second: Indices) -> int:
    """Write pairs with a squared distance up to `nearest`, as many as fit; return their total number."""
    found = 0
    for i in range(len(x)):
        for j in range(i + 1, len(x)):
            dx, dy = x[j] - x[i], y[j] - y[i]
            if dx * dx + dy * dy <= nearest:
                if found < len(first):
                    first[found], second[found] = i, j
                found += 1
    return found


@compiled("i8(f8[::1], f8[::1], f8, u8[::1], i4[::1], i4[::1], u8, u8[::1], i8, i4[::1], i4[::1])")
def _try_around(x, y, nearest, code, begin, members, shift, ahead, span, first, second):  # type: ignore[no-untyped-def]
    """Do the same for binned points: test each against later points in its bin and points in four cells ahead.

    Pairs with the other four cells are found from those cells.
    """
    found = 0
    for place in range(len(x)):
        i = members[place]
        own, xi, yi = code[i], x[i], y[i]
        for cell in range(len(ahead)):
            b = np.int64((own + ahead[cell]) >> shift)
            start, end = (begin[b], begin[b + span]) if cell > 0 else (place + 1, begin[b + (span + 1) // 2])
            for k in range(start, end):
                j = members[k]
                dx, dy = x[j] - xi, y[j] - yi
                if dx * dx + dy * dy <= nearest:
                    if found < len(first):
                        first[found], second[found] = i, j
                    found += 1
    return found


@inlined
def _extent(x, y):  # type: ignore[no-untyped-def]
    """Return the smallest and the largest x, and the smallest and the largest y, of points [m]."""
    left, right, bottom, top = x[0], x[0], y[0], y[0]
    for i in range(len(x)):
        left, right, bottom, top = min(left, x[i]), max(right, x[i]), min(bottom, y[i]), max(top, y[i])
    return left, right, bottom, top


@inlined
def _sorted_by_bin(code, shift, bins):  # type: ignore[no-untyped-def]
    """Return where each bin begins (bins + 1,), and the points bin by bin (n,): a counting sort."""
    begin = np.zeros(bins + 1, np.int32)
    for i in range(len(code)):
        begin[np.int64(code[i] >> shift)] += 1
    total: int | np.integer = 0
    for b in range(bins):
        total += begin[b]
        begin[b] = total
    begin[bins] = len(code)
    members = np.empty(len(code), np.int32)
    for i in range(len(code) - 1, -1, -1):
        own = np.int64(code[i] >> shift)
        begin[own] -= 1
        members[begin[own]] = i
    return begin, members


@compiled("Tuple((u8[::1], i4[::1], i4[::1], u8, u8[::1], i8))(f8[::1], f8[::1], f8)")
def _binned(x: Floats, y: Floats, reach: float) -> Bins:
    """Sort points into bins.

    Returns each point's code (n,), where each bin begins (bins + 1,), the points bin by bin (n,), the shift that turns
    a code into its bin, the code offsets of the cells to search, beginning with a point's own, and the number of
    consecutive bins from each.
    """
    n = len(x)
    left, right, bottom, top = _extent(x, y)
    width, height = right - left, top - bottom
    per_side = 1.0 / max(reach * SLACK, width / MOST_COLUMNS, height / MOST_COLUMNS, SMALLEST)
    columns, rows = np.floor(width * per_side) + 3.0, np.floor(height * per_side) + 3.0
    hashed = columns * rows > MOST_CELLS * n
    bins = 2.0 * n if hashed else columns * rows
    bits = FEWEST_BITS
    while 2.0**bits < bins:
        bits += 1
    shift = np.uint64(64 - bits)
    column = COLUMN if hashed else np.uint64(1) << shift
    row = ROW if hashed else np.uint64(columns) << shift
    code = np.empty(n, np.uint64)
    for i in range(n):
        # A column and a row are left free all around, so that all searched cells exist.
        across, up = np.int64((x[i] - left) * per_side) + 1, np.int64((y[i] - bottom) * per_side) + 1
        code[i] = np.uint64(across) * column + np.uint64(up) * row
    begin, members = _sorted_by_bin(code, shift, 1 << bits)
    if hashed:
        ahead: Codes = np.array([np.uint64(0), column, row - column, row, row + column])
    else:
        ahead = np.array([np.uint64(0), row - column])
    return code, begin, members, shift, ahead, np.int64(1 if hashed else 3)


@compiled("Tuple((u8[::1], i4[::1], i4[::1], u8, u8[::1], i8))(f8[::1], f8[::1], f8)")
def binned_around(x: Floats, y: Floats, reach: float) -> Bins:
    """Sort points into bins, for searches within `reach` [m] of a point.

    Returns the same as `_binned`, but the codes of all nine cells: those in which the points near point i are begin
    at bin b = (code[i] + around[j]) >> shift for each j, and their points are members[begin[b] : begin[b + span]].
    """
    code, begin, members, shift, ahead, span = _binned(x, y, reach)
    none = np.zeros(1, np.uint64)
    if span == 1:
        return code, begin, members, shift, np.concatenate((ahead, none - ahead[1:])), span
    column = none + (np.uint64(1) << shift)
    return (
        code,
        begin,
        members,
        shift,
        np.concatenate((none - column, ahead[1:], none - ahead[1:] - column - column)),
        span,
    )

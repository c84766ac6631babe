"""Locate effects in time or space: all start times, or all discs, are tested at once.

The trace of an effect that acts always and everywhere is known. One that acts only after some time, or within a disc,
has the same trace there and none elsewhere, because traces in prediction errors last only a fraction of a second.
"""

from dataclasses import dataclass

import numpy as np

from cmr.recordings.signal import Floats, Mask

EDGE = 0.06  # of an effect's total trace; a change in the first or last part would be an outlier
CELL = 0.1  # m; resolution of places
RADII = (0.2, 0.3, 0.38, 0.46, 0.55)  # m; of the discs that are tested
MOST_CELLS = 1500  # with more, no place is searched for
FARTHEST = 1 << 31  # cells from the origin; exceeds any real number of them
LARGEST_PART = 0.6  # largest share of the trace within a place, if acting everywhere would explain as much
NOTHING = 1e-6  # white errors squared; a smaller trace has no effect


@dataclass(frozen=True)
class Local:
    """Where an effect explains most: its drop of the sum of squares, and its time or place, by kinds of parameters."""

    drop: float
    values: dict[str, float]
    inside: Mask


NOWHERE = Local(0.0, {}, np.zeros(0, np.bool_))


def best_moment(moves: Floats, rest: Floats, basis: Floats, time: Floats) -> Local:
    """Return the moment [s] from which on some moves (n, m) together explain most of `rest` (n,).

    `basis` (n, p), orthonormal, spans the model's own traces; `rest` is orthogonal to it. `time` (n,) is that of each.
    Traces are treated as orthogonal: their drops are added.
    """
    order = np.argsort(-time, kind="stable")
    since = time[order]
    drops, allowed = np.zeros(len(time)), np.ones(len(time), np.bool_)
    for move in moves.T:
        pulls, sizes = np.cumsum((move * rest)[order]), np.cumsum((move * move)[order])
        along = np.cumsum(basis[order] * move[order, None], axis=0)
        drops += _drops(pulls, sizes, along)
        allowed &= (sizes > EDGE * sizes[-1]) & (sizes < (1.0 - EDGE) * sizes[-1])
    best = int(np.argmax(np.where(allowed, drops, -1.0)))
    moment = float(since[best])
    return Local(float(drops[best]) if allowed.any() else 0.0, {"time": moment}, time >= moment)


def best_place(moves: Floats, rest: Floats, basis: Floats, places: Floats) -> Local:
    """Return the disc within which some moves (n, m) together explain most of `rest` (n,).

    `places` (n, 2) [m] are those of each. Traces are treated as orthogonal: their drops are added.
    """
    at = np.round(places / CELL).astype(np.int64)
    numbers = at[:, 0] * FARTHEST + at[:, 1]
    _, first, inverse = np.unique(numbers, return_index=True, return_inverse=True)
    cells = at[first]
    best = Local(0.0, {}, np.zeros(len(moves), np.bool_))
    if len(cells) > MOST_CELLS:
        return best
    sums = [_sums(move, rest, basis, inverse, len(cells)) for move in moves.T]
    centres = cells * CELL
    distance = np.hypot(*(centres[:, None] - centres[None]).transpose(2, 0, 1))
    for radius in RADII:
        near = (distance <= radius).astype(np.float64)
        drops = np.sum([_drops_within(one, near) for one in sums], axis=0)
        index = int(np.argmax(drops))
        if drops[index] > best.drop:
            inside = np.hypot(*(places - centres[index]).T) <= radius
            values = {"x": float(centres[index, 0]), "y": float(centres[index, 1]), "radius": radius}
            best = Local(float(drops[index]), values, inside)
    return best


def _sums(move: Floats, rest: Floats, basis: Floats, cell: np.typing.NDArray[np.int64], cells: int) -> Floats:
    """Return the pull, the size and the shares along the basis of a move in each cell, shape (2 + p, cells)."""
    columns = np.concatenate([[move * rest, move * move], basis.T * move])
    return np.stack([np.bincount(cell, column, cells) for column in columns])


def _drops_within(sums: Floats, near: Floats) -> Floats:
    """Return the drop of the squares by a move in discs about each cell; `near` (cells, discs) is 1 within."""
    within, everywhere = sums @ near, sums.sum(axis=1, keepdims=True)
    drops, of_all = (_drops(one[0], one[1], one[2:].T) for one in (within, everywhere))
    size, whole = within[1], everywhere[1]
    nearly_all = (size > (1.0 - EDGE) * whole) | ((size > LARGEST_PART * whole) & (drops <= of_all))
    return np.where(nearly_all, 0.0, drops)


def _drops(pulls: Floats, sizes: Floats, along: Floats) -> Floats:
    """Return the drop of the squares by moves of these pulls (m,), sizes (m,) and shares along the basis (m, p)."""
    free = sizes - np.sum(along**2, axis=1)
    return np.where(free > NOTHING + 1e-6 * sizes, pulls**2 / np.maximum(free, NOTHING), 0.0)

"""How well movements separate the remaining explanations: information between their predictions.

Let X_c (n, m) be the columns that candidate c adds: the white innovations of each effect at its usual size beyond those
of the best explanation. With the information F = X' X of all data so far,

    G = (F + X_c' X_c) with the directions of the robot's own parameters projected off
    S_ij = BELIEF (G_ii - G_iJ (G_JJ + 1/9)^-1 G_Ji),

the squared distance at which effect i is seen when effect j, in any size up to three usual ones, may stand in for it.
Effects with several columns (a slope, a wobble) stand in as a block.
"""

from collections.abc import Collection, Mapping
from dataclasses import dataclass

import numpy as np

from cmr.recordings.signal import Floats

BELIEF = 0.6  # of the information: errors are not quite white, and the model is not exact
STAND_IN = 1.0 / 9.0  # one over the squared size up to which a rival may stand in, in usual sizes
ENOUGH, ENOUGH_UNSEEN = 18.0, 26.0  # squared distance required, with evidence and without
RIDGE = 1e-9
LEAST_WEIGHT = 0.02  # of an explanation that is nearly excluded
FROM_NOTHING = 3.0  # weight of the separation from nothing


@dataclass(frozen=True)
class Columns:
    """Which columns of the information belong to what: `free` first ones to parameters, then `of` effects by name."""

    free: int
    of: Mapping[str, tuple[int, ...]]

    @property
    def names(self) -> tuple[str, ...]:
        """The effects, in order."""
        return tuple(self.of)


def projected(information: Floats, columns: Columns) -> Floats:
    """Return the information (..., m, m) with the directions of the parameters projected off."""
    held = [*range(columns.free)]
    block = information[..., held, :][..., :, held]
    scale = np.sqrt(np.maximum(np.diagonal(block, axis1=-2, axis2=-1), 1e-300))
    unit = block / (scale[..., :, None] * scale[..., None, :]) + RIDGE * np.eye(len(held))
    mixed = information[..., held, :] / scale[..., :, None]
    return np.asarray(information - np.swapaxes(mixed, -1, -2) @ np.linalg.solve(unit, mixed))


def own(information: Floats, columns: Columns) -> Floats:
    """Return how well each effect is seen against nothing, (..., e): the mean over its columns."""
    return BELIEF * _by_effect(np.diagonal(information, axis1=-2, axis2=-1), columns)


def against(information: Floats, pulls: Floats, columns: Columns, one_sided: Collection[str] = ()) -> Floats:
    """Return twice the logarithm of the odds of nothing against each effect at its usual size, (e,).

    With the remaining errors r and projected columns X, `information` is X' X and `pulls` is X' r, (m,). The effect
    would change the squares by X' X + 2 X' r, or, with the other sign, by X' X - 2 X' r; `one_sided` effects have no
    other sign. The result is the mean over its columns of the first, with the least of the second.
    """
    least = []
    for name in columns.names:
        own_pulls = pulls[list(columns.of[name])]
        least.append(2.0 * float(np.min(own_pulls if name in one_sided else -np.abs(own_pulls))))
    return own(information, columns) + BELIEF * np.array(least)


def separations(information: Floats, columns: Columns) -> Floats:
    """Return S_ij, shape (..., e, e), of projected information (..., m, m); its diagonal is that against nothing."""
    diagonal = np.diagonal(information, axis1=-2, axis2=-1)
    result = []
    for name in columns.names:
        block = list(columns.of[name])
        mixed = information[..., :, block]
        inner = information[..., block, :][..., :, block] + STAND_IN * np.eye(len(block))
        taken = np.sum(mixed * np.swapaxes(np.linalg.solve(inner, np.swapaxes(mixed, -1, -2)), -1, -2), axis=-1)
        result.append(diagonal - taken)
    seen = BELIEF * np.maximum(np.swapaxes(_by_effect(np.stack(result, axis=-2), columns), -1, -2), 0.0)
    against_nothing = own(information, columns)
    index = np.arange(len(columns.names))
    seen[..., index, index] = against_nothing
    return seen


def progress(gained: Floats, need: Floats, seconds: Floats) -> Floats:
    """Return by how much each candidate shortens the remaining drive until all effects have shown, (c,).

    With `gained` (c, e), the gain of each candidate for each effect in `seconds` (c,), the best of them leave the times
    T_e = need_e / max_c (gained_ce / seconds_c). Driving candidate c shortens T_e by its share of the best rate. Its
    worth is its change of sum T_e^2 / 2: the longest times count most. `need` (e,) is infinite if nothing is needed.
    """
    rates = np.maximum(gained, 0.0) / seconds[:, None]
    best = np.max(rates, axis=0)
    is_open = np.isfinite(need) & (best > 0.0)
    return np.asarray((rates[:, is_open] / best[is_open]) @ (need[is_open] / best[is_open]))


def _by_effect(values: Floats, columns: Columns) -> Floats:
    """Return the mean over each effect's columns, (..., e), of values (..., m)."""
    means = np.zeros((values.shape[-1], len(columns.names)))
    for number, name in enumerate(columns.names):
        means[list(columns.of[name]), number] = 1.0 / len(columns.of[name])
    return np.asarray(values @ means)


def scores(before: Floats, after: Floats, need: Floats, weights: Floats, seconds: Floats) -> Floats:
    """Return the worth of each candidate, (c,).

    `before` (e, e) are the separations so far and `after` (c, e, e) those with each candidate; `need` (e, e) is the
    remaining need of each pair, infinite if it needs nothing; `weights` (e,) are those of effects, `seconds` (c,) the
    durations.
    """
    gained = np.maximum(after - before, 0.0)
    share = 1.0 - np.exp(-2.0 * gained / np.maximum(need, 1.0))
    open_pairs = np.isfinite(need)
    emphasis = np.where(np.eye(len(weights), dtype=bool), FROM_NOTHING, 1.0) * open_pairs
    total = np.maximum(emphasis.sum(axis=1), 1e-9)
    of_effect = np.sum(share * emphasis, axis=-1) / total
    return np.asarray(of_effect @ weights / seconds)

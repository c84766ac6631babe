"""How precisely encoder readings give wheel angles."""

import numpy as np

from cmr.recordings.signal import Floats, Mask

FEW_COUNTS, SETTLING = 4.0, 3  # counts; a smaller step may be any
ROUNDING = 1.0  # counts by which a step may be off that both its ends were rounded
NO_STEP = 1e-9  # rad; what angles differ by from rounding alone


def tick_of(angles: Floats, counts: Floats) -> float:
    """Return what an encoder's count goes up by at once, in radians; where it was not recorded, the smallest step.

    `angles` [rad] and `counts` [ticks], shape (n,), are its readings. 0 where it never moves on.
    """
    turned, counted = np.diff(angles), np.diff(counts)
    moved = moved_on(turned) & (counted != 0.0) & np.isfinite(counted)
    if moved.any() and np.all(counted[moved] == np.round(counted[moved])):
        return float(np.median(np.abs(turned[moved] / counted[moved])) * _at_once(np.abs(counted[moved])))
    steps = np.abs(turned[moved_on(turned)])
    return float(np.min(steps)) if len(steps) else 0.0


def _at_once(counted: Floats) -> float:
    """Return how many counts an encoder goes on at once, where it has gone on by `counted` (n,) between readings.

    It need not be a whole number: a coarse disc whose angle is reported in finer counts goes on by 34 and 35 in turn.
    """
    whole = float(np.gcd.reduce(counted.astype(np.int64)))
    least = float(counted.min())
    if whole > 1.0 or least < FEW_COUNTS:
        return whole
    found = least
    for _ in range(SETTLING):
        ticks = np.round(counted / found)
        found = float(counted @ ticks / (ticks @ ticks))
    on_ticks = np.all(np.abs(counted - ticks * found) <= ROUNDING) and {1.0, 2.0} <= set(ticks.tolist())
    return found if on_ticks else whole


def moved_on(steps: Floats) -> Mask:
    """Tell at which readings an encoder has moved on since the one before, by their `steps` [rad]."""
    return np.abs(steps) > NO_STEP


def within_tick(steps: Floats, tick: float) -> tuple[Floats, Floats]:
    """Return how far beyond each reading its wheel stood [rad], and how wide the span is that it may stand in [rad].

    `steps` [rad], shape (n,), say how far each reading is from the one before, 0 for the first; `tick` [rad] is the
    size of a tick, which begins at the angle that is read.

    An encoder that has moved on has passed an edge of the tick since the reading before: a slow wheel has just come
    over the lower edge, or backwards over the upper one; one that passes many edges from reading to reading is, on
    average, in the middle. One that says again what it said may be anywhere in the tick.
    """
    moved, index = moved_on(steps), np.arange(len(steps))
    before = np.maximum.accumulate(np.where(moved, index, 0))
    since = index - np.concatenate([[0], before[:-1]])  # readings since the last edge
    width = np.where(moved, np.minimum(np.abs(steps) / np.maximum(since, 1), tick), tick)
    return np.where(moved & (steps < 0.0), tick - 0.5 * width, 0.5 * width), width

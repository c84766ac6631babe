"""The precision of wheel angles from encoder readings."""

import numpy as np

from cmr.recordings.signal import Floats, Mask

FEW_COUNTS, SETTLING = 4.0, 3  # counts; smaller steps may have any size
ROUNDING = 1.0  # counts of rounding error in a step, from both ends
NO_STEP = 1e-9  # rad; differences of angles due to rounding alone


def tick_of(angles: Floats, counts: Floats) -> float:
    """Return the angle of one encoder step [rad]; without counts, the smallest step.

    `angles` [rad] and `counts` [ticks], shape (n,), are its readings. 0 if it never moves.
    """
    turned, counted = np.diff(angles), np.diff(counts)
    moved = moved_on(turned) & (counted != 0.0) & np.isfinite(counted)
    if moved.any() and np.all(counted[moved] == np.round(counted[moved])):
        return float(np.median(np.abs(turned[moved] / counted[moved])) * _at_once(np.abs(counted[moved])))
    steps = np.abs(turned[moved_on(turned)])
    return float(np.min(steps)) if len(steps) else 0.0


def _at_once(counted: Floats) -> float:
    """Return the counts per encoder step, from its count differences `counted` (n,) between readings.

    It need not be an integer: a coarse disc reported in finer counts advances by 34 and 35 alternately.
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
    """Return at which readings an encoder has advanced, by its `steps` [rad]."""
    return np.abs(steps) > NO_STEP


def within_tick(steps: Floats, tick: float) -> tuple[Floats, Floats]:
    """Return the offset [rad] of the wheel from each reading, and the width [rad] of its possible range.

    `steps` [rad], shape (n,), are the differences from the previous reading, 0 for the first; `tick` [rad] is the size
    of a tick, which begins at the angle that is read.

    An encoder that has advanced has passed a tick edge since the previous reading: a slow wheel has just crossed the
    lower edge, or backwards the upper one; one that passes many edges per reading is on average in the middle. With a
    repeated reading the wheel may be anywhere in the tick.
    """
    moved, index = moved_on(steps), np.arange(len(steps))
    before = np.maximum.accumulate(np.where(moved, index, 0))
    since = index - np.concatenate([[0], before[:-1]])  # readings since the last edge
    width = np.where(moved, np.minimum(np.abs(steps) / np.maximum(since, 1), tick), tick)
    return np.where(moved & (steps < 0.0), tick - 0.5 * width, 0.5 * width), width

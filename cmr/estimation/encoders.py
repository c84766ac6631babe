"""Wheel angles from encoder readings, and how precisely the ticks give them."""

import numpy as np

from cmr.recordings.signal import SECONDS, Floats, Mask, Signal

SIDES = ("left", "right")
SAME_ANGLE, UNLIKE_ANGLE = 1e-3, 1.0  # relative differences of the angles by ticks and by speed
FEW_LOST = 0.1  # of the readings; where speeds and counts differ in more, speeds are no averages between messages
LONGEST = 3.0  # times the usual interval between readings; in a longer one the speed may have been any
MOST_ALIKE = 0.5  # of the readings that agree on the angle of a count: then it is that
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

    It need not be a whole number: a coarse disc whose angle is told in finer counts goes on by 34 and 35 in turn.
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

    `steps` [rad], shape (n,), tell how far each reading is from the one before, 0 for the first; `tick` [rad] is the
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


def wheel_angles(wheels: Signal) -> tuple[Floats, Floats]:
    """Return how far each side's wheels have turned [rad] at each time of `wheels`, from 0."""
    left, right = (_angle(wheels, side) for side in SIDES)
    return left, right


def _angle(wheels: Signal, side: str) -> Floats:
    """Return the angle [rad] of one side.

    Speeds are averages over the time since the previous message; where one was lost, their sum misses a part and the
    count of ticks does not. Speeds of the moment, or coarse ones, tell only in the mean what a count stands for; the
    count then tells the angle. One that goes otherwise than the speed, as when the driver was started anew, is not
    believed.
    """
    seconds = np.diff(wheels.utime, prepend=wheels.utime[:1]) * SECONDS
    turned = wheels[f"psi_{side}"] * seconds
    ticks = np.diff(wheels[f"ticks_{side}"], prepend=wheels[f"ticks_{side}"][:1])
    counted = (ticks != 0.0) & (turned != 0.0)
    if counted.any():
        by_ticks = ticks * float(np.median(turned[counted] / ticks[counted]))
        lost = np.abs(by_ticks - turned) > SAME_ANGLE * np.abs(turned)
        if np.mean(lost[counted]) > FEW_LOST:
            told = seconds < LONGEST * np.median(seconds)
            exact = bool(np.mean(lost[counted]) < MOST_ALIKE)
            return np.cumsum(_by_count(turned, ticks, by_ticks, told, exact=exact))
        believed = np.abs(by_ticks - turned) < UNLIKE_ANGLE * np.abs(turned)
        turned = np.where(counted & lost & believed, by_ticks, turned)
    return np.cumsum(turned)


def _by_count(turned: Floats, ticks: Floats, by_ticks: Floats, told: Mask, *, exact: bool) -> Floats:
    """Return by which angle a wheel turned between readings, (n,), from its count, where speeds are no averages.

    `turned` are the angles by the speeds, `ticks` the counts, `by_ticks` the angles that these stand for: nearly,
    unless they are `exact`. Of pauses, where speeds tell nothing, `told` (n,) is false.
    """
    most = UNLIKE_ANGLE * np.maximum(np.abs(turned), np.sqrt(np.mean(turned[told] ** 2)))
    kept = told & (np.abs(by_ticks - turned) < most)
    if kept.any() and not exact:
        by_ticks = ticks * np.sum(turned[kept] * np.sign(ticks[kept])) / np.sum(np.abs(ticks[kept]))
    return np.where(np.abs(by_ticks - turned) < most, by_ticks, turned)

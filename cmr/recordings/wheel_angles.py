"""How far wheels have turned, by their speeds and by what their encoders counted."""

import numpy as np

from cmr.recordings.signal import SECONDS, Floats, Mask, Signal

SIDES = ("left", "right")
SAME_ANGLE, UNLIKE_ANGLE = 1e-3, 1.0  # relative differences of the angles by ticks and by speed
LONGEST = 3.0  # times the usual interval between readings; in a longer one the speed may have been any
FEW_LOST = 0.1  # of the readings; where speeds and counts differ in more, speeds are no averages between messages
MOST_ALIKE = 0.5  # of the readings that agree on the angle of a count: then it is that


def wheel_angles(wheels: Signal) -> tuple[Floats, Floats]:
    """Return how far each side's wheels have turned [rad] at each time of `wheels`, from 0."""
    left, right = (_angle(wheels, side) for side in SIDES)
    return left, right


def speeds_are_averages(wheels: Signal) -> bool:
    """Tell whether the speeds of both sides are what was counted since the message before, over the time since then."""
    return all(_averages(*_by_speed_and_ticks(wheels, side)) for side in SIDES)


def _by_speed_and_ticks(wheels: Signal, side: str) -> tuple[Floats, Floats, Floats]:
    """Return by which angle [rad] a side turned since the message before, by its speed and by its ticks; the ticks."""
    seconds = np.diff(wheels.utime, prepend=wheels.utime[:1]) * SECONDS
    turned = wheels[f"psi_{side}"] * seconds
    ticks = np.diff(wheels[f"ticks_{side}"], prepend=wheels[f"ticks_{side}"][:1])
    counted = (ticks != 0.0) & (turned != 0.0)
    angle = float(np.median(turned[counted] / ticks[counted])) if counted.any() else 0.0
    return turned, ticks * angle, ticks


def _averages(turned: Floats, by_ticks: Floats, ticks: Floats) -> bool:
    """Tell whether angles by speed are those by ticks, but for a few messages before which one was lost."""
    counted = (ticks != 0.0) & (turned != 0.0)
    lost = np.abs(by_ticks - turned) > SAME_ANGLE * np.abs(turned)
    return bool(counted.any() and np.mean(lost[counted]) <= FEW_LOST)


def _angle(wheels: Signal, side: str) -> Floats:
    """Return the angle [rad] of one side.

    Speeds are averages over the time since the previous message; where one was lost, their sum misses a part and the
    count of ticks does not. Speeds of the moment, or coarse ones, tell only in the mean what a count stands for; the
    count then tells the angle. One that contradicts the speed, as after a restart of the driver, is not believed. In a
    gap the speed may have been any that the wheel has at other times.
    """
    turned, by_ticks, ticks = _by_speed_and_ticks(wheels, side)
    counted = (ticks != 0.0) & (turned != 0.0)
    if counted.any():
        lost = np.abs(by_ticks - turned) > SAME_ANGLE * np.abs(turned)
        if not _averages(turned, by_ticks, ticks):
            seconds = np.diff(wheels.utime, prepend=wheels.utime[:1]) * SECONDS
            close = seconds < LONGEST * np.median(seconds)
            exact = bool(np.mean(lost[counted]) < MOST_ALIKE)
            return np.cumsum(_by_count(turned, ticks, by_ticks, close, exact=exact))
        believed = np.abs(by_ticks - turned) < UNLIKE_ANGLE * np.abs(turned)
        seconds = np.diff(wheels.utime, prepend=wheels.utime[:1]) * SECONDS
        gap = seconds > LONGEST * np.median(seconds)
        fastest = np.max(np.abs(wheels[f"psi_{side}"]))
        believed |= gap & (np.abs(by_ticks) <= fastest * seconds)
        turned = np.where(counted & lost & believed, by_ticks, turned)
    return np.cumsum(turned)


def _by_count(turned: Floats, ticks: Floats, by_ticks: Floats, close: Mask, *, exact: bool) -> Floats:
    """Return by which angle a wheel turned between readings, (n,), from its count, where speeds are no averages.

    `turned` are the angles by the speeds, `ticks` the counts, `by_ticks` the angles that these stand for: nearly,
    unless they are `exact`. Of pauses, where speeds tell nothing, `close` (n,) is false.
    """
    # Counts and speeds in turn would count what coarse speeds tell too late twice: only a count that restarts is
    # not believed, which is farther off than the wheel ever turned between two readings.
    most = UNLIKE_ANGLE * np.maximum(np.abs(turned), np.max(np.abs(turned[close]), initial=0.0))
    kept = close & (ticks != 0.0) & (np.abs(by_ticks - turned) < most)
    if kept.any() and not exact:
        by_ticks = ticks * np.sum(turned[kept] * np.sign(ticks[kept])) / np.sum(np.abs(ticks[kept]))
    return np.where(np.abs(by_ticks - turned) < most, by_ticks, turned)

"""How far wheels have turned, by their speeds and by what their encoders counted."""

import numpy as np

from cmr.recordings.robust import spread
from cmr.recordings.signal import SECONDS, Floats, Mask, Signal

SIDES = ("left", "right")
SAME_ANGLE, UNLIKE_ANGLE = 1e-3, 1.0  # relative differences of the angles by ticks and by speed
LONGEST = 3.0  # times the usual interval between readings; in a longer one the speed may have been any
FEW_LOST = 0.1  # of the readings; where speeds and counts differ in more, speeds are no averages between messages
# A controller that counts over a part of the time between readings says speeds in steps: whole ticks of that part. The
# parts of an interval are a whole number, where logs keep each second or fifth reading, say.
MOST_DIVISIONS, WHOLE, MOST_WHOLE = 8, 0.1, 0.95  # of the least speed; from a whole number; of the speeds
BLOCKS, CERTAIN, MOST_OFF = 16, 4.0, 0.3  # of a drive; standard deviations; from a whole number of ticks
MOST_TICKS = 1e4  # that an encoder counts between two readings
ENOUGH = 10  # readings of the same count
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
            exact = _differing(np.abs(ticks[counted]), lost[counted]) < MOST_ALIKE
            step = 0.0 if exact else _step(np.abs(wheels[f"psi_{side}"])) * float(np.median(seconds))
            return np.cumsum(_by_count(turned, ticks, by_ticks, close, step, exact=exact))
        believed = np.abs(by_ticks - turned) < UNLIKE_ANGLE * np.abs(turned)
        seconds = np.diff(wheels.utime, prepend=wheels.utime[:1]) * SECONDS
        gap = seconds > LONGEST * np.median(seconds)
        fastest = np.max(np.abs(wheels[f"psi_{side}"]))
        believed |= gap & (np.abs(by_ticks) <= fastest * seconds)
        turned = np.where(counted & lost & believed, by_ticks, turned)
    return np.cumsum(turned)


def _differing(ticks: Floats, lost: Mask) -> float:
    """Return in how many of the readings (n,) speed and count differ, as a share; readings of one count soon suffice.

    Of a robot that drives steadily nearly all readings are the same, be they right or not.
    """
    _, place, readings = np.unique(ticks, return_inverse=True, return_counts=True)
    weight = np.minimum(readings, ENOUGH) / readings
    return float(np.sum(weight[place] * lost) / np.sum(weight[place]))


def _step(speeds: Floats) -> float:
    """Return the step in which speeds (n,), not negative, go up [rad/s]; 0 where they go by none."""
    speeds = speeds[speeds > 0.0]
    least = float(np.median(speeds[speeds <= 1.5 * speeds.min()]))
    speeds = speeds[speeds / MOST_TICKS < least]
    for division in range(1, MOST_DIVISIONS + 1):
        steps = speeds * division / least
        whole = np.round(steps)
        if np.mean(np.abs(steps - whole) < WHOLE) > MOST_WHOLE:
            return float(speeds @ whole / (whole @ whole))
    return 0.0


def _by_count(turned: Floats, ticks: Floats, by_ticks: Floats, close: Mask, step: float, *, exact: bool) -> Floats:
    """Return by which angle a wheel turned between readings, (n,), from its count, where speeds are no averages.

    `turned` are the angles by the speeds, `ticks` the counts, `by_ticks` the angles that these stand for: nearly,
    unless they are `exact`. Of pauses, where speeds tell nothing, `close` (n,) is false. The angles by the
    speeds go up by `step` [rad] at once, several ticks; 0 where that is not known.
    """
    # Counts and speeds in turn would count what coarse speeds tell too late twice: only a count that restarts is
    # not believed, which is farther off than the wheel ever turned between two readings.
    most = UNLIKE_ANGLE * np.maximum(np.abs(turned), np.max(np.abs(turned[close]), initial=0.0))
    kept = close & (ticks != 0.0) & (np.abs(by_ticks - turned) < most)
    if np.count_nonzero(kept) >= BLOCKS and not exact:
        by_ticks = ticks * _tick(turned[kept] * np.sign(ticks[kept]), np.abs(ticks[kept]), step)
    return np.where(np.abs(by_ticks - turned) < most, by_ticks, turned)


def _tick(turned: Floats, ticks: Floats, step: float) -> float:
    """Return the angle of a tick [rad], from angles by the speeds and counts, (n,) each.

    It is the mean, or what makes `step` a whole number of ticks, if the mean allows it: blocks of the drive show how
    uncertain that is.
    """
    tick = float(np.sum(turned) / np.sum(ticks))
    if not 0.0 < step < MOST_TICKS * tick:  # speeds of the other sign, or broken ones
        return tick
    blocks = [
        float(np.sum(t) / np.sum(c)) for t, c in zip(*(np.array_split(v, BLOCKS) for v in (turned, ticks)), strict=True)
    ]
    several, whole = step / tick, round(step / tick)
    doubt = several * spread(np.array(blocks) - tick) / tick / BLOCKS**0.5
    return step / whole if whole >= 2 and abs(several - whole) < min(CERTAIN * doubt, MOST_OFF) else tick

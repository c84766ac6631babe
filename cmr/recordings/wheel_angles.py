"""Wheel angles, from speeds and encoder counts."""

import numpy as np

from cmr.recordings.robust import spread
from cmr.recordings.signal import SECONDS, Floats, Mask, Signal

SIDES = ("left", "right")
SAME_ANGLE, UNLIKE_ANGLE = 1e-3, 1.0  # relative differences of the angles by ticks and by speed
LONGEST = 3.0  # times the usual interval between readings; the speed may vary arbitrarily in a longer one
FEW_LOST = 0.1  # of the readings; if speeds and counts differ in more, speeds are not averages between messages
# A controller that counts over a part of the interval between readings reports speeds in steps: whole ticks of that
# part. The interval has a whole number of parts, if logs keep each second or fifth reading, for example.
MOST_DIVISIONS, WHOLE, MOST_WHOLE = 8, 0.1, 0.95  # of the least speed; from a whole number; of the speeds
BLOCKS, CERTAIN, MOST_OFF = 16, 4.0, 0.3  # of a drive; standard deviations; from a whole number of ticks
MOST_TICKS = 1e4  # encoder ticks between two readings, at most
ENOUGH = 10  # readings with the same count
MOST_ALIKE = 0.5  # of the readings that agree on the angle of a count: it is then accepted


def wheel_angles(wheels: Signal) -> tuple[Floats, Floats]:
    """Return how far each side's wheels have turned [rad] at each time of `wheels`, from 0."""
    left, right = (_angle(wheels, side) for side in SIDES)
    return left, right


def speeds_are_averages(wheels: Signal) -> bool:
    """Return whether the speeds of both sides are the counts since the previous message, divided by the time."""
    return all(_averages(*_by_speed_and_ticks(wheels, side)) for side in SIDES)


def _by_speed_and_ticks(wheels: Signal, side: str) -> tuple[Floats, Floats, Floats]:
    """Return the rotation [rad] of a side since the previous message, by its speed and by its ticks, and the ticks."""
    seconds = np.diff(wheels.utime, prepend=wheels.utime[:1]) * SECONDS
    turned = wheels[f"psi_{side}"] * seconds
    ticks = np.diff(wheels[f"ticks_{side}"], prepend=wheels[f"ticks_{side}"][:1])
    counted = (ticks != 0.0) & (turned != 0.0)
    angle = float(np.median(turned[counted] / ticks[counted])) if counted.any() else 0.0
    return turned, ticks * angle, ticks


def _averages(turned: Floats, by_ticks: Floats, ticks: Floats) -> bool:
    """Return whether angles by speed equal those by ticks, except after lost messages."""
    counted = (ticks != 0.0) & (turned != 0.0)
    lost = np.abs(by_ticks - turned) > SAME_ANGLE * np.abs(turned)
    return bool(counted.any() and np.mean(lost[counted]) <= FEW_LOST)


def _angle(wheels: Signal, side: str) -> Floats:
    """Return the angle [rad] of one side.

    Speeds are averages since the previous message; if one was lost, their sum misses a part, but the count does not.
    Instantaneous or coarse speeds only determine the mean angle per count; the count then determines the angle. A count
    that contradicts the speed, as after a restart of the driver, is ignored. In a gap the speed may be any that the
    wheel has at other times.
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
    """Return the share of the readings (n,) in which speed and count differ; readings of one count suffice.

    For a robot in steady motion nearly all readings are the same, right or wrong.
    """
    _, place, readings = np.unique(ticks, return_inverse=True, return_counts=True)
    weight = np.minimum(readings, ENOUGH) / readings
    return float(np.sum(weight[place] * lost) / np.sum(weight[place]))


def _step(speeds: Floats) -> float:
    """Return the step size of speeds (n,), not negative [rad/s]; 0 if there is none."""
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
    """Return the wheel rotations between readings, (n,), from counts, if speeds are not averages.

    `turned` are the angles by the speeds, `ticks` the counts, `by_ticks` the angles that these stand for: nearly,
    unless they are `exact`. `close` (n,) is false in pauses, where speeds are not informative. The angles by the speeds
    have steps of `step` [rad], several ticks; 0 if unknown.
    """
    # Alternating between counts and speeds would count delayed motion twice: only a restarting count is ignored, which
    # is off by more than the wheel ever turned between two readings.
    most = UNLIKE_ANGLE * np.maximum(np.abs(turned), np.max(np.abs(turned[close]), initial=0.0))
    kept = close & (ticks != 0.0) & (np.abs(by_ticks - turned) < most)
    if np.count_nonzero(kept) >= BLOCKS and not exact:
        by_ticks = ticks * _tick(turned[kept] * np.sign(ticks[kept]), np.abs(ticks[kept]), step)
    return np.where(np.abs(by_ticks - turned) < most, by_ticks, turned)


def _tick(turned: Floats, ticks: Floats, step: float) -> float:
    """Return the angle of a tick [rad], from angles by the speeds and counts, (n,) each.

    It is the mean, or makes `step` a whole number of ticks if consistent with the mean, whose uncertainty is estimated
    from blocks of the drive.
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

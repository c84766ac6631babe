"""Find wheels that were read at even intervals but stamped unevenly, and even their stamps out.

Many bases count their encoders by a timer, and a busy computer stamps what arrives a few milliseconds late, now more,
now less. Speeds from such stamps are noisy, and noisy wheels make a gyro seem to read too little in turns (regression
dilution). The motion shows which stamps are true: a wheel that was read later has turned further. Where it has not, the
reading is as old as its neighbours say.
"""

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from cmr.recordings.recording import Recording
from cmr.recordings.signal import SECONDS, Floats, Mask, Signal, Times
from cmr.recordings.wheel_angles import speeds_are_averages, wheel_angles

LEAST = 0.05  # of the interval: a smaller standard deviation of the stamps does no harm
FEWEST = 50  # readings in a stretch without a pause
NEIGHBOURS = 51  # readings whose median stamp tells when the one in their middle was read
AROUND = 9  # intervals over which the speed of a wheel is averaged
HALF, SURELY = 0.5, 3.0  # share of the unevenness that is in the motion, and standard deviations of it
LONGEST = 1.5  # times the usual interval; in a longer one, readings are missing


@dataclass(frozen=True)
class EvenStamps:
    """When wheels were read, `utime` (n,) [us], which were stamped uneven by `jitter` [s], a standard deviation."""

    utime: Times
    jitter: float

    def of(self, recording: Recording) -> Recording:
        """Return the recording with these stamps. Speeds that are averages since the reading before go with them."""
        wheels = recording.wheels
        fields = dict(wheels.fields)
        if speeds_are_averages(wheels):
            before, now = np.diff(wheels.utime, prepend=0), np.diff(self.utime, prepend=0)
            before[:1] = now[:1] = 1
            fields |= {name: fields[name] * before / now for name in ("psi_left", "psi_right")}
        return replace(recording, wheels=replace(wheels, utime=self.utime, fields=fields))


def even_stamps(recording: Recording) -> EvenStamps | None:
    """Return when the wheels were read, where their stamps are more uneven than that; None where they are not.

    The driver of CMR stamps its readings when they are taken: they may be uneven, and are true.
    """
    wheels = recording.wheels
    if recording.driven_on_the_bus or len(wheels) < FEWEST:
        return None
    begins = recording.pieces.borders(wheels.utime)
    uneven = _unevenness(wheels, begins)
    jitter = float(np.std(uneven))
    if jitter < LEAST * _usual_interval(wheels, begins):
        return None
    share, std = _share_in_motion(wheels, begins, uneven)
    if share + SURELY * std > HALF:
        return None
    utime = wheels.utime - np.round((1.0 - np.clip(share, 0.0, 1.0)) * uneven / SECONDS).astype(np.int64)
    return EvenStamps(utime, jitter) if np.all(np.diff(utime) > 0) else None


def _usual_interval(wheels: Signal, begins: Mask) -> float:
    """Return the mean interval [s] of the readings, without pauses and where none is missing."""
    intervals = np.diff(wheels.utime)[~begins[1:]] * SECONDS
    return float(np.mean(intervals[intervals <= LONGEST * np.median(intervals)])) if len(intervals) else 0.0


def _unevenness(wheels: Signal, begins: Mask) -> Floats:
    """Return how much later [s] each reading is stamped than its neighbours say, shape (n,); 0 in short stretches.

    Beside readings at even intervals, stamps wander by the jitter, drift with the clock and step where readings are
    missing. A running median follows the drift and the steps, and passes over the jitter.
    """
    interval = _usual_interval(wheels, begins)
    result = np.zeros(len(wheels))
    borders = [0, *np.flatnonzero(begins).tolist(), len(wheels)]
    for first, last in pairwise(borders):
        if last - first >= FEWEST:
            late = (wheels.utime[first:last] - wheels.utime[first]) * SECONDS - interval * np.arange(last - first)
            result[first:last] = late - _running_median(late)
    return result


def _running_median(values: Floats) -> Floats:
    """Return the median of the NEIGHBOURS around each value, shape (n,); values are mirrored at the ends."""
    mirrored = np.pad(values, NEIGHBOURS // 2, mode="reflect")
    windows = np.lib.stride_tricks.sliding_window_view(mirrored, NEIGHBOURS)
    return np.asarray(np.median(windows, axis=1))


def _share_in_motion(wheels: Signal, begins: Mask, uneven: Floats) -> tuple[float, float]:
    """Return which share of the stamps' unevenness [s] is in the motion of the wheels, and its standard deviation.

    It is the slope of how much further than usual a wheel turned between two readings, against how much further it
    should have turned at its speed, had it been read when it was stamped: 1 for true stamps, 0 for even readings.
    """
    intervals = np.diff(wheels.utime) * SECONDS
    longer = np.diff(uneven)
    whole = ~begins[1:] & (intervals <= LONGEST * np.median(intervals)) & (uneven[1:] != 0.0) & (uneven[:-1] != 0.0)
    around = np.ones(AROUND)
    expected, found = [], []
    for angle in wheel_angles(wheels):
        turned = np.diff(angle)
        speed = np.convolve(turned, around, "same") / np.convolve(intervals, around, "same")
        expected.append((speed * longer)[whole])
        found.append((turned - speed * (intervals - longer))[whole])
    x, y = np.concatenate(expected), np.concatenate(found)
    squares = float(x @ x)
    if squares <= 0.0:
        return 1.0, np.inf
    share = float(x @ y) / squares
    return share, float(np.sqrt(np.mean((y - share * x) ** 2) / squares))

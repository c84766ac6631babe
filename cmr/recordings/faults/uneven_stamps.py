"""Find wheels and poses that were taken at even intervals but stamped unevenly, and even their stamps out.

Many bases count their encoders by a timer, and cameras take pictures by one, while a busy computer stamps what arrives
a few milliseconds late, now more, now less. Speeds from such stamps are noisy, and what is noisy seems to change less
than it does (regression dilution; W. A. Fuller, Measurement Error Models, 1987, section 1.1): a gyro seems to read too
little in turns, wheels seem to be too small. The motion shows which stamps are true: a wheel that was read later has
turned further. Where it has not, the reading is as old as its neighbours say.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from cmr.recordings.pieces import Numbers
from cmr.recordings.recording import Recording
from cmr.recordings.robust import running_median, spread
from cmr.recordings.signal import SECONDS, Floats, Signal, Times
from cmr.recordings.wheel_angles import speeds_are_averages, wheel_angles

WHEELS, POSES = "wheels", "poses"
LEAST = 0.05  # of the interval: a smaller standard deviation of the stamps does no harm
FEWEST = 50  # readings in a stretch without a pause
NEIGHBOURS = 25  # readings before, and as many after; their median stamp shows when the one between was taken
AROUND = 9  # intervals over which the speed of a wheel is averaged
HALF, SURELY = 0.5, 3.0  # share of the unevenness that is in the motion, and standard deviations of it
FARTHEST = 6.0  # standard deviations of what a robot came further than usual; more is a jump of the tracker
LONGEST = 1.5  # times the usual interval; in a longer one, readings are missing


@dataclass(frozen=True)
class EvenStamps:
    """When readings of a `signal` were taken, `utime` (n,) [us], and the deviation of their stamps, `jitter` [s]."""

    signal: str
    utime: Times
    jitter: float

    def of(self, recording: Recording) -> Recording:
        """Return the recording with these stamps. Speeds that are averages since the reading before go with them."""
        signal = recording.signals[self.signal]
        fields = dict(signal.fields)
        if self.signal == WHEELS and speeds_are_averages(signal):
            before, now = np.diff(signal.utime, prepend=0), np.diff(self.utime, prepend=0)
            before[:1] = now[:1] = 1
            fields |= {name: fields[name] * before / now for name in ("psi_left", "psi_right")}
        even = replace(signal, utime=self.utime, fields=fields)
        return replace(recording, wheels=even) if self.signal == WHEELS else replace(recording, poses=even)


def even_stamps(recording: Recording) -> list[EvenStamps]:
    """Return when wheels and poses were taken, of those whose stamps are more uneven than that.

    The driver of CMR stamps its readings when they are taken: they may be uneven, and are true.
    """
    wheels, poses = recording.wheels, recording.poses
    found = []
    if not recording.driven_on_the_bus:
        found.append(_even(recording, WHEELS, wheel_angles(wheels) if len(wheels) >= FEWEST else ()))
    found.append(_even(recording, POSES, (poses["x"], poses["y"])))
    return [one for one in found if one is not None]


def _even(recording: Recording, name: str, ways: Sequence[Floats]) -> EvenStamps | None:
    """Return when a signal was taken; `ways` (n,) each are how far something had come at each reading, in one unit."""
    signal = recording.signals[name]
    if len(signal) < FEWEST:
        return None
    piece = recording.pieces.number(signal.utime)
    intervals = np.diff(signal.utime)[np.diff(piece) == 0] * SECONDS
    usual = intervals[intervals <= LONGEST * np.median(intervals)] if len(intervals) else intervals
    if not len(usual) or np.std(usual) < LEAST * np.mean(usual):
        return None
    uneven = _unevenness(signal, piece, float(np.mean(usual)))
    jitter = float(np.std(uneven))
    share, std = _share_in_motion(signal, uneven, ways)
    if jitter < LEAST * np.mean(usual) or share + SURELY * std > HALF:
        return None
    utime = signal.utime - np.round((1.0 - np.clip(share, 0.0, 1.0)) * uneven / SECONDS).astype(np.int64)
    return EvenStamps(name, utime, jitter) if np.all(np.diff(utime) > 0) else None


def _unevenness(signal: Signal, piece: Numbers, interval: float) -> Floats:
    """Return how much later [s] each reading is stamped than its neighbours say, shape (n,); 0 in short pieces.

    Beside readings at even intervals, stamps wander by the jitter, drift with the clock and step where readings are
    missing. A running median follows the drift and the steps, and passes over the jitter.
    """
    begins, counts = np.unique(piece, return_index=True, return_counts=True)[1:]
    number = np.arange(len(signal)) - np.repeat(begins, counts)
    late = (signal.utime - np.repeat(signal.utime[begins], counts)) * SECONDS - interval * number
    uneven = late - running_median(late, NEIGHBOURS, piece)
    return np.where(np.repeat(counts, counts) >= FEWEST, uneven, 0.0)


def _share_in_motion(signal: Signal, uneven: Floats, ways: Sequence[Floats]) -> tuple[float, float]:
    """Return which share of the stamps' unevenness [s] is in the motion, and its standard deviation.

    It is the slope of how much further than usual a robot came between two readings, against how much further it should
    have come at its speed, had they been taken when they were stamped: 1 for true stamps, 0 for even readings.
    """
    intervals, longer = np.diff(signal.utime) * SECONDS, np.diff(uneven)
    whole = (intervals <= LONGEST * np.median(intervals)) & (uneven[1:] != 0.0) & (uneven[:-1] != 0.0)
    around = np.ones(AROUND)
    expected, found = [], []
    for way in ways:
        came = np.diff(way)
        speed = np.convolve(came, around, "same") / np.convolve(intervals, around, "same")
        expected.append((speed * longer)[whole])
        found.append((came - speed * (intervals - longer))[whole])
    x, y = np.concatenate(expected), np.concatenate(found)
    true = np.abs(y) <= FARTHEST * spread(y)  # trackers jump
    x, y = x[true], y[true]
    squares = float(x @ x)
    if squares <= 0.0:
        return 1.0, np.inf
    share = float(x @ y) / squares
    return share, float(np.sqrt(np.mean((y - share * x) ** 2) / squares))

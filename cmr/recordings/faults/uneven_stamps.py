"""Find signals that were sampled evenly but stamped unevenly, and smooth their stamps.

Many bases sample encoders by a timer, and cameras take pictures by one, while a busy computer stamps arrivals with a
variable delay of a few milliseconds. Speeds from such stamps are noisy, and noise in a regressor reduces its slope
(regression dilution; W. A. Fuller, Measurement Error Models, 1987, section 1.1): a gyro seems to read too little in
turns, wheels seem to be too small. The motion shows which stamps are true: a wheel that was read later has turned
further. If it has not, the reading's time is interpolated from its neighbours. What was stamped together with the
wheels, such as the columns of one row of a table, is assumed to be taken together with them.
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
OTHERS = ("commands", "gyro", POSES)  # signals that may share the stamps of the wheels,
TOGETHER = 0.9  # if at least this share of theirs do
LEAST = 0.05  # of the interval: a smaller standard deviation of stamps does no harm
FEWEST = 50  # readings in a stretch without a pause
NEIGHBOURS = 25  # readings before and after; their median stamp gives the time of the one between
AROUND = 9  # intervals over which the speed of a wheel is averaged
HALF, SURELY = 0.5, 3.0  # share of the unevenness found in the motion, and standard deviations of it
FARTHEST = 6.0  # standard deviations of excess motion; more is a jump of the tracker
LONGEST = 1.5  # times the usual interval; in a longer one, readings are missing


@dataclass(frozen=True)
class EvenStamps:
    """The corrected times `utime` (n,) [us] of readings of a `signal`, and the standard deviation of their stamps,
    `jitter` [s].
    """

    signal: str
    utime: Times
    jitter: float

    def of(self, recording: Recording) -> Recording:
        """Return the recording with these stamps. Speeds averaged since the previous reading are adjusted."""
        signal = recording.signals[self.signal]
        fields = dict(signal.fields)
        if self.signal == WHEELS and speeds_are_averages(signal):
            before, now = np.diff(signal.utime, prepend=0), np.diff(self.utime, prepend=0)
            before[:1] = now[:1] = 1
            fields |= {name: fields[name] * before / now for name in ("psi_left", "psi_right")}
        return recording.with_signals({self.signal: replace(signal, utime=self.utime, fields=fields)})


def even_stamps(recording: Recording) -> list[EvenStamps]:
    """Return corrected times of wheels and poses whose stamps are uneven although their sampling is not.

    They include those of signals that share the stamps of such wheels. CMR's driver stamps its readings when they are
    taken: those may be uneven, and are true.
    """
    wheels, poses = recording.wheels, recording.poses
    path = (poses["x"], poses["y"])
    of_poses = _even(recording, POSES, path)
    found = [of_poses]
    if not recording.driven_on_the_bus:
        of_wheels = _even(recording, WHEELS, wheel_angles(wheels) if len(wheels) >= FEWEST else ())
        others = OTHERS[:-1] if of_poses or _moves_as_stamped(recording, POSES, path) else OTHERS
        together = [_together(recording, name, of_wheels) for name in others] if of_wheels else []
        found = [of_wheels, *together, of_poses]
    return [one for one in found if one is not None]


def _moves_as_stamped(recording: Recording, name: str, ways: Sequence[Floats]) -> bool:
    """Return whether the motion shows that uneven stamps of a signal are true, such as those of interpolated poses."""
    signal = recording.signals[name]
    if len(signal) < FEWEST:
        return False
    piece = recording.pieces.number(signal.utime)
    uneven = _unevenness(signal, piece, float(np.median(np.diff(signal.utime))) * SECONDS)
    share, std = _share_in_motion(signal, uneven, ways)
    return share - SURELY * std > HALF


def _together(recording: Recording, name: str, wheels: EvenStamps) -> EvenStamps | None:
    """Return the corrected times of a signal that has the stamps of the wheels; None if it has others.

    It is taken to have been sampled together with them.
    """
    stamps, before = recording.signals[name].utime, recording.wheels.utime
    number = np.minimum(np.searchsorted(before, stamps), len(before) - 1)
    same = before[number] == stamps
    if not len(stamps) or np.mean(same) < TOGETHER:
        return None
    utime = np.where(same, wheels.utime[number], stamps)
    return EvenStamps(name, utime, wheels.jitter) if np.all(np.diff(utime) > 0) else None


def _even(recording: Recording, name: str, ways: Sequence[Floats]) -> EvenStamps | None:
    """Return the corrected times of a signal; `ways` (n,) each are travelled distances at each reading, in one unit."""
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
    """Return how much later [s] each reading is stamped than its neighbours imply, shape (n,); 0 in short pieces.

    Compared with evenly spaced times, stamps have jitter, drift with the clock, and step where readings are missing. A
    running median follows drift and steps, and ignores jitter.
    """
    begins, counts = np.unique(piece, return_index=True, return_counts=True)[1:]
    number = np.arange(len(signal)) - np.repeat(begins, counts)
    late = (signal.utime - np.repeat(signal.utime[begins], counts)) * SECONDS - interval * number
    uneven = late - running_median(late, NEIGHBOURS, piece)
    return np.where(np.repeat(counts, counts) >= FEWEST, uneven, 0.0)


def _share_in_motion(signal: Signal, uneven: Floats, ways: Sequence[Floats]) -> tuple[float, float]:
    """Return the share of the stamps' unevenness [s] that is found in the motion, and its standard deviation.

    It is the slope of the excess motion between two readings against the motion expected at the robot's speed if the
    stamps were true: 1 for true stamps, 0 for even sampling.
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

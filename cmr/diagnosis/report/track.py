"""The drawn points of a path, and the interval in which the models differ most."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cmr.diagnosis.report.binned import thinned
from cmr.diagnosis.result import Path
from cmr.recordings.signal import Floats, Mask

MOST_POINTS = 900  # of a drawn line
Indices = NDArray[np.int64]
Index = int | slice | Indices
LEAST_PARTING = 1e-3  # m; a tracker could not resolve a smaller difference of the models


class Poses(NamedTuple):
    """Positions [m] and headings [rad], shape (n,)."""

    x: Floats
    y: Floats
    theta: Floats

    @property
    def places(self) -> tuple[Floats, Floats]:
        """The positions alone."""
        return self.x, self.y

    def within(self, shown: slice) -> "Poses":
        """Return some of the poses."""
        return Poses(*(values[shown] for values in self))

    def distance(self, other: "Poses") -> Floats:
        """Return how far [m] the positions are from others, shape (n,)."""
        return np.asarray(np.hypot(self.x - other.x, self.y - other.y))

    def travelled(self, first: Index, last: Index) -> tuple[Floats, Floats]:
        """Return the displacement [m] ahead and to the left from some poses to others, given the indices of both."""
        x, y = self.x[last] - self.x[first], self.y[last] - self.y[first]
        cosine, sine = np.cos(self.theta[first]), np.sin(self.theta[first])
        return np.asarray(cosine * x + sine * y), np.asarray(cosine * y - sine * x)

    def begun_at(self, x: float, y: float, theta: float) -> "Poses":
        """Return the poses moved rigidly so that the first is at this position and heading."""
        ahead, left = self.travelled(0, slice(None))
        cosine, sine = math.cos(theta), math.sin(theta)
        return Poses(
            x + cosine * ahead - sine * left, y + sine * ahead + cosine * left, self.theta - self.theta[0] + theta
        )


class Track(NamedTuple):
    """The points of a path to draw, at `time` [s] since its beginning."""

    time: Floats
    real: Poses
    before: Poses
    after: Poses

    def begun_together(self, shown: slice) -> "Track":
        """Return an interval with both simulated robots started at the real pose."""
        real = self.real.within(shown)
        start = (float(real.x[0]), float(real.y[0]), float(real.theta[0]))
        simulated = (poses.within(shown).begun_at(*start) for poses in (self.before, self.after))
        return Track(self.time[shown], real, *simulated)


def track_of(path: Path) -> Track:
    """Return the points to draw, evenly spread. Gaps and restarts are kept."""
    real = Poses(path.x, path.y, path.theta)
    before = Poses(path.before_x, path.before_y, path.before_theta)
    after = Poses(path.after_x, path.after_y, path.after_theta)
    kept = np.flatnonzero(~np.isfinite(path.x) | _begun_anew(before, after))
    shown = np.union1d(thinned(len(path.x), MOST_POINTS), kept)
    return Track(path.time[shown] - path.time[:1], *(Poses(*(v[shown] for v in one)) for one in (real, before, after)))


def parting(track: Track, seconds: float) -> slice | None:
    """Return the interval of this length [s], or half the path, in which the two models diverge most; None if nowhere.

    Both start the interval at the same pose, so earlier errors do not count.
    """
    length = float(np.fmin(seconds, 0.5 * (track.time[-1] - track.time[0])))
    last = np.searchsorted(track.time, track.time + length, side="right") - 1
    first = np.flatnonzero((track.time[last] - track.time > 0.8 * length) & _unbroken(track, last))
    if not len(first):
        return None
    before, after = (poses.travelled(first, last[first]) for poses in (track.before, track.after))
    apart = np.hypot(before[0] - after[0], before[1] - after[1])
    most = int(np.argmax(apart))
    return slice(int(first[most]), int(last[first[most]]) + 1) if apart[most] > LEAST_PARTING else None


def _unbroken(track: Track, last: Indices) -> Mask:
    """Return the points from which the path is complete, without a restart, up to their `last` ones, shape (n,)."""
    known = np.all([np.isfinite(values) for poses in track[1:] for values in poses], axis=0)
    unknown = np.concatenate([[0], np.cumsum(~known)])  # count before each point
    begun = np.cumsum(_begun_anew(track.before, track.after))
    return np.asarray((unknown[last + 1] == unknown[:-1]) & (begun[last] == begun))


def _begun_anew(before: Poses, after: Poses) -> Mask:
    """Return where separated free runs coincide again, shape (n,): both restart at the real pose there."""
    apart = before.distance(after)
    return np.asarray((apart == 0.0) & (np.concatenate([apart[:1], apart[:-1]]) > 0.0))

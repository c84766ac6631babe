"""Paths for the report: pieces of the recordings, and free runs of both models from their starts.

A long drive is cut into pieces of LONGEST seconds, each started at the real pose: free-run errors accumulate, and after
a minute no longer show the difference of the models.
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import islice, pairwise, zip_longest

import numpy as np

from cmr.diagnosis.result import Path
from cmr.estimation.free_runs import Indices, Values, free_runs, stacked
from cmr.estimation.segments import Segment
from cmr.estimation.smoothing import smoothed_poses
from cmr.model.observer.observer import RESTART, Observations
from cmr.model.observer.structures import Innovations
from cmr.recordings.signal import Floats

LONGEST = 30.0  # s of a piece
MOST_PATHS = 4  # paths shown; more do not help a reader
MOST_POINTS = 900  # of a piece


def paths_of(segments: Sequence[Segment], before: Values, after: Values, labels: Sequence[str]) -> list[Path]:
    """Return the paths of all pieces of all recordings, and their free runs by two models.

    Segments without poses have none. `labels` are those of the recordings.
    """
    seen = [segment for segment in segments if len(segment.observations.pose)]
    observations = [segment.observations for segment in seen]
    smooth = smoothed_poses(observations, after)
    begins = [_begins(one) for one in observations]
    runs = free_runs(observations, begins, smooth, stacked((before, after)), [False] * len(seen)) if seen else []
    paths: dict[int, list[Path]] = {}
    for k, segment in enumerate(seen):
        own = paths.setdefault(segment.recording, [])
        own += _pieces(observations[k], begins[k], smooth[k], runs[k], labels[segment.recording])
    return [
        replace(path, piece=number, pieces=len(own))
        for own in paths.values()
        for number, path in enumerate(own, start=1)
    ]


def most_telling(paths: Sequence[Path]) -> tuple[Path, ...]:
    """Return the MOST_PATHS paths on which the models differ most; if equal, the longest paths.

    One path of each recording comes before second ones.
    """
    by_recording: dict[str, list[Path]] = {}
    for path in sorted(paths, key=_difference, reverse=True):
        by_recording.setdefault(path.label, []).append(path)
    rounds = zip_longest(*by_recording.values())
    return tuple(islice((path for one in rounds for path in one if path), MOST_PATHS))


def _difference(path: Path) -> tuple[float, float]:
    """Return the RMS distance [m] between the models, and the RMS extent [m] of the path."""
    between = (path.before_x - path.after_x) ** 2 + (path.before_y - path.after_y) ** 2
    way = (path.x - path.x[0]) ** 2 + (path.y - path.y[0]) ** 2
    return float(np.sqrt(np.mean(between))), float(np.sqrt(np.mean(way)))


def _begins(observations: Observations) -> Indices:
    """Return the numbers of the poses at which free runs restart."""
    restarts = np.flatnonzero(observations.pose_use == RESTART)
    return np.union1d(restarts, _borders(observations.pose_time)[:-1])


def _pieces(
    observations: Observations, begins: Indices, smooth: Floats, run: Innovations, label: str
) -> Iterator[Path]:
    """Yield the paths of the pieces of a segment; they are not counted yet."""
    borders = _borders(observations.pose_time)
    measured = np.column_stack([observations.pose[:, :2], np.unwrap(observations.pose[:, 2])])
    simulated = measured[:, :, None] - run.pose
    simulated[begins] = smooth[begins, :, None]
    for first, end in pairwise(borders):
        spread = np.linspace(first, end - 1, min(end - first, MOST_POINTS)).round().astype(np.int64)
        shown = np.union1d(spread, begins[(begins >= first) & (begins < end)])  # a report must include restarts
        yield _path(label, observations.pose_time[shown] + observations.time, measured[shown], simulated[shown])


def _borders(time: Floats) -> Indices:
    """Return the numbers of the first poses of pieces of equal length, and the number of all poses."""
    seconds = float(np.ptp(time))
    count = max(int(np.ceil(seconds / LONGEST)), 1)
    firsts = np.searchsorted(time, time[0] + seconds / count * np.arange(count))
    return np.append(np.unique(firsts), len(time))


def _path(label: str, time: Floats, measured: Floats, simulated: Floats) -> Path:
    """Return a path from poses (n, 3), measured and (n, 3, 2) simulated by both models."""
    return Path(
        label=label,
        time=time,
        x=measured[:, 0],
        y=measured[:, 1],
        theta=measured[:, 2],
        before_x=simulated[:, 0, 0],
        before_y=simulated[:, 1, 0],
        before_theta=simulated[:, 2, 0],
        after_x=simulated[:, 0, 1],
        after_y=simulated[:, 1, 1],
        after_theta=simulated[:, 2, 1],
    )

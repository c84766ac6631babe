"""Split the data into two folds: by kind of manoeuvre if there are two kinds.

An effect fitted on circles need not hold on squares. Recordings are of one kind if they spend similar shares of time
standing, driving straight, turning to either side and spinning; a single recording is split into alternating blocks.
"""

from collections.abc import Sequence

import numpy as np

from cmr.estimation.free_runs import BLOCK
from cmr.estimation.prediction import Predictor
from cmr.recordings.signal import Floats, Mask

WINDOW = 0.5  # s; window for classifying motion
STANDING = 0.05  # of the fastest wheel's speed
STRAIGHT, SPINNING = 0.15, 3.0  # the wheels' difference over their sum, below and above
SHARES = 5  # standing, straight, left, right, spinning
UNLIKE = 0.3  # share of time that two kinds of manoeuvre must spend differently
ROUNDS = 10  # iterations of two-means clustering


def two_parts(predictors: Sequence[Predictor], by_kind: bool = True) -> Mask:
    """Return the fold of each error, (n,), segment by segment and signal by signal.

    Several recordings are split by the kind of motion or, unless `by_kind`, alternately.
    """
    if len({predictor.segment.recording for predictor in predictors}) > 1:
        first = first_recordings(predictors, by_kind)
        return np.concatenate(
            [np.full(len(times), first[p.segment.recording]) for p in predictors for times in p.times.values()]
        )
    return np.concatenate(
        [
            np.floor((times + predictor.segment.observations.time) / BLOCK).astype(np.int64) % 2 == 0
            for predictor in predictors
            for times in predictor.times.values()
        ]
    )


def first_recordings(predictors: Sequence[Predictor], by_kind: bool = True) -> dict[int, bool]:
    """Return for each of several recordings whether it belongs to the first part; see `two_parts`."""
    recordings = sorted({predictor.segment.recording for predictor in predictors})
    if not by_kind:
        return {one: number % 2 == 0 for number, one in enumerate(recordings)}
    shares = np.array([_shares([p for p in predictors if p.segment.recording == one]) for one in recordings])
    return {one: bool(first) for one, first in zip(recordings, two_kinds(shares), strict=True)}


def two_kinds(shares: Floats) -> Mask:
    """Return the kind of each of n recordings, (n,), from its shares of time, (n, SHARES).

    If all are of one kind, they alternate. Two-means clustering starts from the two least similar recordings.
    """
    distance = 0.5 * np.abs(shares[:, None] - shares[None]).sum(axis=2)
    centres = shares[list(np.unravel_index(np.argmax(distance), distance.shape))]
    first = np.zeros(len(shares), np.bool_)
    for _ in range(ROUNDS):
        to_centres = np.abs(shares[:, None] - centres[None]).sum(axis=2)
        first = to_centres[:, 0] <= to_centres[:, 1]
        if first.all() or not first.any():
            break
        centres = np.stack([shares[first].mean(axis=0), shares[~first].mean(axis=0)])
    apart = 0.5 * np.abs(centres[0] - centres[1]).sum()
    if first.all() or not first.any() or apart < UNLIKE:
        return np.asarray(np.arange(len(shares)) % 2 == 0)
    return np.asarray(first)


def _shares(predictors: Sequence[Predictor]) -> Floats:
    """Return the shares of time that the robot stood, drove straight, turned left, turned right and spun, (SHARES,)."""
    steps = np.concatenate([_steps(predictor) for predictor in predictors])
    if len(steps) == 0:
        return np.asarray(np.arange(SHARES) == 0, np.float64)
    total, difference = steps.sum(axis=1), steps[:, 1] - steps[:, 0]
    standing = np.max(np.abs(steps), axis=1) < STANDING * np.max(np.abs(steps))
    turning = np.abs(difference) / np.maximum(np.abs(total), 1e-9)
    kinds = np.select([standing, turning < STRAIGHT, turning > SPINNING, difference > 0.0], [0, 1, 4, 2], default=3)
    return np.asarray(np.bincount(kinds, minlength=SHARES) / len(steps), np.float64)


def _steps(predictor: Predictor) -> Floats:
    """Return the rotation of each wheel in each window [rad], (n, 2)."""
    observations = predictor.segment.observations
    borders = np.arange(0.0, observations.seconds, WINDOW)
    if len(observations.wheel_time) == 0:
        return np.empty((0, 2))
    angles = np.stack([np.interp(borders, observations.wheel_time, wheel) for wheel in observations.wheel.T], axis=1)
    return np.asarray(np.diff(angles, axis=0), np.float64)

"""A first guess of the paper's parameters, good enough to begin a fit, whatever effects hide in the data."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from cmr.estimation.prediction import WHEELS, Predictor
from cmr.model.observer import Gains
from cmr.recordings.signal import Floats

STANDING = 0.1  # of the fastest wheels' speed: motors that hold still say little
WINDOW = 0.5  # s over which turns are compared
RATES = np.geomspace(1.0, 60.0, 10)  # 1/s: how fast motors of wheeled robots follow
SPEEDS = np.array([0.8, 0.9, 1.0, 1.1, 1.25])  # shares of the first guess of K1
FREE = Gains(0.3, 0.0, 0.3, 0.3)


class Width(NamedTuple):
    """A base width [m], and its standard deviation as a share of it."""

    value: float
    doubt: float


def guess_base_width(predictors: Sequence[Predictor], wheel_radius: float) -> Width | None:
    """Return the base width by which the wheels' difference explains the turns; None if the robot never turned."""
    difference, turn = (np.concatenate(column) for column in zip(*map(_turns, predictors), strict=True))
    moving = np.abs(difference) > 1e-3
    difference, turn = difference[moving], turn[moving]
    products, squares = float(difference @ turn), float(difference @ difference)
    if products <= 0.0:
        return None
    rest = turn - products / squares * difference
    return Width(wheel_radius * squares / products, float(np.sqrt(np.mean(rest**2) * squares)) / products)


def _turns(predictor: Predictor) -> tuple[Floats, Floats]:
    """Return by how much the wheels' angles differ, and the robot turned, in each window [rad]."""
    observations = predictor.segment.observations
    borders = np.arange(0.0, observations.seconds, WINDOW)
    wheels = np.interp(borders, observations.wheel_time, observations.wheel[:, 1] - observations.wheel[:, 0])
    if len(observations.pose_time):
        heading = np.interp(borders, observations.pose_time, np.unwrap(observations.pose[:, 2]))
    else:
        spans = np.diff(observations.gyro_time, prepend=observations.gyro_time[:1])
        heading = np.interp(borders, observations.gyro_time, np.cumsum(observations.gyro * spans))
    return np.diff(wheels), np.diff(heading)


def turn_rates(predictor: Predictor) -> Floats:
    """Return how fast the robot was seen to turn [rad/s], whichever way, in each window, (n,)."""
    return np.asarray(np.abs(_turns(predictor)[1]) / WINDOW, np.float64)


def _efforts(predictor: Predictor) -> Floats:
    """Return the mean size of both duties and of both wheel speeds [rad/s] in each window, shape (n, 2)."""
    observations = predictor.segment.observations
    borders = np.arange(0.0, observations.seconds, WINDOW)
    ends = np.arange(observations.steps + 1) * observations.dt
    duty = np.concatenate([[0.0], np.cumsum(np.abs(observations.duty).sum(axis=1)) * observations.dt])
    angle = np.cumsum(np.abs(np.diff(observations.wheel, axis=0, prepend=observations.wheel[:1])).sum(axis=1))
    columns = np.interp(borders, ends, duty), np.interp(borders, observations.wheel_time, angle)
    return np.diff(np.stack(columns, axis=1), axis=0) / WINDOW


def guess_motor(predictors: Sequence[Predictor], values: dict[str, float]) -> dict[str, float]:
    """Return k2_over_k3 and k1 by which commands explain the wheels best, on a grid."""
    steps = np.concatenate([_efforts(predictor) for predictor in predictors])
    moving = steps[steps[:, 1] > STANDING * np.max(steps[:, 1], initial=0.0)]
    k1 = float(np.sum(moving[:, 0]) / max(np.sum(moving[:, 1]), 1e-9))
    # At one rate the errors are linear in the acceleration: those at both ends tell those between.
    speeds = SPEEDS[[0, -1]] * k1
    lanes = {**values, "k2_over_k3": (RATES / speeds[:, None]).ravel(), "k1": np.repeat(speeds, len(RATES))}
    shares = (1.0 / SPEEDS - 1.0 / SPEEDS[0]) / (1.0 / SPEEDS[-1] - 1.0 / SPEEDS[0])
    sums = np.zeros((len(SPEEDS), len(RATES)))
    for predictor in predictors:
        of = predictor.errors(lanes, FREE).of
        for errors in (of[name] for name in WHEELS if name in of):
            first, last = np.split(errors, 2, axis=1)
            sums += [np.sum(np.abs(first + share * (last - first)), axis=0) for share in shares]
    speed, rate = np.unravel_index(int(np.argmin(sums)), sums.shape)
    k1 *= float(SPEEDS[speed])
    return {"k2_over_k3": float(RATES[rate]) / k1, "k1": k1}

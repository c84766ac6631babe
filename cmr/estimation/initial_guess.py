"""An initial guess of the paper's parameters, good enough to start a fit whatever effects are in the data."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from cmr.estimation.prediction import WHEELS, Predictor, errors_of
from cmr.model.observer.observer import RESTART, Gains, Observations
from cmr.model.parameters import Quantity
from cmr.recordings.signal import Floats

STANDING = 0.1  # of the fastest wheels' speed: motors at rest carry little information
WINDOW = 0.5  # s; window over which rotations are compared
GOOD = 0.02  # relative standard deviation at which a base width is good enough to start with
LATE = (0.05, 0.1, 0.15, 0.2, 0.3, 0.4, 0.5)  # s, of poses
RATES = np.geomspace(1.0, 60.0, 10)  # 1/s: response rates of motors of wheeled robots
SPEEDS = np.array([0.8, 0.9, 1.0, 1.1, 1.25])  # shares of the first guess of K1
POSES_APART = 0.2  # s between poses used instead of wheels, so that noise is small compared with the distance
OF_POSES = ("forward", "heading")
FREE = Gains(0.3, 0.0, 0.3, 0.3)


class Width(NamedTuple):
    """A base width [m], and its standard deviation as a share of it."""

    value: float
    doubt: float


def guess_base_width(predictors: Sequence[Predictor], wheel_radius: float) -> Width | None:
    """Estimate the base width from the wheels' difference and the rotation; None if the robot never turned.

    If the fit is poor, poses may be late: then the latency with the best fit is used.
    """
    width = _width(predictors, wheel_radius, 0.0)
    if width is not None and width.doubt < GOOD:
        return width
    widths = [width, *(_width(predictors, wheel_radius, late) for late in LATE)]
    return min((one for one in widths if one is not None), key=lambda one: one.doubt, default=None)


def _width(predictors: Sequence[Predictor], wheel_radius: float, late: float) -> Width | None:
    """Return the base width that fits poses delayed by `late` [s]; None if the robot never turned."""
    turned = [_turns(predictor, late) for predictor in predictors]
    difference, turn, _ = (np.concatenate(column) for column in zip(*turned, strict=True))
    moving = np.abs(difference) > 1e-3
    difference, turn = difference[moving], turn[moving]
    products, squares = float(difference @ turn), float(difference @ difference)
    if products <= 0.0:
        return None
    rest = turn - products / squares * difference
    return Width(wheel_radius * squares / products, float(np.sqrt(np.mean(rest**2) * squares)) / products)


def _turns(predictor: Predictor, late: float = 0.0) -> tuple[Floats, Floats, Floats]:
    """Return the difference of the wheel angles and the rotation of the robot in each window [rad], and its length [s].

    Poses farther apart than a window, such as those at the ends of a run, delimit windows themselves. Others are
    delayed by `late` [s]; windows in which the path restarts are skipped.
    """
    observations = predictor.segment.observations
    borders = np.arange(0.0, observations.seconds, WINDOW)
    if len(observations.pose_time) > 1 and np.median(np.diff(observations.pose_time)) > WINDOW:
        borders, late = observations.pose_time, 0.0
    path = np.zeros(len(borders), np.int64)
    if len(observations.pose_time) and borders is not observations.pose_time:
        begins = observations.pose_time[observations.pose_use == RESTART] - late
        path = np.searchsorted(begins, borders, side="right").astype(np.int64)
    wheels = np.zeros(len(borders))
    if len(observations.wheel_time):
        wheels = np.interp(borders, observations.wheel_time, observations.wheel[:, 1] - observations.wheel[:, 0])
    if len(observations.pose_time):
        heading = np.interp(borders, observations.pose_time - late, np.unwrap(observations.pose[:, 2]))
    else:
        spans = np.diff(observations.gyro_time, prepend=observations.gyro_time[:1])
        heading = np.interp(borders, observations.gyro_time, np.cumsum(observations.gyro * spans))
    whole = np.diff(path) == 0
    return np.diff(wheels)[whole], np.diff(heading)[whole], np.diff(borders)[whole]


def turn_rates(predictor: Predictor) -> Floats:
    """Return the absolute yaw rate [rad/s] in each window, (n,)."""
    _, turned, seconds = _turns(predictor)
    return np.asarray(np.abs(turned) / seconds, np.float64)


def _wheels(observations: Observations, values: Mapping[str, float]) -> tuple[Floats, Floats]:
    """Return the times of wheel readings [s] and both angles [rad], (n, 2); without readings, they are computed from
    poses.
    """
    if len(observations.wheel_time) or not len(observations.pose_time):
        return observations.wheel_time, observations.wheel
    times = np.arange(observations.pose_time[0], observations.pose_time[-1], POSES_APART)
    x, y = (np.interp(times, observations.pose_time, observations.pose[:, axis]) for axis in (0, 1))
    theta = np.interp(times, observations.pose_time, np.unwrap(observations.pose[:, 2]))
    along = 0.5 * (theta[1:] + theta[:-1])
    ahead = np.diff(x) * np.cos(along) + np.diff(y) * np.sin(along)
    apart = 0.5 * values["base_width"] * np.diff(theta)
    turned = np.stack([ahead - apart, ahead + apart], axis=1) / values["wheel_radius"]
    return times, np.concatenate([np.zeros((1, 2)), np.cumsum(turned, axis=0)])


def _efforts(predictor: Predictor, values: Mapping[str, float]) -> Floats:
    """Return the mean size of both duties and of both wheel speeds [rad/s] in each window, shape (n, 2)."""
    observations = predictor.segment.observations
    borders = np.arange(0.0, observations.seconds, WINDOW)
    ends = np.arange(observations.steps + 1) * observations.dt
    duty = np.concatenate([[0.0], np.cumsum(np.abs(observations.duty).sum(axis=1)) * observations.dt])
    times, wheels = _wheels(observations, values)
    angle = np.cumsum(np.abs(np.diff(wheels, axis=0, prepend=wheels[:1])).sum(axis=1))
    columns = np.interp(borders, ends, duty), np.interp(borders, times, angle)
    return np.diff(np.stack(columns, axis=1), axis=0) / WINDOW


def guess_motor(predictors: Sequence[Predictor], values: dict[str, float]) -> dict[str, float]:
    """Estimate k2_over_k3 and k1 by a grid search, from commands and wheels, or else poses."""
    steps = np.concatenate([_efforts(predictor, values) for predictor in predictors])
    moving = steps[steps[:, 1] > STANDING * np.max(steps[:, 1], initial=0.0)]
    k1 = float(np.sum(moving[:, 0]) / max(np.sum(moving[:, 1]), 1e-9))
    # At a given rate the errors are linear in the acceleration, so the two ends determine all values between.
    speeds = SPEEDS[[0, -1]] * k1
    lanes: dict[str, Quantity] = {
        **values,
        "k2_over_k3": (RATES / speeds[:, None]).ravel(),
        "k1": np.repeat(speeds, len(RATES)),
    }
    shares = (1.0 / SPEEDS - 1.0 / SPEEDS[0]) / (1.0 / SPEEDS[-1] - 1.0 / SPEEDS[0])
    sums = np.zeros((len(SPEEDS), len(RATES)))
    for of in (one.of for one in errors_of(predictors, lanes, FREE)):
        signals = WHEELS if any(name in of for name in WHEELS) else OF_POSES
        for errors in (of[name] for name in signals if name in of):
            first, last = np.split(errors, 2, axis=1)
            sums += [np.sum(np.abs(first + share * (last - first)), axis=0) for share in shares]
    speed, rate = np.unravel_index(int(np.argmin(sums)), sums.shape)
    k1 *= float(SPEEDS[speed])
    return {"k2_over_k3": float(RATES[rate]) / k1, "k1": k1}

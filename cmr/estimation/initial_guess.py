"""An initial guess of the paper's parameters, good enough to start a fit whatever effects are in the data."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from cmr.estimation.prediction import WHEELS, Predictor, errors_of
from cmr.model.observer.observer import RESTART, Gains, Observations
from cmr.model.parameters import Quantity
from cmr.recordings.signal import Floats, Mask

STANDING = 0.1  # of the fastest wheels' speed: motors at rest carry little information
WINDOW = 0.5  # s; window over which rotations are compared
MISSING = 2.5  # usual intervals between readings; in a longer one, more than one is missing
GOOD = 0.02  # relative standard deviation at which a base width is good enough to start with,
# and above which it counts as unknown. Drives with turns are ten times better, straight ones two times worse.
LARGEST_DOUBT = 0.05
# A robot that turns faster [rad/s] in this many windows may turn round between poses that are rare.
FAST, FEWEST_FAST = 0.3, 8
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

    If the fit is poor, poses may be late: then the latency with the best fit is used. Poses may also be too rare to
    follow a robot that turns fast: if they leave the base width unknown, the gyro may determine it.
    """
    width = _width(predictors, wheel_radius)
    if width is not None and width.doubt < GOOD:
        return width
    widths = [width, *(_width(predictors, wheel_radius, late) for late in LATE)]
    best = min(filter(None, widths), key=lambda one: one.doubt, default=None)
    if best is not None and best.doubt <= LARGEST_DOUBT:
        return best
    by_gyro = _width(predictors, wheel_radius, by_gyro=True)
    return min(filter(None, (best, by_gyro)), key=lambda one: one.doubt, default=None)


def _width(
    predictors: Sequence[Predictor], wheel_radius: float, late: float = 0.0, *, by_gyro: bool = False
) -> Width | None:
    """Return the base width that fits the gyro, or poses delayed by `late` [s]; None if the robot never turned."""
    turned = [_turns(predictor, late, by_gyro=by_gyro) for predictor in predictors]
    difference, turn, _ = (np.concatenate(column) for column in zip(*turned, strict=True))
    if by_gyro and np.count_nonzero(np.abs(turn) > FAST * WINDOW) < FEWEST_FAST:
        return None
    moving = np.abs(difference) > 1e-3
    difference, turn = difference[moving], turn[moving]
    products, squares = float(difference @ turn), float(difference @ difference)
    if products <= 0.0:
        return None
    rest = turn - products / squares * difference
    return Width(wheel_radius * squares / products, float(np.sqrt(np.mean(rest**2) * squares)) / products)


def _turns(predictor: Predictor, late: float = 0.0, *, by_gyro: bool = False) -> tuple[Floats, Floats, Floats]:
    """Return the difference of the wheel angles and the rotation of the robot in each window [rad], and its length [s].

    The rotation is that of the poses, delayed by `late` [s], or of the gyro if asked for, or if there are no poses.
    Poses that are usually farther apart than a window, such as those at the ends of a run, delimit windows themselves.
    Of others, windows in which the path restarts, or readings are missing, are skipped: a robot may turn round there.
    """
    observations = predictor.segment.observations
    borders = np.arange(0.0, observations.seconds, WINDOW)
    if by_gyro or not len(observations.pose_time):
        times, rate = observations.gyro_time, observations.gyro
        heading = np.cumsum(rate * np.diff(times, prepend=times[:1]))
        whole = _without_gaps(times, borders)
    else:
        times, heading = observations.pose_time - late, np.unwrap(observations.pose[:, 2])
        if len(times) > 1 and np.median(np.diff(times)) > WINDOW:
            borders = times = observations.pose_time
            whole = np.ones(len(borders) - 1, np.bool_)
        else:
            begins = times[observations.pose_use == RESTART]
            whole = _without_gaps(times, borders) & (np.diff(np.searchsorted(begins, borders, side="right")) == 0)
    if not len(times):
        return np.empty(0), np.empty(0), np.empty(0)
    wheels = np.zeros(len(borders))
    if len(observations.wheel_time):
        wheels = np.interp(borders, observations.wheel_time, observations.wheel[:, 1] - observations.wheel[:, 0])
    turned = np.interp(borders, times, heading)
    return np.diff(wheels)[whole], np.diff(turned)[whole], np.diff(borders)[whole]


def _without_gaps(times: Floats, borders: Floats) -> Mask:
    """Return in which windows between `borders` (n,) readings at `times` (m,) are nowhere far apart, (n - 1,)."""
    if not len(times):
        return np.zeros(max(len(borders) - 1, 0), np.bool_)
    intervals = np.diff(times)
    far = intervals > max(WINDOW, MISSING * float(np.median(intervals)) if len(intervals) else 0.0)
    first, last = times[np.append(True, far)], times[np.append(far, True)]
    stretch = np.searchsorted(first, borders, side="right") - 1
    seen = (stretch >= 0) & (borders <= last[stretch])
    return np.asarray(seen[1:] & seen[:-1] & (np.diff(stretch) == 0), np.bool_)


def turn_rates(predictor: Predictor) -> Floats:
    """Return the absolute yaw rate [rad/s] in each window, (n,): by poses, or else by the gyro."""
    _, turned, seconds = _turns(predictor)
    if not len(turned):
        _, turned, seconds = _turns(predictor, by_gyro=True)
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

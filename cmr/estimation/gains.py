"""Choose the observer gains: the usual ones, unless a robot's sensors require others.

Gains are right if prediction errors are not predictable from their own past. Encoders with a few hundred ticks per turn
at 100 Hz need smoothing; wheel speeds reported by a motor controller, or a lidar's poses at 5 Hz, do not.
"""

from collections.abc import Mapping, Sequence

import numpy as np

from cmr.estimation.noise import predicted
from cmr.estimation.prediction import POSE_SIGNALS, WHEELS, Batch, Errors, Predictor
from cmr.model.observer.observer import Gains, Observer
from cmr.recordings.signal import Floats

USUAL_ANGLE, USUAL_POSE = 0.2, 0.15  # gain of each sensor while that of the other is chosen
ANGLES = (0.1, 0.2, 0.35, 0.5, 0.7, 1.0)  # gains for a wheel's angle error
POSES = (0.05, 0.1, 0.15, 0.25, 0.4, 0.6, 1.0)  # gains for a pose's error
COARSE = 2.0 * np.pi / 100.0  # rad; ticks that are larger are coarse
OF_COARSE_ENCODERS = Gains(0.05, 0.05, USUAL_POSE, USUAL_POSE)  # whose ticks carry little information on speed
CLEARLY = 0.2  # share by which errors must shrink to prefer other gains to the usual ones


def gains_at(angle: float, pose: float, interval: float) -> Gains:
    """Return observer gains with these gains for wheel angles, read every `interval` [s], and poses.

    The speed gain that belongs to `angle` gives critical damping (an alpha-beta filter).
    """
    return Gains(angle, angle**2 / 4.0 / interval, pose, pose)


def choose_gains(predictors: Sequence[Predictor], values: Mapping[str, float]) -> Gains:
    """Return the gains nearest to the usual ones that predict wheels, and poses, about as well as any."""
    if max(predictor.segment.tick for predictor in predictors) > COARSE:
        return OF_COARSE_ENCODERS
    interval = interval_of(predictors)
    tested = [(angle, USUAL_POSE) for angle in ANGLES] + [(USUAL_ANGLE, pose) for pose in POSES]
    lanes = Gains(*np.array([gains_at(angle, pose, interval) for angle, pose in tested]).T)
    batch = Batch(predictors)
    errors = batch.errors(Observer(values, lanes))
    angle = _nearest(ANGLES, USUAL_ANGLE, _sizes(WHEELS, batch, errors, range(len(ANGLES))))
    pose = _nearest(POSES, USUAL_POSE, _sizes(POSE_SIGNALS, batch, errors, range(len(ANGLES), len(tested))))
    return gains_at(angle, pose, interval)


def interval_of(predictors: Sequence[Predictor]) -> float:
    """Return the usual time [s] between readings of the wheels; 0.01 where there are none."""
    times = [np.diff(predictor.segment.observations.wheel_time) for predictor in predictors]
    return float(np.median(np.concatenate(times))) if any(len(one) for one in times) else 0.01


def _sizes(names: Sequence[str], batch: Batch, errors: Errors, lanes: Sequence[int]) -> Floats:
    """Return the mean log size of the errors after subtracting their prediction from the past, per lane."""
    there = [name for name in names if name in batch.signals]
    if not there:
        return np.zeros(0)
    sizes = [
        [_log_size(predicted(name, errors.of[name][:, lane], batch.ends[name])) for lane in lanes] for name in there
    ]
    return np.asarray(np.average(np.array(sizes), axis=0, weights=[len(errors.of[name]) for name in there]))


def _log_size(rest: Floats) -> float:
    with np.errstate(divide="ignore", invalid="ignore"):
        size = 0.5 * np.log(np.mean(rest**2)) if len(rest) else 0.0
    return float(size) if np.isfinite(size) else np.inf


def _nearest(ladder: Sequence[float], usual: float, sizes: Floats) -> float:
    """Return the gain nearest to the usual one whose errors are hardly larger; `sizes` are their logarithms."""
    if not len(sizes) or not np.any(np.isfinite(sizes)):
        return usual
    good = [gain for gain, size in zip(ladder, sizes, strict=True) if size <= np.min(sizes) + CLEARLY]
    return min(good, key=lambda gain: abs(np.log(gain / usual)))

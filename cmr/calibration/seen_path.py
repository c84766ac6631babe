"""The path that the pose sensor would measure, of a robot that follows its wheels or commands, with all effects."""

from collections.abc import Mapping

import numpy as np

from cmr.calibration.segments import Segment
from cmr.estimation.prediction import FREE
from cmr.model.commands import Commands
from cmr.model.motion import Trajectory
from cmr.model.observer.observer import FOLLOWED, RESTART, Observations, observe
from cmr.model.parameters import RobotParameters

STEP = 0.01  # s
BEGINNINGS = 2  # iterations: the position of the tracked point depends on the heading, which the first one sets


def seen_path(segment: Segment, parameters: RobotParameters, *, by_wheels: bool) -> Trajectory:
    """Return the poses that would be measured at the segment's borders, (T + 1,), from its first pose on.

    The robot follows the measured wheels (`by_wheels`), or the recorded duties. Effects of the pose sensor are
    included: a point ahead of the turning centre swings out; if wheels are followed, only the pose latency relative to
    them counts. Wheel speeds and angles are returned as NaN.
    """
    time = segment.border_times
    steps = int(np.ceil(time[-1] / STEP))
    borders = np.arange(steps + 1) * STEP
    start = segment.start
    begin = np.array([start.x, start.y, start.theta])
    none = np.empty(0)
    angles = (
        [np.interp(borders, time, angle) for angle in (segment.angle_left, segment.angle_right)] if by_wheels else []
    )
    errors = observe(
        Observations(
            dt=STEP,
            steps=steps,
            commands=Commands(time[:-1], np.stack([segment.left, segment.right], axis=1)),
            start=(start.x, start.y, start.theta, start.psi_left, start.psi_right),
            wheel_time=none,
            wheel=np.empty((0, 2)),
            wheel_use=np.empty((0, 2), np.uint8),
            gyro_time=none,
            gyro=none,
            pose_time=np.concatenate([np.zeros(BEGINNINGS), time]),
            pose=np.concatenate([np.tile(begin, (BEGINNINGS, 1)), np.zeros((len(time), 3))]),
            pose_use=np.repeat(np.array([RESTART, FOLLOWED], np.uint8), [BEGINNINGS, len(time)]),
            given=np.diff(np.stack(angles, axis=1), axis=0) / STEP if by_wheels else np.empty((0, 2)),
        ),
        _beside_wheels(parameters.values) if by_wheels else parameters.values,
        FREE,
    ).pose[BEGINNINGS:, :, 0]
    x, y = -errors[:, 0], -errors[:, 1]
    theta = np.unwrap(-errors[:, 2], discont=np.pi)
    unknown = np.full(len(time), np.nan)
    return Trajectory(x, y, theta + _turns(theta[0], start.theta), *[unknown] * 4)


def _beside_wheels(values: Mapping[str, float]) -> dict[str, float]:
    """Return the parameters with the pose latency relative to the wheels' time stamps."""
    late = values.get("pose_latency", 0.0) - values.get("wheel_speed_latency", 0.0)
    return {**values, "pose_latency": late}


def _turns(theta: float, near: float) -> float:
    """Return the multiple of full turns [rad] that brings a heading nearest to another."""
    return float(np.round((near - theta) / (2.0 * np.pi)) * 2.0 * np.pi)

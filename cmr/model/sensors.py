"""Simulated sensor readings of a drive: the sensor stages of the catalogue.

The true motion is a trajectory; encoders, gyro and an external pose sample it at the stamped times of their messages.
Noise is not part of the model.
"""

from collections.abc import Callable, Mapping
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cmr.model.catalogue import CATALOGUE, remembered
from cmr.model.extended.evaluating import Evaluated, evaluated
from cmr.model.extended.statements import OF_MOTION, SIDES, read_by
from cmr.model.filtering import FILTER_AGES, FILTER_WEIGHTS
from cmr.model.motion import Floats, Trajectory
from cmr.model.parameters import RobotParameters

Times: TypeAlias = NDArray[np.floating]  # s


class Readings(NamedTuple):
    """Sensor readings, each at its own times: wheel angles [rad], yaw rate [rad/s], pose [m, m, rad]."""

    angle_left: Floats
    angle_right: Floats
    yaw_rate: Floats
    x: Floats
    y: Floats
    theta: Floats


def read_sensors(
    time: Times,
    motion: Trajectory,
    parameters: RobotParameters,
    encoder_time: Times,
    gyro_time: Times,
    pose_time: Times,
) -> Readings:
    """Simulate the sensor readings of one robot's motion.

    `time` [s], shape (T + 1,), are the times of the trajectory, from the start of the drive on; the others are the
    stamps of the readings. The motion is interpolated between its times, and at rest outside.
    """
    values = _values(parameters)
    stamp = np.asarray(encoder_time)
    turned_at = _stage("encoder_time")({**values, "time": stamp, "moment": stamp})["moment"]
    turned = (
        _turned(turned_at, time, motion.angle_left, motion.psi_left),
        _turned(turned_at, time, motion.angle_right, motion.psi_right),
    )
    sides = {
        side: _stage("encoder", side)({**values, "time": stamp, "reading": angle})["reading"]
        for side, angle in zip(SIDES, turned, strict=True)
    }
    seen = _stage("gyro_time")({**values, "time": np.asarray(gyro_time), "moment": np.asarray(gyro_time)})["moment"]
    turning = np.interp(seen, time, yaw_rate(time, motion.theta))
    gyro = _stage("gyro")(
        {
            **values,
            **(_place(motion, time, seen) if _asked("gyro") else {}),
            "time": np.asarray(gyro_time),
            "reading": turning,
            "yaw_rate": turning,
        }
    )
    pose = pose_seen(time, motion, parameters, pose_time)
    return Readings(sides["left"], sides["right"], gyro["reading"], *pose)


def _turned(at: Floats, time: Times, angle: Floats, psi: Floats) -> Floats:
    """Return the angles [rad] of a wheel at some times [s]: cubic interpolation of known angles and speeds."""
    before = np.clip(np.searchsorted(time, at, side="right") - 1, 0, len(time) - 2)
    span, step = time[before + 1] - time[before], angle[before + 1] - angle[before]
    share = np.clip((at - time[before]) / span, 0.0, 1.0)
    bend = (1.0 - share) * (span * psi[before] - step) - share * (span * psi[before + 1] - step)
    return angle[before] + share * step + share * (1.0 - share) * bend


def encoder_reading(values: Mapping[str, ArrayLike], side: str, angle: Floats) -> Floats:
    """Return the reading of a side's encoder ("left", "right") at a wheel angle [rad]; parameter `values` by name."""
    return _stage("encoder", side)({**_neutral(), **values, "time": np.zeros(1), "reading": angle})["reading"]


def pose_seen(
    time: Times,
    motion: Trajectory,
    parameters: RobotParameters,
    pose_time: Times,
    at: Callable[[Floats], Floats] = lambda moment: moment,
) -> tuple[Floats, Floats, Floats]:
    """Return the external pose x, y, theta at its stamped times; arguments as in `read_sensors`.

    `at` maps times to the axis of `time`, both [s]: drives may be concatenated there.
    """
    values = {**_values(parameters), "time": np.asarray(pose_time)}
    seen = _stage("pose_time")({**values, "moment": np.asarray(pose_time), "filtered": 0.0})
    moments = [at(seen["moment"] - age * seen["filtered"]) for age in FILTER_AGES]
    place = {
        name: sum(
            weight * np.interp(moment, time, getattr(motion, name))
            for weight, moment in zip(FILTER_WEIGHTS, moments, strict=True)
        )
        for name in ("x", "y", "theta")
    }
    moving = _moving(motion, time, moments[0]) if _asked("pose") else {}
    pose = _stage("pose")({**values, **moving, **place})
    return pose["x"], pose["y"], pose["theta"]


def yaw_rate(time: Times, theta: Floats) -> Floats:
    """Return the yaw rate [rad/s] at each time, from unwrapped headings."""
    return np.gradient(theta, time)


def _place(motion: Trajectory, time: Times, at: Floats) -> dict[str, ArrayLike]:
    """Return the pose and velocity of the robot at some times [s]."""
    place = {name: np.interp(at, time, getattr(motion, name)) for name in ("x", "y", "theta")}
    return {**place, **_moving(motion, time, at)}


def _moving(motion: Trajectory, time: Times, at: Floats) -> dict[str, ArrayLike]:
    """Return the forward speed [m/s] and the yaw rate [rad/s] at some times [s], interpolated in the trajectory."""
    step = np.clip(np.searchsorted(time, at, side="right") - 1, 0, len(time) - 2)
    dt = time[step + 1] - time[step]
    moved_x, moved_y, turned = ((values[step + 1] - values[step]) / dt for values in (motion.x, motion.y, motion.theta))
    heading = 0.5 * (motion.theta[step] + motion.theta[step + 1])
    return {"speed": moved_x * np.cos(heading) + moved_y * np.sin(heading), "yaw_rate": turned}


@remembered
def _asked(stage: str) -> bool:
    """Return whether any sensor effect reads the motion."""
    return any(read_by(effect, stage) & {*OF_MOTION[stage]} for effect in CATALOGUE.values() if effect.is_sensor)


def _values(parameters: RobotParameters) -> dict[str, ArrayLike | None]:
    """Return all parameters by name, including neutral ones."""
    return {**_neutral(), **parameters.values}


@remembered
def _neutral() -> dict[str, ArrayLike | None]:
    """Return the neutral value of each of the sensors' parameters."""
    return {
        parameter.name: parameter.neutral
        for effect in CATALOGUE.values()
        if effect.is_sensor
        for parameter in effect.all_parameters
    }


@remembered
def _stage(stage: str, side: str | None = None) -> Evaluated:
    return evaluated(tuple(name for name, effect in CATALOGUE.items() if effect.is_sensor), stage, side)

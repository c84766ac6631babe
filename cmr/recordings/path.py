"""A measured path freed of the motion that wheels and gyro tell: what is left is slow, unless poses are wrong."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cmr.recordings.lags import Travel, command_travel, gyro_travel, wheel_travel
from cmr.recordings.recording import Recording
from cmr.recordings.robust import quantile, ratio, running_largest, running_median, running_range, wrapped
from cmr.recordings.signal import Floats, Mask, Signal

HALF = 5  # neighbours on either side; a burst of that many outliers is seen through
COMPARED = 0.5  # s over which two sensors' motions are compared
LONGEST_GAP = 0.3  # s; over a longer one a sensor does not tell the motion
EXPLAINED = 0.5  # a sensor is used where what it leaves of the motion is less than this share
USUAL = 0.3  # s before and after, whose median rate is that of a path of which no sensor tells
USUAL_DOUBT = 1.5  # of how much that rate changes between neighbours
JITTER, JITTER_SHARE = 0.045, 0.75  # s and share of the time to the next by which a pose's time stamp may be wrong
# Of the motion that a sensor tells, the share by which the true one may be less: wheels may spin, a gyro cannot.
WHEEL_SLIP, GYRO_SLIP, USUAL_SLIP = 1.0, 0.1, 1.0
MOTOR_RESPONSE = 0.1  # s by which wheels may follow a command sooner or later than on average
LARGEST = 0.9  # quantile by which motions are compared: the rest may be outliers

Complexes = NDArray[np.complex128]


@dataclass(frozen=True)
class Sensor:
    """What tells the motion: its travel, the `lag` [s] by which poses are stamped later than it.

    Of the motion it tells, `slip` is the share by which the true one may be less; it may follow within `response` [s].
    """

    travel: Travel
    lag: float
    slip: float
    response: float = 0.0


@dataclass(frozen=True)
class Motion:
    """The motion from each pose to the next, shape (n - 1,).

    `steps` [m, complex, or rad], `doubt` how far wrong the place of a pose may be for its time stamp, `slip` how far
    slip may go.
    """

    steps: NDArray[Any]
    doubt: Floats
    slip: Floats


@dataclass(frozen=True)
class Path:
    """A measured path freed of the motion that sensors tell, shape (n,).

    `place` [m, complex: x + iy] and `heading` [rad] are what is left, `off` and `off_heading` by how much each stands
    off the median of its neighbours, `doubt` and `doubt_heading` how much of that the motion may be to blame for.
    `slip` [m], `slip_heading` [rad] are how far slip may have led it astray until each `time` [s].
    """

    time: Floats
    place: Complexes
    heading: Floats
    off: Complexes
    off_heading: Floats
    doubt: Floats
    doubt_heading: Floats
    slip: Floats
    slip_heading: Floats

    @classmethod
    def of(cls, recording: Recording, poses: Signal, pose_lag: float = 0.0, gyro_lag: float = 0.0) -> "Path":
        """Free the path of `poses` of the motion that the recording's wheels, else commands, and gyro tell."""
        time, theta, measured = poses.seconds, poses["theta"], poses["x"] + 1j * poses["y"]
        wheels, gyro = _sensors(recording, int(poses.utime[0]), pose_lag, gyro_lag)
        turned = _turned(time, wrapped(np.diff(theta)), [sensor for sensor in (gyro, wheels) if sensor])
        left = theta - theta[0] - _summed(turned.steps)
        smooth = np.unwrap(np.arctan2(running_median(np.sin(left), HALF), running_median(np.cos(left), HALF)))
        off_heading = wrapped(left - smooth)
        facing = theta[0] + smooth + _summed(turned.steps)
        moved = _moved(time, np.diff(measured), facing, wheels)
        place = measured - measured[0] - _summed(moved.steps)
        off = place - running_median(place.real, HALF) - 1j * running_median(place.imag, HALF)
        doubts = (np.maximum(np.append(0.0, m.doubt), np.append(m.doubt, 0.0)) for m in (moved, turned))
        slips = (_summed(m.slip) for m in (moved, turned))
        return cls(time, place, smooth + off_heading, off, off_heading, *doubts, *slips)

    def at(self, index: NDArray[np.int64]) -> "Path":
        """Return the path of these poses alone."""
        return Path(*(getattr(self, name)[index] for name in self.__dataclass_fields__))


def _sensors(
    recording: Recording, origin: int, pose_lag: float, gyro_lag: float
) -> tuple[Sensor | None, Sensor | None]:
    """Return what tells the motion of the wheels, if need be the commands, and the gyro."""
    wheels = gyro = None
    if len(recording.wheels) > 1:
        wheels = Sensor(wheel_travel(recording.wheels, origin), pose_lag, WHEEL_SLIP)
    elif len(recording.commands) > 1:
        wheels = Sensor(command_travel(recording.commands, origin), pose_lag, WHEEL_SLIP, MOTOR_RESPONSE)
    if len(recording.gyro) > 1:
        gyro = Sensor(gyro_travel(recording.gyro, origin), pose_lag - gyro_lag, GYRO_SLIP)
    return wheels, gyro


def _turned(time: Floats, measured: Floats, sensors: list[Sensor]) -> Motion:
    """Return the turn from each pose to the next [rad], by the sensor that explains the `measured` one best."""
    dt = np.diff(time)
    motion = _usual(measured, dt)
    over, best = _samples(dt), EXPLAINED
    for sensor in sensors:
        told, covered = _told(time - sensor.lag, sensor.travel.time, sensor.travel.turned)
        whole, part = (_over(np.where(covered, values, 0.0), over) for values in (measured, told))
        factor = ratio(whole, part)
        unexplained = _share(whole - factor * part, whole)
        if unexplained < best:
            best, motion = unexplained, _preferred(motion, factor * told, covered, dt, sensor)
    return motion


def _moved(time: Floats, measured: Complexes, facing: Floats, sensor: Sensor | None) -> Motion:
    """Return the way from each pose to the next [m, complex], the robot facing `facing` [rad]."""
    dt = np.diff(time)
    ahead = np.exp(0.5j * (facing[1:] + facing[:-1]))
    usual = _usual(measured / ahead, dt)
    motion = Motion(usual.steps * ahead, usual.doubt, usual.slip)
    if sensor is None or sensor.travel.driven is None:
        return motion
    told, covered = _told(time - sensor.lag, sensor.travel.time, sensor.travel.driven)
    over = _samples(dt)
    whole, part = (_over(np.where(covered, values, 0.0), over) for values in (measured, told * ahead))
    size = np.abs(part)
    along = whole * np.conj(part) / np.maximum(size, 1e-300)
    factor = ratio(along.real, size) + 1j * ratio(along.imag, size)
    if _share(whole - factor * part, whole) >= EXPLAINED:
        return motion
    return _preferred(motion, factor * told * ahead, covered, dt, sensor)


def _usual(measured: NDArray[Any], dt: Floats) -> Motion:
    """Return the motion at the median rate of the steps around; it errs where the rate changes."""
    half = int(np.clip(round(USUAL / max(float(np.median(dt)), 1e-6)), 2, HALF))
    parts = [measured.real, measured.imag] if np.iscomplexobj(measured) else [measured]
    rates = [running_median(part / dt, half) for part in parts]
    doubt = USUAL_DOUBT * np.sum([running_range(rate, 1) for rate in rates], axis=0) * dt
    steps = (rates[0] if len(rates) == 1 else rates[0] + 1j * rates[1]) * dt
    return Motion(steps, doubt, USUAL_SLIP * np.abs(steps))


def _preferred(usual: Motion, told: NDArray[Any], covered: Mask, dt: Floats, sensor: Sensor) -> Motion:
    """Return the motion that a sensor told where it did; it errs where the pose's time stamp does."""
    rate = np.abs(told) / dt
    doubt = np.minimum(JITTER_SHARE * dt, JITTER) * running_largest(rate, HALF)
    if sensor.response:
        doubt += sensor.response * running_range(rate, HALF)
    return Motion(
        np.where(covered, told, usual.steps),
        np.where(covered, doubt, usual.doubt),
        np.where(covered, sensor.slip * np.abs(told), usual.slip),
    )


def _told(time: Floats, sensor_time: Floats, travel: Floats) -> tuple[Floats, Mask]:
    """Return what a sensor tells of the travel between each time and the next, and where it does, shape (n - 1,)."""
    after = np.clip(np.searchsorted(sensor_time, time), 1, len(sensor_time) - 1)
    known = (sensor_time[after] - sensor_time[after - 1] <= LONGEST_GAP) & (time >= sensor_time[0])
    known &= time <= sensor_time[-1]
    return np.diff(np.interp(time, sensor_time, travel)), known[1:] & known[:-1]


def _samples(dt: Floats) -> int:
    """Return over how many steps motions are compared."""
    return int(np.clip(round(COMPARED / max(float(np.median(dt)), 1e-6)), 1, len(dt)))


def _over(steps: NDArray[Any], samples: int) -> NDArray[Any]:
    """Return the sums of so many successive steps."""
    total = _summed(steps)
    return np.asarray(total[samples:] - total[:-samples])


def _share(left: NDArray[Any], whole: NDArray[Any]) -> float:
    """Return the size of what is left as a share of the whole; infinite where there is no motion."""
    size = quantile(np.abs(whole), LARGEST)
    return quantile(np.abs(left), LARGEST) / size if size > 0.0 else np.inf


def _summed(steps: NDArray[Any]) -> NDArray[Any]:
    return np.append(0.0, np.cumsum(steps))

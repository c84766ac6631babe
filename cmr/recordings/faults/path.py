"""A measured path minus the motion from wheels and gyro: the residual is slow, unless poses are wrong."""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

from cmr.recordings.faults.run_ends import off_the_ends
from cmr.recordings.lags import response_to_commands
from cmr.recordings.recording import Recording
from cmr.recordings.robust import quantile, ratio, run_ends, running_largest, running_median, running_range, wrapped
from cmr.recordings.signal import Floats, Mask, Signal
from cmr.recordings.travel import Travel, travel_of

HALF = 5  # neighbours on either side; bursts of up to this many outliers are tolerated
SHORTEST_STEP = 1e-6  # s; time stamps are no finer
SAME_RATE = 0.02  # share by which usual times between poses may differ from round ones
HARDEST, HARDEST_TURN = 10.0, 200.0  # m/s^2, rad/s^2; no wheeled robot brakes or accelerates harder
COMPARED = 0.5  # s over which two sensors' motions are compared
LONGEST_GAP = 0.3  # s; a sensor does not determine the motion over a longer gap
EXPLAINED = 0.5  # a sensor is used if its residual is less than this share of the motion
USUAL = 0.3  # s before and after, whose median rate predicts the path without a sensor
USUAL_STEP = 0.02  # s at least over which a rate is taken: poses of 200 Hz rounded to 1 mm move by 0 or 0.2 m/s
USUAL_DOUBT = 1.5  # of the change of that rate between neighbours
JITTER, JITTER_SHARE = 0.045, 0.75  # s, and share of the time to the next pose, by which a pose's stamp may be wrong
# Share by which the true motion may be less than a sensor's: wheels may spin, a gyro cannot.
WHEEL_SLIP, GYRO_SLIP, USUAL_SLIP = 1.0, 0.1, 1.0
# Delay of a reported change, in sample intervals of the sensor. Commands may have been given at any time since the
# previous one was recorded.
HALF_PERIOD, WHOLE_PERIOD = 0.5, 1.0
LARGEST = 0.9  # quantile used to compare motions: the rest may be outliers
# Deviation due to a change of slip, as a share of the time span of neighbours: from their line near the end of a run,
# and from their median inside it.
BENT, BENT_WITHIN = 0.5, 0.15

Complexes = NDArray[np.complex128]
Numbers = TypeVar("Numbers", Floats, Complexes)  # of turns [rad], and of ways [m]


@dataclass(frozen=True)
class Sensor:
    """A motion sensor: its travel, and the `lag` [s] of poses behind it.

    `slip` is the share by which the true motion may be less; it may lag by up to `response` [s].
    """

    travel: Travel
    lag: float
    slip: float
    response: float


@dataclass(frozen=True)
class Motion(Generic[Numbers]):
    """The motion from each pose to the next, shape (n - 1,).

    `steps` [m, complex, or rad], `doubt` the position error of a pose due to its time stamp, `slip` the largest slip,
    `bend` the deviation from the line near the end of a run due to a change of slip, `unseen` the error of the pose at
    its outer end, which has no neighbour.
    """

    steps: Numbers
    doubt: Floats
    slip: Floats
    bend: Floats
    unseen: Floats


class Steps:
    """The steps from each pose to the next, shape (n - 1,): `dt` [s], their `run`, and whether they are `within` it.

    A step between runs counts to the first one, but is not used.
    """

    def __init__(self, dt: Floats, run: NDArray[np.int64]) -> None:
        self.run = run[:-1]
        self.within: Mask = np.diff(run) == 0
        self.usual = max(float(np.median(dt[self.within])) if self.within.any() else 0.0, SHORTEST_STEP)
        self.dt: Floats = np.where(self.within, dt, self.usual)
        self._samples = int(np.clip(round(COMPARED / self.usual), 1, len(dt)))

    @property
    def reach(self) -> Floats:
        """The time [s] for which neighbours on one side reach."""
        return HALF * running_largest(self.dt, HALF, self.run)

    @property
    def from_end(self) -> NDArray[np.int64]:
        """The number of steps between each one and the nearer end of its run."""
        first, last = run_ends(self.run)
        place = np.arange(len(first))
        return np.asarray(np.minimum(place - first, np.maximum(last - ~self.within[last] - place, 0)), np.int64)

    @cached_property
    def groups(self) -> NDArray[np.int64]:
        """The starts of groups of neighbouring steps that last USUAL_STEP together, shape (g,); groups do not span
        runs.
        """
        first, _ = run_ends(self.run)
        samples = max(int(np.ceil(USUAL_STEP / self.usual * (1.0 - SAME_RATE))), 1)
        return np.flatnonzero((np.arange(len(first)) - first) % samples == 0)

    def rates(self, steps: Floats) -> Floats:
        """Return the rate of each group, shape (g,); a group between runs gets the previous rate."""
        motion_seen, time = (np.add.reduceat(np.where(self.within, of, 0.0), self.groups) for of in (steps, self.dt))
        rates = motion_seen / np.maximum(time, SHORTEST_STEP)
        empty = np.flatnonzero(time == 0.0)
        rates[empty] = np.where(empty > 0, rates[empty - 1], 0.0)
        return rates

    def each(self, of_groups: Floats) -> Floats:
        """Expand values of groups to each of their steps."""
        return np.repeat(of_groups, np.diff(np.append(self.groups, len(self.dt))))

    def over(self, steps: Numbers) -> Numbers:
        """Return the sums of as many successive steps as motions are compared over, within runs."""
        samples = self._samples
        total = _summed(steps)
        outside = np.append(0, np.cumsum(~self.within))
        sums = total[samples:] - total[:-samples]
        return np.asarray(sums[outside[samples:] == outside[:-samples]])


@dataclass(frozen=True)
class Path:
    """A measured path minus the motion from sensors, shape (n,).

    `run` numbers the pieces of the recording: each is a path of its own. `place` [m, complex: x + iy] and `heading`
    [rad] are what is left, `off` and `off_heading` by how much each stands off the median of its neighbours, or off
    the line through them near an end, `doubt` and `doubt_heading` how much of that the motion may be to blame for:
    all of it where there are too few neighbours. `slip` [m], `slip_heading` [rad] are how far slip may have led it
    astray until each `time` [s].
    """

    time: Floats
    run: NDArray[np.int64]
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
        """Subtract the motion from the recording's wheels, or else commands, and gyro from the path of `poses`."""
        time, theta, measured = poses.seconds, poses["theta"], poses["x"] + 1j * poses["y"]
        run = recording.pieces.number(poses.utime)
        steps = Steps(np.diff(time), run)
        wheels, gyro = _sensors(recording, int(poses.utime[0]), pose_lag, gyro_lag)
        turned = _turned(time, wrapped(np.diff(theta)), steps, [sensor for sensor in (gyro, wheels) if sensor])
        left = theta - theta[0] - _summed(turned.steps)
        smooth = np.arctan2(running_median(np.sin(left), HALF, run), running_median(np.cos(left), HALF, run))
        smooth = np.unwrap(smooth)
        heading = smooth + wrapped(left - smooth)
        moved = _moved(time, np.diff(measured), theta[0] + smooth + _summed(turned.steps), steps, wheels)
        place = measured - measured[0] - _summed(moved.steps)
        off_heading, doubt_heading = _off(time, heading, run, turned)
        x, y = (_off(time, part, run, moved) for part in (place.real, place.imag))
        slips = (_summed(m.slip) for m in (moved, turned))
        return cls(time, run, place, heading, x[0] + 1j * y[0], off_heading, x[1], doubt_heading, *slips)

    def at(self, index: NDArray[np.int64]) -> "Path":
        """Return the path of these poses only."""
        return Path(*(getattr(self, name)[index] for name in self.__dataclass_fields__))


def _sensors(
    recording: Recording, origin: int, pose_lag: float, gyro_lag: float
) -> tuple[Sensor | None, Sensor | None]:
    """Return the motion sensors: the wheels, or else the commands, and the gyro."""
    wheels = gyro = None
    if len(recording.wheels) > 1:
        wheels = _sensor(recording, "wheels", origin, pose_lag, WHEEL_SLIP)
    elif len(recording.commands) > 1:
        wheels = _sensor(recording, "commands", origin, pose_lag, WHEEL_SLIP)
    if len(recording.gyro) > 1:
        gyro = _sensor(recording, "gyro", origin, pose_lag - gyro_lag, GYRO_SLIP)
    return wheels, gyro


def _sensor(recording: Recording, name: str, origin: int, lag: float, slip: float) -> Sensor:
    travel = travel_of(recording, name, origin)
    period = float(np.median(np.diff(travel.time)))
    response = response_to_commands(lag) + WHOLE_PERIOD * period if name == "commands" else HALF_PERIOD * period
    return Sensor(travel, lag, slip, response)


def _off(time: Floats, values: Floats, run: NDArray[np.int64], motion: Motion[Numbers]) -> tuple[Floats, Floats]:
    """Return the deviations of values from their neighbours, and how much of that may be due to the motion."""
    off, near, untold = off_the_ends(time, values, HALF, run)
    off = np.where(near, off, values - running_median(values, HALF, run))
    doubt, bend = (np.maximum(np.append(0.0, of), np.append(of, 0.0)) for of in (motion.doubt, motion.bend))
    first, last = run_ends(run)
    place = np.arange(len(run))
    inward = np.clip(np.where(place - first <= last - place, place, place - 1), 0, len(run) - 2)
    return off, np.where(untold, np.inf, doubt + np.where(near, BENT * bend + motion.unseen[inward], 0.0))


def _turned(time: Floats, measured: Floats, steps: Steps, sensors: list[Sensor]) -> Motion[Floats]:
    """Return the turn from each pose to the next [rad], by the sensor that explains the `measured` one best."""
    motion = _usual(measured, steps, HARDEST_TURN)
    best = EXPLAINED
    for sensor in sensors:
        motion_seen, covered = _motion_seen(time - sensor.lag, sensor.travel, sensor.travel.turned)
        whole, part = (steps.over(np.where(covered, values, 0.0)) for values in (measured, motion_seen))
        factor = ratio(whole, part)
        unexplained = _share(whole - factor * part, whole)
        if unexplained < best:
            best = unexplained
            motion = _preferred(motion, factor * motion_seen, [factor * motion_seen], covered, steps, sensor)
    return motion


def _moved(time: Floats, measured: Complexes, facing: Floats, steps: Steps, sensor: Sensor | None) -> Motion[Complexes]:
    """Return the way from each pose to the next [m, complex], the robot facing `facing` [rad]."""
    ahead = np.exp(0.5j * (facing[1:] + facing[:-1]))
    usual = _usual(measured / ahead, steps, HARDEST)
    motion = replace(usual, steps=usual.steps * ahead)
    if sensor is None or sensor.travel.driven is None:
        return motion
    motion_seen, covered = _motion_seen(time - sensor.lag, sensor.travel, sensor.travel.driven)
    whole, part = (steps.over(np.where(covered, values, 0.0)) for values in (measured, motion_seen * ahead))
    size = np.abs(part)
    along = whole * np.conj(part) / np.maximum(size, 1e-300)
    factor = ratio(along.real, size) + 1j * ratio(along.imag, size)
    if _share(whole - factor * part, whole) >= EXPLAINED:
        return motion
    turning, _ = _motion_seen(time - sensor.lag, sensor.travel, sensor.travel.turned)
    sides = [
        abs(factor) * (motion_seen + sign * turning) for sign in (1.0, -1.0)
    ]  # each as if the robot drove straight on
    return _preferred(motion, factor * motion_seen * ahead, sides, covered, steps, sensor)


def _usual(measured: Numbers, steps: Steps, hardest: float) -> Motion[Numbers]:
    """Return the motion at the median rate of the surrounding steps; it is wrong where the rate changes.

    The rate changes by no more than `hardest` [m/s^2 or rad/s^2].
    """
    samples = np.add.reduceat(np.ones(len(steps.dt)), steps.groups)
    together, run = steps.usual * float(samples.max()), steps.run[steps.groups]
    half = int(np.clip(round(USUAL / together), 2, max(np.ceil(HALF / samples.max()), 3)))
    parts: list[Floats] = [np.real(measured), *([np.imag(measured)] if np.iscomplexobj(measured) else [])]
    of_groups = [running_median(steps.rates(part), half, run) for part in parts]
    # Within a group, and up to the middle of its neighbours, a changing rate causes errors.
    ranges = steps.each(np.sum([running_range(rate, 1, run) for rate in of_groups], axis=0) * 0.5 * (samples + 1.0))
    rates = [steps.each(rate) for rate in of_groups]
    rate = rates[0] if len(rates) == 1 else rates[0] + 1j * rates[1]
    usual = np.asarray(np.where(steps.within, rate, 0.0) * steps.dt, dtype=measured.dtype)
    bend = np.sum([running_range(rate, HALF, steps.run) for rate in rates], axis=0) * steps.reach
    bend = np.maximum(bend - np.median(bend), 0.0)  # its usual size is noise
    # The median does not cover the very first and last steps: the robot may have been as fast as ever.
    time = np.maximum(((half + 1) // 2 + 1) * samples.max() - steps.from_end, 0) * steps.dt
    unseen = np.minimum(np.max(np.abs(usual) / steps.dt, initial=0.0) * time, 0.5 * hardest * time**2)
    return Motion(usual, USUAL_DOUBT * ranges * steps.dt, USUAL_SLIP * np.abs(usual), USUAL_SLIP * bend, unseen)


def _preferred(
    usual: Motion[Numbers], motion_seen: Numbers, sides: list[Floats], covered: Mask, steps: Steps, sensor: Sensor
) -> Motion[Numbers]:
    """Return the motion from a sensor, where available; its errors come from the pose's time stamp.

    `sides` are the steps of each side of the robot: when one changes its speed, slip may change.
    """
    covered = covered & steps.within
    speeds = [np.where(covered, side / steps.dt, 0.0) for side in sides]
    late = HALF + int(np.ceil(sensor.response / steps.usual))
    change, change_late = (
        np.max([running_range(speed, half, steps.run) for speed in speeds], axis=0) for half in (HALF, late)
    )
    # Changes before a run begins may be reported late, and those after its end early.
    fastest = np.max([np.max(np.abs(speed), initial=0.0) for speed in speeds])
    change_late = np.where(
        steps.from_end * steps.usual < sensor.response, np.maximum(change_late, fastest), change_late
    )
    rate = np.where(covered, np.abs(motion_seen) / steps.dt, 0.0)
    doubt = np.minimum(JITTER_SHARE * steps.dt, JITTER) * running_largest(rate, HALF, steps.run)
    bend = sensor.slip * change * steps.reach
    doubt += sensor.response * change_late + BENT_WITHIN * bend
    return Motion(
        np.where(covered, motion_seen, usual.steps),
        np.where(covered, doubt, usual.doubt),
        np.where(covered, sensor.slip * np.abs(motion_seen), usual.slip),
        np.where(covered, bend, usual.bend),
        np.where(covered, 0.0, usual.unseen),
    )


def _motion_seen(time: Floats, travel: Travel, travelled: Floats) -> tuple[Floats, Mask]:
    """Return a sensor's travel between each time and the next, and where it is known, shape (n - 1,)."""
    after = np.clip(np.searchsorted(travel.time, time), 1, len(travel.time) - 1)
    known = (travel.time[after] - travel.time[after - 1] <= LONGEST_GAP) & (time >= travel.time[0])
    known &= time <= travel.time[-1]
    return np.diff(np.interp(time, travel.time, travelled)), known[1:] & known[:-1]


def _share(left: Numbers, whole: Numbers) -> float:
    """Return the size of what is left as a share of the whole; infinite without motion."""
    size = quantile(np.abs(whole), LARGEST)
    return quantile(np.abs(left), LARGEST) / size if size > 0.0 else np.inf


def _summed(steps: Numbers) -> Numbers:
    return np.append(0.0, np.cumsum(steps))

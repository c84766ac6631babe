"""Dead reckoning: the robot's place while no pose is reported, and its uncertainty.

The gyro, minus its reading at rest, gives the heading; the wheels give the distance. Dead reckoning has a few unknown
constants: the errors of the initial pose, the gyro's bias and scale error, and the scale error of the wheels. To first
order, each moves the place at time t by its size times

    e(t) = e(0) + int (h R u + r u) ds,

with the distance s, the heading's direction u, R a quarter turn, and the constant's effect on the heading, h, and on
the distance, r. The robot is within SURE standard deviations of all constants together, in the worst direction. Driving
back cancels part of the errors, and of the uncertainty.
"""

from dataclasses import dataclass, replace

import numpy as np

from cmr.recordings.recording import Recording
from cmr.recordings.signal import SECONDS, Floats
from cmr.recordings.wheel_angles import wheel_angles

SURE = 3.0  # standard deviations
PLACED, HEADED = 0.02, 0.03  # m, rad: accuracy with which a person puts a robot down
BIAS = 0.004  # rad/s, error of a gyro's bias after a rest: it drifts
TURNED, TURNED_BY_WHEELS = 0.02, 0.1  # relative error of turns by a gyro; by wheels, on a base of uncertain width
ROLLED = 0.04  # relative error of the distance: wheel radius, and slip
UNLIKE = 0.02  # relative difference of the wheels; without a gyro it turns the robot as it drives
# Their standard deviations, in this order: east, north, heading, bias, turns, distance, unlike wheels.
WITH_GYRO = np.array([PLACED, PLACED, HEADED, BIAS, TURNED, ROLLED, 0.0])
BY_WHEELS = np.array([PLACED, PLACED, HEADED, 0.0, TURNED_BY_WHEELS, ROLLED, UNLIKE])
WAY = 5  # index of the distance among them
MOVED = 0.01  # rad, wheel angle from which a robot counts as moving: noise of encoders


@dataclass(frozen=True)
class Reckoned:
    """Place of a robot `seconds` after it was put down: x, y [m], theta [rad], and its uncertainty.

    `turned` [rad] and `way` [m] are the rotation and the distance since then. One standard deviation of each of k
    constants moves the place by `off` (k, 2) [m] and the heading by `heading` (k,) [rad].
    """

    place: tuple[float, float, float]
    seconds: float
    turned: float
    way: float
    deviations: Floats
    width: float
    off: Floats
    heading: Floats

    @property
    def doubt(self) -> float:
        """The largest plausible distance of the robot from its place [m]."""
        return float(_farthest(self.off[None])[0])

    def doubts(self, seconds: Floats, places: Floats) -> Floats:
        """Return the largest plausible distance of the robot from future `places` (n, 3) [m, m, rad], (n,) [m].

        It reaches them `seconds` (n,) from now.
        """
        time = np.concatenate([[0.0], seconds]) + self.seconds
        along = np.concatenate([[self.place], places])
        along[:, 2] = np.unwrap(along[:, 2])
        return _farthest(self._on(time, along)[0][1:])

    def moved(self, seconds: Floats, places: Floats) -> "Reckoned":
        """Return place and uncertainty at the last of `places` (n, 3), which the robot reached after `seconds`."""
        along = np.concatenate([[self.place], places])
        off, heading = self._on(np.concatenate([[self.seconds], seconds]), along)
        x, y, theta = places[-1].tolist()
        return replace(
            self,
            place=(x, y, theta),
            seconds=float(seconds[-1]),
            turned=self.turned + theta - self.place[2],
            way=self.way + float(np.sum(_forward(along))),
            off=off[-1],
            heading=heading[-1],
        )

    def _on(self, time: Floats, places: Floats) -> tuple[Floats, Floats]:
        """Return the shift of `places` (n, 3), the first the present one, by each constant: (n, k, 2), (n, k)."""
        step = np.diff(places[:, :2], axis=0)
        turned = self.turned + places[:, 2] - places[0, 2]
        way = self.way + np.concatenate([[0.0], np.cumsum(_forward(places))])
        heading = _of_heading(time, turned, way, self.width) * self.deviations
        heading += self.heading - heading[0]
        middle = 0.5 * (heading[1:] + heading[:-1])
        change = middle[:, :, None] * np.stack([-step[:, 1], step[:, 0]], axis=1)[:, None, :]
        change[:, WAY] += ROLLED * step
        return self.off + np.concatenate([np.zeros((1, *self.off.shape)), np.cumsum(change, axis=0)]), heading


def _forward(places: Floats) -> Floats:
    """Return the forward component [m] of each step between `places` (n, 3), (n - 1,)."""
    step, direction = np.diff(places[:, :2], axis=0), 0.5 * (places[1:, 2] + places[:-1, 2])
    return np.asarray(step[:, 0] * np.cos(direction) + step[:, 1] * np.sin(direction))


def _of_heading(time: Floats, turned: Floats, way: Floats, width: float) -> Floats:
    """Return the change of the heading by one unit of each constant, (n, k)."""
    none = np.zeros(len(time))
    return np.stack([none, none, none + 1.0, time, turned, none, way / width], axis=1)


def _farthest(off: Floats) -> Floats:
    """Return SURE standard deviations in the worst direction, (n,), of displacements (n, k, 2) by one each."""
    covariance = np.swapaxes(off, -1, -2) @ off
    return np.asarray(SURE * np.sqrt(np.maximum(np.linalg.eigvalsh(covariance)[:, -1], 0.0)))


def put_down(place: tuple[float, float, float], width: float, *, with_gyro: bool) -> Reckoned:
    """Return the place of a robot of this base width [m] that was put down at x, y [m], theta [rad]."""
    deviations = WITH_GYRO if with_gyro else BY_WHEELS
    off = np.zeros((len(deviations), 2))
    off[0, 0] = off[1, 1] = PLACED
    heading = np.zeros(len(deviations))
    heading[2] = HEADED
    return Reckoned(place, 0.0, 0.0, 0.0, deviations, width, off, heading)


def reckoned(recording: Recording, start: tuple[float, float, float], radius: float, width: float) -> Reckoned:
    """Return the place of a robot that was put down at `start` and at rest when its recording began.

    `radius` [m] is that of its wheels, `width` [m] that of its base, which gives the turns if no gyro was recorded.
    """
    down = put_down(start, width, with_gyro=len(recording.gyro) > 0)
    wheels, gyro = recording.wheels, recording.gyro
    if len(wheels) < 2:
        return down
    left, right = wheel_angles(wheels)
    seconds = (wheels.utime - wheels.utime[0]) * SECONDS
    heading = radius * (right - left) / width
    if len(gyro):
        time = (gyro.utime - wheels.utime[0]) * SECONDS
        moving = np.flatnonzero(np.abs(left) + np.abs(right) > MOVED)
        until = seconds[moving[0]] if len(moving) else seconds[-1]
        rest = gyro["yaw_rate"][time < until]
        rate = gyro["yaw_rate"] - (float(np.mean(rest)) if len(rest) else 0.0)
        turned = np.concatenate([[0.0], np.cumsum(0.5 * (rate[1:] + rate[:-1]) * np.diff(time))])
        heading = np.interp(seconds, time, turned)
    theta = start[2] + heading - heading[0]
    way = 0.5 * radius * np.diff(left + right)
    direction = 0.5 * (theta[1:] + theta[:-1])
    steps = way[:, None] * np.stack([np.cos(direction), np.sin(direction)], axis=1)
    places = np.column_stack([np.array(start[:2]) + np.cumsum(steps, axis=0), theta[1:]])
    return down.moved(seconds[1:], places)

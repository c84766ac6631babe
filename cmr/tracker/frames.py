"""What a tracker measured at one moment, and the poses of robots in the plane that follow from it."""

import math
from itertools import compress
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from cmr.tracker.profile import Profile

Floats: TypeAlias = NDArray[np.float64]
ZERO = 1e-6  # length of a quaternion that is none
TURN = 2.0 * math.pi  # rad
# Of the squares of a quaternion's x, y, z, w: their sum, the cosine of the tilt, that of the heading in the plane.
SUMS = np.array([[1.0, -1.0, 1.0], [1.0, -1.0, -1.0], [1.0, 1.0, -1.0], [1.0, 1.0, 1.0]])


class Sample(NamedTuple):
    """The bodies that a tracker saw at one moment; a body that it did not see is left out.

    `measured` and `sent` [s] are times of the tracker's own clock: of the exposure, and when the tracker had done with
    it; `measured` is None where it tells no time. `arrival` [ns] is of this host's monotonic clock. `positions` (n, 3)
    are in the tracker's axes and unit, `quaternions` (n, 4) are x, y, z, w. `origin` names the sender.
    """

    arrival: int
    measured: float | None
    sent: float | None
    names: tuple[str, ...]
    positions: Floats
    quaternions: Floats
    origin: str


class Planar(NamedTuple):
    """Where a robot's tracked point is [m, rad; world], as far as one sample tells."""

    robot_id: int
    x: float
    y: float
    theta: float


class Plane:
    """Makes poses of robots from samples. `wrong` holds the robots that a sample rules out, with the reason."""

    def __init__(self, profile: Profile) -> None:
        self.wrong: dict[int, str] = {}
        self._upright = math.cos(profile.limits.tilt)
        self._y_is_up = profile.tracker.up == "y"
        frame, metres = profile.frame, profile.tracker.metres
        c, s = math.cos(frame.theta), math.sin(frame.theta)
        flat = np.array([[c, s], [-s, c], [0.0, 0.0]]) * metres
        self._to_world = flat[[0, 2, 1]] * [[1.0], [1.0], [-1.0]] if self._y_is_up else flat
        self._origin = np.array([frame.x, frame.y])
        self._frame_theta = frame.theta
        self._robots = {carried.body: (robot_id, carried) for robot_id, carried in profile.robots.items()}
        self._choose(())

    def poses(self, sample: Sample) -> list[Planar]:
        """Return the robots in a sample whose poses are numbers, and which stand upright."""
        if sample.names != self._names:
            self._choose(sample.names)
        self.wrong = dict.fromkeys(self._twice, "two bodies have its name")
        if not self._ids:
            return []
        with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
            x, y, theta, upright = self._flattened(sample.positions[self._rows], sample.quaternions[self._rows])
        poses = list(map(Planar, self._ids, x.tolist(), y.tolist(), theta.tolist()))
        is_upright = upright >= self._upright  # not where it is NaN
        if is_upright.all():
            return poses
        for row in np.flatnonzero(~is_upright).tolist():
            self.wrong[self._ids[row]] = (
                "its body is tilted" if math.isfinite(upright[row]) else "its pose is no number"
            )
        return list(compress(poses, is_upright.tolist()))

    def _choose(self, names: tuple[str, ...]) -> None:
        """Note which rows of samples with these names are robots, and how the robots carry their bodies."""
        self._names = names
        rows = [row for row, name in enumerate(names) if name in self._robots]
        twice = {names[row] for row in rows if names.count(names[row]) > 1}
        rows = [row for row in rows if names[row] not in twice]
        chosen = [self._robots[names[row]] for row in rows]
        self._rows = np.array(rows, int)
        self._ids = [robot_id for robot_id, _ in chosen]
        self._carried = np.array([[one.x, one.y, one.theta] for _, one in chosen]).reshape(-1, 3).T
        self._twice = [self._robots[name][0] for name in twice]

    def _flattened(self, positions: Floats, quaternions: Floats) -> tuple[Floats, Floats, Floats, Floats]:
        """Return x, y, heading of robots in the world, and the cosines of their tilts; NaN where they are unknown.

        `positions` (n, 3) and `quaternions` (n, 4) are those of their bodies, in the tracker's axes and unit.
        """
        if self._y_is_up:  # a quarter turn about x, which brings y up
            quaternions = quaternions[:, [0, 2, 1, 3]] * [1.0, -1.0, 1.0, 1.0]
        size, up, ahead = ((quaternions * quaternions) @ SUMS).T
        qx, qy, qz, qw = quaternions.T
        body_x, body_y = (positions @ self._to_world + self._origin).T
        is_known = (size > ZERO) & np.isfinite(body_x + body_y)
        upright = np.where(is_known, up / size, np.nan)
        x, y, turn = self._carried
        heading = np.arctan2(2.0 * (qw * qz + qx * qy), ahead) + (self._frame_theta - turn)
        c, s = np.cos(heading), np.sin(heading)
        theta = heading - TURN * np.rint(heading / TURN)
        return body_x - c * x + s * y, body_y - s * x - c * y, theta, upright

"""What a tracker measured at one moment, and the poses of robots in the plane that follow from it."""

import math
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from cmr.tracker.profile import Carried, Frame, Profile

Floats: TypeAlias = NDArray[np.float64]
ZERO = 1e-6  # length of a quaternion that is none


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
        self._metres = profile.tracker.metres
        self._y_is_up = profile.tracker.up == "y"
        self._upright = math.cos(profile.limits.tilt)
        self._frame: Frame = profile.frame
        self._robots = {carried.body: (robot_id, carried) for robot_id, carried in profile.robots.items()}
        self._names: tuple[str, ...] = ()
        self._chosen: list[tuple[int, Carried]] = []
        self._rows = np.zeros(0, int)
        self._twice: list[int] = []

    def poses(self, sample: Sample) -> list[Planar]:
        """Return the robots in a sample whose poses are numbers, and which stand upright."""
        if sample.names != self._names:
            self._choose(sample.names)
        self.wrong = dict.fromkeys(self._twice, "two bodies have its name")
        if not self._chosen:
            return []
        x, y, theta, upright = self._flattened(sample.positions[self._rows], sample.quaternions[self._rows])
        poses = []
        for row, (robot_id, carried) in enumerate(self._chosen):
            if not upright[row] >= self._upright:  # NaN, too
                self.wrong[robot_id] = "its body is tilted" if math.isfinite(upright[row]) else "its pose is no number"
                continue
            heading = theta[row] - carried.theta
            c, s = math.cos(heading), math.sin(heading)
            poses.append(
                Planar(
                    robot_id,
                    x[row] - c * carried.x + s * carried.y,
                    y[row] - s * carried.x - c * carried.y,
                    math.remainder(heading, 2.0 * math.pi),
                )
            )
        return poses

    def _choose(self, names: tuple[str, ...]) -> None:
        """Note which rows of samples with these names are robots."""
        self._names = names
        rows = [row for row, name in enumerate(names) if name in self._robots]
        twice = {names[row] for row in rows if names.count(names[row]) > 1}
        rows = [row for row in rows if names[row] not in twice]
        self._rows = np.array(rows, int)
        self._chosen = [self._robots[names[row]] for row in rows]
        self._twice = [self._robots[name][0] for name in twice]

    def _flattened(
        self, positions: Floats, quaternions: Floats
    ) -> tuple[list[float], list[float], list[float], list[float]]:
        """Return x, y, heading of bodies in the world, and the cosines of their tilts; NaN where they are unknown."""
        px, py, pz = positions.T * self._metres
        qx, qy, qz, qw = quaternions.T
        if self._y_is_up:  # a quarter turn about x, which brings y up
            py, qy, qz = -pz, -qz, qy
        size = qx * qx + qy * qy + qz * qz + qw * qw
        with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
            upright = np.where(size > ZERO, (qw * qw + qz * qz - qx * qx - qy * qy) / size, np.nan)
            upright = np.where(np.isfinite(px + py), upright, np.nan)
            yaw = np.arctan2(2.0 * (qw * qz + qx * qy), qw * qw + qx * qx - qy * qy - qz * qz)
            c, s = math.cos(self._frame.theta), math.sin(self._frame.theta)
            x, y = self._frame.x + c * px - s * py, self._frame.y + s * px + c * py
        theta = yaw + self._frame.theta
        return x.tolist(), y.tolist(), theta.tolist(), upright.tolist()

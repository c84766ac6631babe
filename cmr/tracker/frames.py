"""What a tracker measured at one moment, and the poses of robots in the plane that follow from it."""

import math
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from cmr.tracker.profile import Profile

Floats: TypeAlias = NDArray[np.float64]
ZERO = 1e-6  # squared length of a quaternion that is none


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
    """Makes poses of robots from samples. `wrong` holds the robots that a sample rules out, with the reason.

    It computes without NumPy: between two frames other programs use the processor's caches, and afterwards some twenty
    small operations on arrays take longer than all of this for 50 bodies.
    """

    def __init__(self, profile: Profile) -> None:
        self.wrong: dict[int, str] = {}
        self._y_is_up = profile.tracker.up == "y"
        self._upright = math.cos(profile.limits.tilt)
        frame, metres = profile.frame, profile.tracker.metres
        self._origin = frame.x, frame.y
        self._axis = metres * math.cos(frame.theta), metres * math.sin(frame.theta)
        self._robots = {
            carried.body: _Placing(robot_id, carried.x, carried.y, frame.theta - carried.theta)
            for robot_id, carried in profile.robots.items()
        }
        self._choose(())

    def poses(self, sample: Sample) -> list[Planar]:
        """Return the robots in a sample whose poses are numbers, and which stand upright."""
        if sample.names != self._names:
            self._choose(sample.names)
        self.wrong = dict.fromkeys(self._twice, "two bodies have its name")
        positions, quaternions = sample.positions.tolist(), sample.quaternions.tolist()
        poses = []
        for row, placing in self._chosen:
            pose = self._placed(placing, positions[row], quaternions[row])
            if isinstance(pose, str):
                self.wrong[placing.robot_id] = pose
            else:
                poses.append(pose)
        return poses

    def _placed(self, placing: "_Placing", position: list[float], quaternion: list[float]) -> Planar | str:
        """Return where a robot is whose body is there; or why it is nowhere."""
        px, py, pz = position
        qx, qy, qz, qw = quaternion
        if self._y_is_up:  # a quarter turn about x, which brings y up
            py, qy, qz = -pz, -qz, qy
        size = qx * qx + qy * qy + qz * qz + qw * qw
        if not ZERO < size < math.inf or not math.isfinite(px + py):  # NaN, too
            return "its pose is no number"
        if qw * qw + qz * qz - qx * qx - qy * qy < self._upright * size:
            return "its body is tilted"
        heading = math.atan2(2.0 * (qw * qz + qx * qy), qw * qw + qx * qx - qy * qy - qz * qz) + placing.turn
        c, s = math.cos(heading), math.sin(heading)
        (frame_x, frame_y), (frame_c, frame_s) = self._origin, self._axis
        return Planar(
            placing.robot_id,
            frame_x + frame_c * px - frame_s * py - c * placing.x + s * placing.y,
            frame_y + frame_s * px + frame_c * py - s * placing.x - c * placing.y,
            math.remainder(heading, 2.0 * math.pi),
        )

    def _choose(self, names: tuple[str, ...]) -> None:
        """Note which rows of samples with these names are robots."""
        self._names = names
        rows = [row for row, name in enumerate(names) if name in self._robots]
        twice = {names[row] for row in rows if names.count(names[row]) > 1}
        self._chosen = [(row, self._robots[names[row]]) for row in rows if names[row] not in twice]
        self._twice = [self._robots[name].robot_id for name in twice]


class _Placing(NamedTuple):
    """A robot, where on it its body is [m], and what is added to the heading of that [rad]."""

    robot_id: int
    x: float
    y: float
    turn: float

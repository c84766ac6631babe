"""Measurements of a tracker at one time, and the planar poses of robots that follow from them."""

import math
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from cmr.tracker.profile import Profile

Floats: TypeAlias = NDArray[np.float64]
ZERO = 1e-6  # largest squared norm of an invalid quaternion


class Sample(NamedTuple):
    """The bodies that a tracker saw at one time; others are left out.

    `measured` and `sent` [s] are times of the tracker's own clock: of the exposure, and of the end of processing;
    `measured` is None if the tracker sends no time. `arrival` [ns] is of this host's monotonic clock. `positions` (n,
    3) are in the tracker's axes and unit, `quaternions` (n, 4) are x, y, z, w. `origin` names the sender.
    """

    arrival: int
    measured: float | None
    sent: float | None
    names: tuple[str, ...]
    positions: Floats
    quaternions: Floats
    origin: str


class Planar(NamedTuple):
    """Pose of a robot's tracked point [m, rad; world] according to one sample."""

    robot_id: int
    x: float
    y: float
    theta: float


class Plane:
    """Converts samples to poses of robots. `wrong` holds the robots whose pose in a sample is invalid, with the reason.

    It computes without NumPy: between two frames, other programs evict the processor's caches, and afterwards some
    twenty small array operations take longer than all of this for 50 bodies.
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
        """Return the robots in a sample whose poses are valid numbers, and which stand upright."""
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
        """Return the pose of a robot from that of its body, or the reason why it is invalid."""
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
        """Store which rows of samples with these names are robots."""
        self._names = names
        rows = [row for row, name in enumerate(names) if name in self._robots]
        twice = {names[row] for row in rows if names.count(names[row]) > 1}
        self._chosen = [(row, self._robots[names[row]]) for row in rows if names[row] not in twice]
        self._twice = [self._robots[name].robot_id for name in twice]


class _Placing(NamedTuple):
    """A robot, the position of its body on it [m], and the offset of its heading [rad]."""

    robot_id: int
    x: float
    y: float
    turn: float

"""Poses of all robots as arrays: from WORLD_STATE, or other channels for robots without a simulator."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cmr.bus.state_table import StateTable
from cmr.msg import pose_xyt_t, robot_state_t, world_state_t

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
REAL, VIRTUAL, TWIN = robot_state_t.REAL, robot_state_t.VIRTUAL, robot_state_t.TWIN
SILENT_AFTER = 1_000_000  # us without a message about a robot; five periods of POSE, the slowest source, are that long
# us after its last message for which a robot is shown, and its signals are offered: a radio that roams and a restarted
# process are silent for some seconds; older positions are useless.
GONE_AFTER = 5_000_000
PREFERENCE = 500_000  # us for which a better source of a robot's pose suppresses others
WORLD, ESTIMATE, MEASURED = 0, 1, 2  # sources: WORLD_STATE, ROBOT_STATE_N, POSE_N; lower is better
SOURCE = 5  # row of the source in the table, after x, y, theta, psi_left and psi_right


class Robots(NamedTuple):
    """Robots at one moment; entry i of every array belongs to the same robot.

    `pose` (3, n): x, y [m], theta [rad; world frame]. `wheels` (2, n): psi of left and right [rad/s]. `silent` (n):
    whether it has had no message for SILENT_AFTER.
    """

    robot_id: Integers
    origin: Integers
    pose: Floats
    wheels: Floats
    silent: NDArray[np.bool_]

    def fresh(self) -> "Robots":
        """Return only those with recent messages."""
        return self._chosen(~self.silent)

    def of(self, origin: int) -> "Robots":
        """Return only those of this origin."""
        return self._chosen(self.origin == origin)

    def with_twins(self) -> tuple["Robots", "Robots"]:
        """Return the real robots that have twins, and their twins, both ordered by id."""
        real, twins = np.flatnonzero(self.origin == REAL), np.flatnonzero(self.origin == TWIN)
        ids = self.robot_id[real], self.robot_id[twins]
        _, first, second = np.intersect1d(*ids, assume_unique=True, return_indices=True)
        return self._chosen(real[first]), self._chosen(twins[second])

    def _chosen(self, chosen: "NDArray[np.bool_] | Integers") -> "Robots":
        return Robots(
            *(self.robot_id[chosen], self.origin[chosen], self.pose[:, chosen], self.wheels[:, chosen]),
            self.silent[chosen],
        )

    def place(self, robot_id: int) -> tuple[float, float, float] | None:
        """Return the pose of a robot that is no twin; None if it is not there."""
        found = np.flatnonzero((self.robot_id == robot_id) & (self.origin != TWIN))
        if not len(found):
            return None
        x, y, theta = self.pose[:, found[0]].tolist()
        return x, y, theta


class RobotTable:
    """The last known state of every robot, and its source."""

    def __init__(self) -> None:
        self._table = StateTable(SOURCE + 1)

    def take_world(self, utime: int, message: world_state_t) -> None:
        """Handle a WORLD_STATE, or a part of one, received at `utime` [us]."""
        table = self._table
        rows = table.rows(np.asarray(message.robot_id, np.int64), np.asarray(message.origin, np.int64))
        columns = (message.x, message.y, message.theta, message.psi_left, message.psi_right)
        table.state[:SOURCE, rows] = columns
        table.state[SOURCE, rows] = WORLD
        table.utime[rows] = utime

    def take_state(self, utime: int, message: robot_state_t) -> None:
        """Take a ROBOT_STATE_N; used if no WORLD_STATE has the robot."""
        state = (message.x, message.y, message.theta, message.psi_left, message.psi_right)
        self._take_one(utime, message.robot_id, message.origin, state, ESTIMATE)

    def take_pose(self, utime: int, message: pose_xyt_t) -> None:
        """Take a POSE_N of a real robot; used if nobody estimates its state."""
        state = (message.x, message.y, message.theta, np.nan, np.nan)
        self._take_one(utime, message.robot_id, REAL, state, MEASURED)

    def present(self, now: int) -> Robots:
        """Return the robots that are still present, in order of first appearance."""
        table = self._table
        age = np.abs(now - table.utime)
        rows = np.flatnonzero((age <= GONE_AFTER) & np.isfinite(table.state[:3]).all(axis=0))
        pose, wheels = table.state[:3, rows], table.state[3:SOURCE, rows]
        return Robots(table.robot_id[rows], table.origin[rows], pose, wheels, age[rows] > SILENT_AFTER)

    def _take_one(self, utime: int, robot_id: int, origin: int, state: tuple[float, ...], source: int) -> None:
        table = self._table
        row = table.row(robot_id, origin)
        if table.state[SOURCE, row] < source and abs(utime - int(table.utime[row])) <= PREFERENCE:
            return
        table.state[:, row] = (*state, source)
        table.utime[row] = utime

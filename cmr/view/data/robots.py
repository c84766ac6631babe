"""Where all robots are, as arrays: from WORLD_STATE, and for those whom no simulator knows from other channels."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cmr.msg import pose_xyt_t, robot_state_t, world_state_t

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
REAL, VIRTUAL, TWIN = robot_state_t.REAL, robot_state_t.VIRTUAL, robot_state_t.TWIN
SILENT_AFTER = 1_000_000  # us without a message about a robot; five periods of POSE, the slowest source, are that long
# us after its last message for which a robot is shown, and its signals are offered: radio that changes its station and
# a process that is started again are quiet for some seconds; what is older is no place to expect a robot at.
GONE_AFTER = 5_000_000
PREFERENCE = 500_000  # us for which a better source of a robot's pose keeps the others away
MOST_PARTS_REMEMBERED = 100  # sets of robots whose rows are not looked for again
WORLD, ESTIMATE, MEASURED = 0, 1, 2  # sources: WORLD_STATE, ROBOT_STATE_N, POSE_N; the lesser is the better


class Robots(NamedTuple):
    """Robots at one moment; entry i of every array belongs to the same robot.

    `pose` (3, n): x, y [m], theta [rad; world frame]. `wheels` (2, n): psi of left and right [rad/s]. `silent` (n):
    whether nothing has been heard about it for SILENT_AFTER.
    """

    robot_id: Integers
    origin: Integers
    pose: Floats
    wheels: Floats
    silent: NDArray[np.bool_]

    def fresh(self) -> "Robots":
        """Return only those about which something was heard lately."""
        return self._chosen(~self.silent)

    def of(self, origin: int) -> "Robots":
        """Return only those of this origin."""
        return self._chosen(self.origin == origin)

    def with_twins(self) -> tuple["Robots", "Robots"]:
        """Return the real robots that have twins, and their twins, both in the order of their ids."""
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
    """The last known state of every robot; a row each, found by id and origin."""

    def __init__(self) -> None:
        self._row_of: dict[tuple[int, int], int] = {}
        self._rows_of: dict[bytes, Integers] = {}
        self._ids = np.empty((2, 0), np.int64)
        self._states = np.empty((5, 0))
        self._heard = np.empty(0, np.int64)
        self._source = np.empty(0, np.int64)

    def take_world(self, utime: int, message: world_state_t) -> None:
        """Take a WORLD_STATE, or a part of one, that came at `utime` [us]."""
        ids, origins = np.asarray(message.robot_id, np.int64), np.asarray(message.origin, np.int64)
        rows = self._rows(ids, origins)
        columns = (message.x, message.y, message.theta, message.psi_left, message.psi_right)
        self._states[:, rows] = columns
        self._heard[rows] = utime
        self._source[rows] = WORLD

    def take_state(self, utime: int, message: robot_state_t) -> None:
        """Take a ROBOT_STATE_N; it counts where no WORLD_STATE has the robot."""
        state = (message.x, message.y, message.theta, message.psi_left, message.psi_right)
        self._take_one(utime, message.robot_id, message.origin, state, ESTIMATE)

    def take_pose(self, utime: int, message: pose_xyt_t) -> None:
        """Take a POSE_N of a real robot; it counts where nobody estimates its state."""
        state = (message.x, message.y, message.theta, np.nan, np.nan)
        self._take_one(utime, message.robot_id, REAL, state, MEASURED)

    def present(self, now: int) -> Robots:
        """Return those who have not left, in the order in which they came to be known."""
        age = np.abs(now - self._heard)
        rows = np.flatnonzero((age <= GONE_AFTER) & np.isfinite(self._states[:3]).all(axis=0))
        ids, origins = self._ids[:, rows]
        return Robots(ids, origins, self._states[:3, rows], self._states[3:, rows], age[rows] > SILENT_AFTER)

    def _take_one(self, utime: int, robot_id: int, origin: int, state: tuple[float, ...], source: int) -> None:
        row = self._row(robot_id, origin)
        if self._source[row] < source and abs(utime - int(self._heard[row])) <= PREFERENCE:
            return
        self._states[:, row] = state
        self._heard[row] = utime
        self._source[row] = source

    def _rows(self, ids: Integers, origins: Integers) -> Integers:
        """Return the rows of these robots; those of a set that came before are remembered."""
        key = ids.tobytes() + origins.tobytes()
        rows = self._rows_of.get(key)
        if rows is None:
            if len(self._rows_of) >= MOST_PARTS_REMEMBERED:
                self._rows_of.clear()
            pairs = zip(ids.tolist(), origins.tolist(), strict=True)
            rows = self._rows_of[key] = np.array([self._row(*pair) for pair in pairs], np.int64)
        return rows

    def _row(self, robot_id: int, origin: int) -> int:
        row = self._row_of.setdefault((robot_id, origin), len(self._row_of))
        if row == len(self._heard):
            more = max(64, row)
            never = np.full(more, -(2**62))
            self._ids = np.hstack([self._ids, np.zeros((2, more), np.int64)])
            self._states = np.hstack([self._states, np.full((5, more), np.nan)])
            self._heard = np.concatenate([self._heard, never])
            self._source = np.concatenate([self._source, np.full(more, MEASURED)])
        self._ids[:, row] = robot_id, origin
        return row

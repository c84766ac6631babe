"""The latest state of every known robot: a table with one row per id and origin."""

from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

Integers: TypeAlias = NDArray[np.int64]
Floats: TypeAlias = NDArray[np.float64]

NEVER = -(2**62)  # us; stamp of a new row, before its first state
FIRST_ROOM = 64  # initial number of rows; doubled when full
MOST_SETS_REMEMBERED = 100  # sets of robots whose row numbers are cached


class StateTable:
    """Rows of robots, in the order in which they were first asked for; a robot keeps its row.

    `robot_id`, `origin` and `utime` [us], shape (room,), and `state`, shape (quantities, room), have an entry for each
    row; the caller writes to them. New rows have `utime` NEVER and a state of NaN.
    """

    def __init__(self, quantities: int) -> None:
        self.robot_id: Integers = np.zeros(0, np.int64)
        self.origin: Integers = np.zeros(0, np.int64)
        self.utime: Integers = np.zeros(0, np.int64)
        self.state: Floats = np.zeros((quantities, 0))
        self._row_of: dict[tuple[int, int], int] = {}
        self._rows_of: dict[bytes, Integers] = {}

    def row(self, robot_id: int, origin: int) -> int:
        """Return the row of a robot, adding one if needed."""
        row = self._row_of.setdefault((robot_id, origin), len(self._row_of))
        if row == len(self.utime):
            self._make_room(max(FIRST_ROOM, row))
        self.robot_id[row], self.origin[row] = robot_id, origin
        return row

    def rows(self, robot_id: Integers, origin: Integers) -> Integers:
        """Return the rows of robots, shape (n,); known sets of robots are cached."""
        key = robot_id.tobytes() + origin.tobytes()
        rows = self._rows_of.get(key)
        if rows is None:
            if len(self._rows_of) >= MOST_SETS_REMEMBERED:
                self._rows_of.clear()
            pairs = zip(robot_id.tolist(), origin.tolist(), strict=True)
            rows = self._rows_of[key] = np.array([self.row(*pair) for pair in pairs], np.int64)
        return rows

    def _make_room(self, more: int) -> None:
        self.robot_id = np.append(self.robot_id, np.zeros(more, np.int64))
        self.origin = np.append(self.origin, np.zeros(more, np.int64))
        self.utime = np.append(self.utime, np.full(more, NEVER))
        self.state = np.hstack([self.state, np.full((len(self.state), more), np.nan)])

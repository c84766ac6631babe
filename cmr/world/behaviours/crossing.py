"""Decide whose turn it is at a crossing, from the positions and headings of all robots.

Around the middle is a core, where paths cross, surrounded by a ring. One robot at a time may cross the line into the
ring. Should two enter it at once, because they see the world at different times (a pilot's is some hundredths of a
second old), the one with the lower id continues into the core and the other waits until it has left. All robots agree
on ids, so there are no collisions and no deadlocks.
"""

import math
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from cmr.world.behaviours.team import Floats, Indices
from cmr.world.lazy_module import LazyModule
from cmr.world.surroundings import Surroundings

crossing_loops = LazyModule("cmr.world.behaviours.crossing_loops")
RING = 0.3  # m; wide enough that everybody has seen a robot in it before it reaches the core
SMALLEST_ZONE = 0.5  # m
BAND = 0.25  # m before the line: there is room for one robot of each direction, and it is the next to go
STOP_SHORT = 0.06  # m before a line; motors react with a delay
REACTION = 0.2  # s until a robot follows its command
TOWARDS = 0.5  # cosine: a robot driven by others counts as heading for the middle if it faces it within 60 degrees
RIGHT = 0.5  # cosine of the half-angle around the right-hand side from which robots have priority
TURN = 5_000_000  # us; a robot that does not use its turn for this long goes to the end of the queue
PATIENCE = 15_000_000  # us; a robot that has waited longer goes before those on its right
NOBODY = -1

Waiting: TypeAlias = tuple[int, float, float]  # id of a waiting robot, and its position relative to the middle [m]


class Crossing:
    """A crossing about (at_x, at_y) [m] with its line `zone` [m] from there; it remembers when each robot arrived."""

    def __init__(self, at_x: float, at_y: float, zone: float, *, by_right: bool) -> None:
        self.at_x, self.at_y, self.zone, self.core = at_x, at_y, zone, zone - RING
        self._by_right = by_right
        self._came: dict[int, int] = {}  # waiting robots: since when [us]
        self._turn = (NOBODY, 0)  # whose turn it is, and since when [us]
        self._index: Indices | None = None
        self._number: Indices = np.zeros(0, np.int64)

    def free_for(self, utime: int, around: Surroundings, index: Indices, inward: NDArray[np.bool_]) -> tuple[int, int]:
        """Return the ids of the robots that may cross the line and that may enter the core; NOBODY if none may.

        `index` are the indices of our robots among all, `inward` says which of them head for the middle; for other
        robots this is inferred from their headings.
        """
        near = crossing_loops.near_to(self.at_x, self.at_y, self.zone + BAND, around.x, around.y)
        number = self._numbers(index, len(around.x))
        core, ring, waiting = 0, [], []
        of_all = (around.members.robot_id, around.x, around.y, around.theta, number)
        for robot_id, x, y, theta, ours in zip(*(column[near].tolist() for column in of_all), strict=True):
            away = math.hypot(x - self.at_x, y - self.at_y)
            towards = math.cos(theta) * (self.at_x - x) + math.sin(theta) * (self.at_y - y)
            if away < self.core:
                core += 1
            elif inward[ours] if ours >= 0 else towards > TOWARDS * away:
                if away < self.zone:
                    ring.append(robot_id)
                else:
                    waiting.append((robot_id, x - self.at_x, y - self.at_y))
        next_in = self._next(utime, waiting, taken=bool(core or ring))
        into_core = min(ring) if ring and not core else NOBODY
        return NOBODY if core or ring else next_in, into_core

    def _numbers(self, index: Indices, everybody: int) -> Indices:
        """Return for each robot its number among ours, -1 if it is not ours; the result is cached while `index` is the
        same object.
        """
        if index is not self._index:
            self._index, self._number = index, np.full(everybody, -1)
            ours = np.flatnonzero(index >= 0)
            self._number[index[ours]] = ours
        return self._number

    def wait(
        self,
        robot_id: Indices,
        x: Floats,
        y: Floats,
        inward: NDArray[np.bool_],
        free: tuple[int, int],
        braking: float,
        speed: Floats,
    ) -> None:
        """Lower the speeds [m/s] of robots at (x, y) [m] so that they can stop before a zone closed to them."""
        here = (self.at_x, self.at_y, self.zone, self.core)
        crossing_loops.wait_before(*here, *free, STOP_SHORT, REACTION, braking, robot_id, x, y, inward, speed)

    def _next(self, utime: int, waiting: list[Waiting], *, taken: bool) -> int:
        """Return the waiting robot whose turn it is; while the crossing is occupied, no turn ends."""
        self._came = {robot_id: min(self._came.get(robot_id, utime), utime) for robot_id, _, _ in waiting}
        if not waiting:
            return NOBODY
        chosen = self._in_order(utime, waiting)
        if taken or chosen != self._turn[0]:
            self._turn = (chosen, utime)
        elif abs(utime - self._turn[1]) > TURN:
            self._came[chosen] = utime
            others = [one for one in waiting if one[0] != chosen]
            if others:
                chosen = self._in_order(utime, others)
            self._turn = (chosen, utime)
        return chosen

    def _in_order(self, utime: int, waiting: list[Waiting]) -> int:
        """Return the robot that goes first by the rule."""
        robot_ids = [robot_id for robot_id, _, _ in waiting]
        first = min(robot_ids, key=lambda robot_id: (self._came[robot_id], robot_id))
        if not self._by_right or utime - self._came[first] > PATIENCE:
            return first
        # The right of a robot that comes from (x, y) is (-y, x): a quarter turn, since the heading is (-x, -y).
        _, x, y = np.array(waiting).T
        away = np.hypot(x, y)
        from_right = np.greater(np.outer(-y, x) + np.outer(x, y), RIGHT * np.outer(away, away))
        blocked = from_right.any(axis=1).tolist()
        free = [robot_id for robot_id, waits in zip(robot_ids, blocked, strict=True) if not waits]
        return min(free or robot_ids, key=lambda robot_id: (self._came[robot_id], robot_id) if free else (0, robot_id))

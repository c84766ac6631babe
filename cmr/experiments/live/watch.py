"""Measurements of a team while it drives: positions, distances, closest approach, waypoints, health of processes.

It is independent of the bus: messages go in by `handle`.
"""

import math
import socket
from collections import deque
from typing import ClassVar, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from cmr.bus.channel_statistics import per_second
from cmr.bus.message import Message
from cmr.bus.possible import screened
from cmr.bus.senders import keep
from cmr.bus.streams import PROCESS_STATUS, WORLD_STATE
from cmr.experiments.live.track import Track
from cmr.experiments.team.metrics import passed
from cmr.experiments.team.plan import Scenario
from cmr.geometry.places import Point, Pose
from cmr.msg import process_status_t, world_state_t
from cmr.world.view import OLDEST, TWIN

Floats: TypeAlias = NDArray[np.float64]

LOOK_PERIOD = 100_000  # us between evaluations of positions, and initially between stored positions
JITTER = 0.02  # m; smaller movements are noise of the estimate
STANDING = 0.2  # rad/s; a slower wheel rests


class Nearest(NamedTuple):
    """The closest approach of two robots [m], centre to centre, and which; `utime` 0: none yet."""

    distance: float = math.inf
    robots: tuple[int, int] = (0, 0)
    utime: int = 0


class TeamWatch:
    """Tracks the robots of a scenario.

    Arrays have one element for each robot, in the order of `ids`. `x`, `y` [m] are NaN before a robot is seen.
    """

    MEASURED: ClassVar = ("minimum_separation", "distance_driven", "time_to_goal")  # continuously updated metrics

    def __init__(self, scenario: Scenario) -> None:
        self.ids = np.array(sorted(robot.robot_id for robot in scenario.robots), dtype=np.int64)
        count = len(self.ids)
        self.x, self.y, self.theta = (np.full(count, np.nan) for _ in range(3))
        self.moving = np.zeros(count, dtype=bool)
        self.seen = np.zeros(count, dtype=np.int64)  # us
        self.distance = np.zeros(count)  # m driven
        self.nearest = Nearest()
        self.utime = 0
        self.first_utime = 0  # when all were ready; 0: not yet
        self.worlds = 0  # number of received world states, since all were ready if they are
        self._late_before: dict[int, int] = {}  # late cycles of each process until then, by pid
        self._fastest: dict[int, float] = {}  # highest rate of each process's loop [Hz], by pid
        self._world_utimes: deque[int] = deque(maxlen=100)
        self._looked = 0  # us; last evaluation of positions
        self.track = Track(count, LOOK_PERIOD)
        self.statuses: dict[int, process_status_t] = {}  # the last of each process here, by pid
        self.statuses_elsewhere: dict[tuple[str, int], process_status_t] = {}  # elsewhere: by host and pid
        self._host = socket.gethostname()
        self._goals = {robot.robot_id: robot.waypoints for robot in scenario.robots if robot.waypoints}
        self._next = dict.fromkeys(self._goals, 0)
        self.reached_utime: dict[int, int] = {}  # when a robot reached its last waypoint
        self._anchor = np.full((2, count), np.nan)

    def handle(self, utime: int, channel: str, message: Message) -> None:
        """Handle WORLD_STATE or PROCESS_STATUS; impossible numbers are ignored."""
        usable = screened(message).message
        if channel == WORLD_STATE.name and isinstance(usable, world_state_t):
            self._take_world(utime, usable)
        elif channel == PROCESS_STATUS.name and isinstance(usable, process_status_t):
            if usable.host == self._host:
                self._take_status(usable)
            else:
                keep(self.statuses_elsewhere, (usable.host, usable.pid), usable)

    def missing(self) -> list[int]:
        """Return the robots that are not in the world."""
        gone = (self.seen == 0) | (self.utime - self.seen > OLDEST)
        return [int(robot_id) for robot_id in self.ids[gone]]

    def poses(self) -> dict[int, Pose]:
        """Return the last known pose of each robot."""
        return {robot_id: self.pose(robot_id) for robot_id in self.ids[self.seen > 0].tolist()}

    def pose(self, robot_id: int) -> Pose:
        """Return the last known pose of a robot."""
        k = int(np.searchsorted(self.ids, robot_id))
        return Pose(float(self.x[k]), float(self.y[k]), float(self.theta[k]))

    def remaining_waypoints(self) -> dict[int, tuple[Point, ...]]:
        """Return the remaining waypoints, by robot id."""
        return {robot_id: goals[self._next[robot_id] :] for robot_id, goals in self._goals.items()}

    @property
    def waypoints_reached(self) -> bool:
        """Whether every robot with waypoints has reached the last one."""
        return all(self._next[robot_id] == len(goals) for robot_id, goals in self._goals.items())

    def measure(self, metric: str) -> float:
        """Return the current value of one of MEASURED, in its unit of `cmr.experiments.team.metrics`."""
        if metric == "time_to_goal":
            return self._time_to_goal()
        return {"minimum_separation": self.nearest.distance, "distance_driven": float(self.distance.mean())}[metric]

    def _time_to_goal(self) -> float:
        """Return the time [s] from when all were ready until the last robot had passed its waypoints, or until now.

        NaN if no robot has any, or not all were ready yet.
        """
        if not (self.first_utime and self._goals):
            return math.nan
        last = max(self.reached_utime.values()) if self.waypoints_reached else self._looked
        return max(last - self.first_utime, 0) * 1e-6

    def rate(self) -> float:
        """Return the recent publishing rate of the world [Hz]."""
        span = self._world_utimes[-1] - self._world_utimes[0] if len(self._world_utimes) > 1 else 0
        return per_second(len(self._world_utimes) - 1, span) if span > 0 else 0.0

    def begin(self) -> None:
        """Start measuring: before this, robots only started up and waited."""
        self.first_utime, self.worlds = self.utime, 0
        self.distance[:] = 0.0
        self.nearest = Nearest()
        self._late_before = {pid: int(status.loop_overruns) for pid, status in self.statuses.items()}

    def late_turns(self, pid: int) -> int | None:
        """Return the number of late loop cycles of a process; None if it was never received."""
        status = self.statuses.get(pid)
        return None if status is None else int(status.loop_overruns) - self._late_before.get(pid, 0)

    def loop_rate(self, pid: int) -> float:
        """Return the highest rate [Hz] of a process's loop; 0 if it was never received."""
        return self._fastest.get(pid, 0.0)

    @property
    def overruns(self) -> int:
        """The number of late loop cycles of all processes."""
        return sum(self.late_turns(pid) or 0 for pid in self.statuses)

    def is_degraded(self, pid: int) -> bool:
        """Return whether the last report of a process was DEGRADED."""
        status = self.statuses.get(pid)
        return status is not None and status.state == process_status_t.DEGRADED

    def _take_status(self, status: process_status_t) -> None:
        keep(self.statuses, status.pid, status)
        if status.state != process_status_t.STOPPING:  # the last rate is instantaneous
            keep(self._fastest, status.pid, max(self.loop_rate(status.pid), float(status.loop_rate_hz)))

    def _take_world(self, utime: int, message: world_state_t) -> None:
        ids = np.asarray(message.robot_id, dtype=np.int64)
        places = np.searchsorted(self.ids, ids).clip(max=len(self.ids) - 1)
        known = (self.ids[places] == ids) & (np.asarray(message.origin) != TWIN)
        places = places[known]
        for column, values in ((self.x, message.x), (self.y, message.y), (self.theta, message.theta)):
            column[places] = np.asarray(values)[known]
        wheels = np.abs(np.asarray([message.psi_left, message.psi_right]))
        self.moving[places] = (wheels.max(axis=0) > STANDING)[known]
        self.seen[places] = utime
        if utime > self.utime:
            self.utime = utime
            self.worlds += 1
            self._world_utimes.append(utime)
        if utime - self._looked >= LOOK_PERIOD:
            self._look(utime)

    def _look(self, utime: int) -> None:
        """Update the measurements since the last call."""
        self._looked = utime
        present = (self.seen > 0) & (utime - self.seen <= OLDEST)
        places = np.where(present, [self.x, self.y], np.nan)
        self.track.add(utime, places)
        self._add_distances(places)
        self._note_nearest(places, np.flatnonzero(present), utime)
        self._note_goals(places, utime)

    def _add_distances(self, places: Floats) -> None:
        step = np.hypot(*(places - self._anchor))
        fresh = np.isnan(self._anchor[0])
        self.distance += np.where(step > JITTER, step, 0.0)
        moved = fresh | (step > JITTER)
        self._anchor[:, moved] = places[:, moved]

    def _note_nearest(self, places: Floats, present: NDArray[np.intp], utime: int) -> None:
        if len(present) < 2:
            return
        from scipy.spatial import cKDTree

        distances, neighbours = cKDTree(places[:, present].T).query(places[:, present].T, k=2)
        own = int(np.argmin(distances[:, 1]))
        if distances[own, 1] < self.nearest.distance:
            pair = sorted(int(self.ids[present[k]]) for k in (own, neighbours[own, 1]))
            self.nearest = Nearest(float(distances[own, 1]), (pair[0], pair[1]), utime)

    def _note_goals(self, places: Floats, utime: int) -> None:
        for robot_id, goals in self._goals.items():
            x, y = places[:, int(np.searchsorted(self.ids, robot_id))].tolist()
            count = passed(x, y, goals, self._next[robot_id])
            if count == len(goals):
                self.reached_utime.setdefault(robot_id, utime)
            self._next[robot_id] = count

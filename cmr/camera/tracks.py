"""Tracks of the world's robots, for drawing them at the time of a picture."""

import math
from bisect import bisect_right
from collections import deque
from typing import NamedTuple

from cmr.camera.lens import Floats
from cmr.msg import robot_state_t, world_state_t

REAL: int = robot_state_t.REAL
VIRTUAL: int = robot_state_t.VIRTUAL
SILENT = 1_000_000  # us without a state after which a robot is no longer shown
AHEAD = 100_000  # us by which the newest state may be older than the picture; it is extrapolated at its speed


class Shown(NamedTuple):
    """A robot at the time of a picture [m, rad; world], and its earlier positions, oldest first."""

    robot_id: int
    x: float
    y: float
    theta: float
    trail: list[tuple[float, float]]


class Track:
    """The states of one robot over the last seconds: utime [us], x, y [m], theta [rad]."""

    def __init__(self, robot_id: int, origin: int) -> None:
        self.robot_id, self.origin = robot_id, origin
        self.states: deque[tuple[int, float, float, float]] = deque()

    def at(self, utime: int, trail: int) -> Shown:
        """Return the robot at this time, with a trail of this duration [us]."""
        states = self.states
        after = bisect_right([state[0] for state in states], utime)
        first, second = max(after - 1, 0), min(max(after, 1), len(states) - 1)
        if after == len(states) and after > 1:  # the picture is newer than all: extrapolate from the last two
            first, second = after - 2, after - 1
        (t0, x0, y0, theta0), (t1, x1, y1, theta1) = states[first], states[second]
        share = (min(utime, states[-1][0] + AHEAD) - t0) / (t1 - t0) if t1 > t0 else 0.0
        share = max(share, 0.0)
        x, y = x0 + share * (x1 - x0), y0 + share * (y1 - y0)
        theta = theta0 + share * math.remainder(theta1 - theta0, 2.0 * math.pi)
        since = utime - trail
        before = [(state[1], state[2]) for state in states if since <= state[0] <= utime]
        return Shown(self.robot_id, x, y, theta, [*before, (x, y)])


class Tracks:
    """All real and virtual robots, from WORLD_STATE messages; twins are left out. `trail` [us] is the history kept."""

    def __init__(self, trail: int) -> None:
        self.trail = trail
        self._tracks: dict[tuple[int, int], Track] = {}

    def handle(self, utime: int, message: world_state_t) -> None:
        """Add a world_state_t, which holds the whole world or part of it."""
        columns: list[Floats] = [getattr(message, name) for name in ("robot_id", "origin", "x", "y", "theta")]
        for robot_id, origin, x, y, theta in zip(*(list(map(float, column)) for column in columns), strict=True):
            key = (int(robot_id), int(origin))
            if key[1] not in (REAL, VIRTUAL) or not math.isfinite(x + y + theta):
                continue
            states = self._tracks.setdefault(key, Track(*key)).states
            if states and utime <= states[-1][0]:
                if states[-1][0] - utime < SILENT:
                    continue  # late, or received twice
                states.clear()  # a clock was set back
            states.append((utime, x, y, theta))
            while states[0][0] < utime - max(self.trail, SILENT):
                states.popleft()

    def at(self, utime: int, origin: int) -> list[Shown]:
        """Return the robots of an origin, REAL or VIRTUAL, at the time of a picture."""
        self._tracks = {
            key: track for key, track in self._tracks.items() if utime - track.states[-1][0] <= max(self.trail, SILENT)
        }
        return [
            track.at(utime, self.trail)
            for track in self._tracks.values()
            if track.origin == origin and abs(utime - track.states[-1][0]) <= SILENT
        ]

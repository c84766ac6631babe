"""A team in which everybody keeps company with whoever is nearest."""

import numpy as np

from cmr.world.behaviours import TeamBehaviour


class Company(TeamBehaviour):
    """Drive to the nearest robot, real or virtual, and stop `gap` [m] before it, with at most `duty`."""

    def __init__(self, gap: float = 0.5, duty: float = 0.2) -> None:
        self.gap, self.duty = gap, duty

    def commands(self, _utime, me, world, _parameters):
        """Return left and right duties, (n, 2), of the n robots `me`."""
        everybody = world.surroundings()
        duties = np.zeros((len(me.robot_id), 2))
        if len(everybody.x) < 2:
            return duties  # alone: stand
        dx = everybody.x - me.state.x[:, np.newaxis]
        dy = everybody.y - me.state.y[:, np.newaxis]
        away = np.hypot(dx, dy)
        away[everybody.members.robot_id == np.array(me.robot_id)[:, np.newaxis]] = np.inf
        robot, nearest = np.arange(len(duties)), away.argmin(axis=1)
        bearing = np.arctan2(dy[robot, nearest], dx[robot, nearest]) - me.state.theta
        forward = self.duty * np.cos(bearing) * (away[robot, nearest] > self.gap)
        turn = 0.3 * self.duty * np.sin(bearing)
        return np.stack([forward - turn, forward + turn], axis=1)

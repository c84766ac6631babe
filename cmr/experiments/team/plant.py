"""The real robots of a team: several of `cmr.plant`, with their encoder counts."""

import math
from collections.abc import Sequence
from random import Random

import numpy as np
from numpy.typing import NDArray

from cmr.experiments.team.hidden import HiddenRobot
from cmr.plant.commanded import CommandedRobot
from cmr.plant.running import PLACES, RunningRobot

Floats = NDArray[np.float64]
POSE = [PLACES[name] for name in ("x", "y", "theta")]
TURNED = [PLACES[name] for name in ("phi_left", "phi_right")]


class Plant:
    """Real robots, from rest at `poses`, (3, n) [m, m, rad]; each has random numbers of its own, fixed by its seed."""

    def __init__(self, robots: Sequence[HiddenRobot], poses: Floats, seeds: Sequence[Sequence[int]]) -> None:
        self._ticks_per_turn = np.array([robot.ticks_per_turn for robot in robots])
        self._robots = [
            CommandedRobot(
                RunningRobot(robot.parameters, (x, y, theta), robot.noise, seed), robot.parameters, Random(f"{seed}")
            )
            for robot, (x, y, theta), seed in zip(robots, np.transpose(poses).tolist(), seeds, strict=True)
        ]

    @property
    def poses(self) -> Floats:
        """The true poses: x, y [m] and theta [rad], which is never wrapped, each (n,)."""
        return self._carried(POSE)

    def command(self, duties: Sequence[tuple[float, float]]) -> None:
        """Set each robot's duties (left, right), -1 to 1."""
        for robot, (left, right) in zip(self._robots, duties, strict=True):
            robot.command(left, right)

    def advance(self, time: float) -> None:
        """Simulate until `time` [s since the start]."""
        for robot in self._robots:
            robot.advance(time)

    def ticks(self) -> Floats:
        """Return the encoder counts since the start: integers, shape (2, n)."""
        counted: Floats = np.floor(self._carried(TURNED) / (2.0 * math.pi) * self._ticks_per_turn)
        return counted

    def _carried(self, places: list[int]) -> Floats:
        rows = np.zeros((len(places), len(self._robots)))
        for column, robot in enumerate(self._robots):
            rows[:, column] = robot.running.carried[places]
        return rows

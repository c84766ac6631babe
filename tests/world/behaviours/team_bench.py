"""Many robots driven by behaviours of many, without a bus: the model moves them, everybody sees everybody."""

import math
from collections.abc import Callable, Iterator, Sequence
from typing import Any

import numpy as np

from cmr.model.catalogue import together
from cmr.model.fleet import Fleet
from cmr.model.motion import RobotState
from cmr.model.parameters import RobotParameters
from cmr.world.behaviours import TeamBehaviour
from cmr.world.behaviours.team import Floats, duties_of
from cmr.world.interaction.body import body_radius
from cmr.world.view import VIRTUAL, Robots, WorldView

EPOCH = 1_800_000_000_000_000  # us
MODEL = RobotParameters(wheel_radius=0.04, k2_over_k3=118.0, k1=0.054, base_width=0.161)
STEP = 0.01  # s
STEPS = 3  # of the model between decisions
DIAMETER = 2.0 * float(body_radius(MODEL.base_width))  # m


class Bench:
    """Robots 0, 1, 2, ... at `poses` (n, 3); `teams` are behaviours with the robots that run them.

    Robots in no team do what `fixed` says: their duties.
    """

    def __init__(
        self,
        poses: Any,
        teams: Sequence[tuple[TeamBehaviour, Sequence[int]]],
        fixed: dict[int, tuple[float, float]] | None = None,
    ) -> None:
        x, y, theta = np.array(poses, dtype=float).T
        self.world = WorldView()
        self.utime = EPOCH
        self.teams = [(team, np.array(index)) for team, index in teams]
        self.duties = np.zeros((len(x), 2))
        for index, duty in (fixed or {}).items():
            self.duties[index] = duty
        self._fleet = Fleet(STEP)
        self._fleet.add(RobotState(x, y, theta, *np.zeros((4, len(x)))), MODEL)
        self._ids = tuple(range(len(x)))
        self._show()

    @property
    def x(self) -> Floats:
        return np.asarray(self._fleet.states().x)

    @property
    def y(self) -> Floats:
        return np.asarray(self._fleet.states().y)

    @property
    def speed(self) -> Floats:
        state = self._fleet.states()
        return np.asarray(MODEL.wheel_radius * (state.psi_left + state.psi_right) / 2.0)

    def nearest(self) -> float:
        """Return the distance [m] between the two centres that are nearest to each other."""
        away = np.hypot(self.x[:, np.newaxis] - self.x, self.y[:, np.newaxis] - self.y)
        np.fill_diagonal(away, math.inf)
        return float(away.min())

    def run(self, seconds: float, until: Callable[[], bool] = lambda: False) -> Iterator[None]:
        """Let time pass; yield after each decision."""
        for _ in range(round(seconds / STEP / STEPS)):
            self.decide()
            self._fleet.advance(STEPS)
            self.utime += round(STEPS * STEP * 1e6)
            self._show()
            yield
            if until():
                return

    def decide(self) -> None:
        state = self._fleet.states()
        for team, index in self.teams:
            me = Robots(
                tuple(index.tolist()), (VIRTUAL,) * len(index), RobotState(*(np.array(row)[index] for row in state))
            )
            self.duties[index] = duties_of(team, self.utime, me, self.world, together([MODEL] * len(index)))
        self._fleet.command(np.arange(len(self.duties)), *self.duties.T)

    def _show(self) -> None:
        robots = Robots(self._ids, (VIRTUAL,) * len(self._ids), self._fleet.states())
        self.world.take(self.utime, robots)

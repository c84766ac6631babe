"""Simulated robots, virtual ones and twins: one step of the model advances them all together."""

from collections.abc import Sequence
from functools import cached_property
from typing import Any

import numpy as np

from cmr.model.motion import RobotState
from cmr.model.parameters import RobotParameters
from cmr.world.view import Robots

STEP = 10_000  # us; one step of the simulation
EARLY = STEP // 2  # us; turns come a little sooner or later, and each is to make its one step
FURTHEST_BEHIND = 1_000_000  # us; a simulator held up for longer, or whose clock was set, skips the rest

Key = tuple[int, int]  # robot id and origin


class Fleet:
    """The simulated robots of a world, known by (robot id, origin); `utime` is the moment for which states hold."""

    def __init__(self) -> None:
        self.utime = 0
        self._index: dict[Key, int] = {}
        self._robots = Robots.of([])

    @cached_property
    def _model(self) -> Any:
        from cmr.model.fleet import Fleet as Model  # imports Numba, which takes half a second

        return Model(STEP * 1e-6)

    def __contains__(self, key: Key) -> bool:
        return key in self._index

    def place(self, keys: Sequence[Key], state: RobotState, parameters: RobotParameters) -> None:
        """Add robots, all of them new, at states that are arrays; or put one that is there into another state."""
        if keys[0] in self._index:
            index = self._indices(keys)
            self._model.set_parameters(index, parameters)
            self._model.place(index, state)
        else:
            added = self._model.add(state, parameters)
            self._index.update(zip(keys, added.tolist(), strict=True))
        robot_ids, origins = zip(*self._index, strict=True)
        self._robots = Robots(robot_ids, origins, self._model.states())

    def set_parameters(self, keys: Sequence[Key], parameters: RobotParameters) -> None:
        """Let robots move by other parameters from now on; their states stay."""
        self._model.set_parameters(self._indices(keys), parameters)

    def command(self, first: int, duties: Sequence[tuple[float, float]]) -> None:
        """Drive robots with these duties from now on: those from index `first` on in the order of `robots`.

        Duties are clipped to [-1, 1].
        """
        chosen = slice(first, first + len(duties))
        self._model.command(chosen, *np.clip(np.reshape(duties, (-1, 2)), -1.0, 1.0).T)

    def advance(self, utime: int) -> bool:
        """Let one step pass if it is due by `utime`, or in less than half a step; tell whether it did."""
        if abs(utime - self.utime) > FURTHEST_BEHIND:
            self.utime = utime - STEP
        if self.utime + STEP > utime + EARLY:
            return False
        self.utime += STEP
        if self._index:
            self._model.advance()
            self._robots = self._robots._replace(state=self._model.states())
        return True

    def robots(self) -> Robots:
        """Return all robots as they were after the last step; other commands and parameters show after the next."""
        return self._robots

    def _indices(self, keys: Sequence[Key]) -> list[int]:
        return [self._index[key] for key in keys]

"""Simulated robots, virtual ones and twins: one step of the model advances them all together."""

from collections.abc import Mapping, Sequence
from functools import cached_property
from types import MappingProxyType
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from cmr.geometry.obstacles import Floats, Obstacles
from cmr.model.motion import RobotState
from cmr.model.parameters import RobotParameters
from cmr.world.bounding import bounded
from cmr.world.interaction.body import body_radius
from cmr.world.view import TWIN, Robots, numbers_of

if TYPE_CHECKING:
    from cmr.model.fleet import Fleet as Model
    from cmr.world.interaction.contacts import Contacts

STEP = 10_000  # us; one step of the simulation
EARLY = STEP // 2  # us; turns vary slightly in time, and each should make exactly one step
FURTHEST_BEHIND = 1_000_000  # us; a simulator delayed by more, or whose clock was set, skips the rest

Key = tuple[int, int]  # robot id and origin


class Fleet:
    """The simulated robots of a world, known by (robot id, origin); `utime` is the time of their states.

    Virtual robots collide with one another, with `obstacles` and with `standing`, robots that cannot be pushed, (3, m)
    with rows x, y and radius [m]. `radius` has the radii [m], by id, of robots whose size does not follow from their
    base width. Twins collide with nothing.
    """

    def __init__(self, obstacles: Obstacles | None = None, radius: Mapping[int, float] = MappingProxyType({})) -> None:
        self.utime = 0
        self.standing: Floats = np.zeros((3, 0))
        self._obstacles = obstacles or Obstacles.none()
        self._own_radius = radius
        self._radius: Floats = np.zeros(0)
        self._wheel_radius: Floats = np.zeros(0)
        self._index: dict[Key, int] = {}
        self._robots = Robots.of([])
        self._moved = False  # since `_robots` was updated

    @cached_property
    def _model(self) -> "Model":
        from cmr.model.fleet import Fleet as Model  # imports Numba, which takes half a second

        return Model(STEP * 1e-6)

    @cached_property
    def _contacts(self) -> "Contacts":
        from cmr.world.interaction.contacts import Contacts  # also imports Numba

        return Contacts(self._obstacles)

    def __contains__(self, key: Key) -> bool:
        return key in self._index

    def place(self, keys: Sequence[Key], state: RobotState, parameters: RobotParameters) -> None:
        """Add robots, all of them new, at states that are arrays; or set the state of one existing robot."""
        if keys[0] in self._index:
            index = self._indices(keys)
            self._model.set_parameters(index, parameters)
            self._model.place(index, state)
        else:
            added = self._model.add(state, parameters)
            self._index.update(zip(keys, added.tolist(), strict=True))
        robot_ids, origins = map(numbers_of, zip(*self._index, strict=True))
        self._robots, self._moved = Robots(robot_ids, origins, self._model.states()), False
        self._measure()

    def set_parameters(self, keys: Sequence[Key], parameters: RobotParameters) -> None:
        """Change the parameters of robots; their states stay."""
        self._take_note()
        self._model.set_parameters(self._indices(keys), parameters)
        self._measure()

    def command(self, first: int, duties: ArrayLike) -> None:
        """Set the duties (n, 2) of the robots from index `first` on, in the order of `robots`.

        Duties are clipped to [-1, 1]; a robot with a NaN gets 0.
        """
        within = bounded(duties)
        self._take_note()
        self._model.command(slice(first, first + len(within)), within[:, 0], within[:, 1])

    def advance(self, utime: int) -> bool:
        """Simulate one step if it is due by `utime` or in less than half a step; return whether it was made."""
        if abs(utime - self.utime) > FURTHEST_BEHIND:
            self.utime = utime - STEP
        if self.utime + STEP > utime + EARLY:
            return False
        self.utime += STEP
        if self._index:
            self._model.advance()
            self._meet()
            self._moved = True
        return True

    def robots(self) -> Robots:
        """Return the states of all robots after the last step."""
        self._take_note()
        return self._robots

    @property
    def radius(self) -> Floats:
        """The radii of robots [m], in the order of `robots`; 0 for twins."""
        return self._radius

    def _take_note(self) -> None:
        """Read the states after the last step if needed; they are read only on demand."""
        if self._moved:
            self._robots = Robots(self._robots.robot_id, self._robots.origin, self._model.states())
            self._moved = False

    def _meet(self) -> None:
        """Separate robots that overlap with each other or with obstacles."""
        if self._contacts.resolve(self._model.bodies(), self._radius, self._wheel_radius, self.standing):
            self._model.take_back(self._contacts.touched.astype(bool))

    def _measure(self) -> None:
        """Update the radii of robots and wheels; twins have a radius of 0."""
        self._wheel_radius = self._model.parameter("wheel_radius")
        radius = body_radius(self._model.parameter("base_width"))
        for (robot_id, origin), index in self._index.items():
            radius[index] = 0.0 if origin == TWIN else self._own_radius.get(robot_id, radius[index])
        self._radius = radius

    def _indices(self, keys: Sequence[Key]) -> list[int]:
        return [self._index[key] for key in keys]

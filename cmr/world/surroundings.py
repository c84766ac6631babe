"""All robots as arrays, for team behaviours."""

from typing import TYPE_CHECKING, TypeAlias

import numpy as np
from numpy.typing import NDArray

from cmr.world.lazy_module import LazyModule

if TYPE_CHECKING:
    from cmr.world.interaction.neighbours import NearList, Neighbours

Floats: TypeAlias = NDArray[np.float64]
Indices: TypeAlias = NDArray[np.int64]

neighbours = LazyModule("cmr.world.interaction.neighbours")
robot_loops = LazyModule("cmr.world.robot_loops")
MOST_RADII = 20  # radii whose neighbour lists are kept
MISSING = -1  # index of a missing robot


class Members:
    """The ids of the robots, in the order of their states."""

    def __init__(self, robot_id: Indices) -> None:
        self.robot_id = robot_id
        self._order = np.argsort(robot_id, kind="stable")
        self._sorted = robot_id[self._order]

    def index_of(self, robot_ids: Indices) -> Indices:
        """Return the indices of these robots in `robot_id`; MISSING for those that are absent."""
        if not len(self._sorted):
            return np.full(len(robot_ids), MISSING)
        place = np.minimum(np.searchsorted(self._sorted, robot_ids), len(self._sorted) - 1)
        return np.where(self._sorted[place] == robot_ids, self._order[place], MISSING)


class Surroundings:
    """The real and virtual robots of the world at one moment: positions [m], headings [rad], wheel speeds [rad/s].

    Robots with NaN in their state are omitted. All arrays have the order of `members.robot_id`, are contiguous for
    compiled functions, and are read-only. `members` stays the same object as long as the same robots are there. `near`
    keeps neighbour lists between steps.
    """

    def __init__(
        self,
        members: Members,
        near: "dict[float, NearList]",
        x: Floats,
        y: Floats,
        theta: Floats,
        psi_left: Floats,
        psi_right: Floats,
    ) -> None:
        self.members = members
        self._near = near
        self.x, self.y, self.theta, self.psi_left, self.psi_right = x, y, theta, psi_left, psi_right
        self._neighbours: dict[float, Neighbours] = {}
        self._velocities: tuple[float, Floats, Floats] | None = None

    def neighbours(self, radius: float) -> "Neighbours":
        """Return for each robot those at most `radius` [m] away; computed once for all callers."""
        if radius not in self._neighbours:
            if radius not in self._near:
                if len(self._near) >= MOST_RADII:
                    self._near.clear()
                self._near[radius] = neighbours.NearList(radius)
            self._neighbours[radius] = self._near[radius].neighbours(self.members, self.x, self.y)
        return self._neighbours[radius]

    def velocities(self, wheel_radius: float) -> tuple[Floats, Floats]:
        """Return the velocities of all robots [m/s; world frame], assuming this wheel radius [m] for all."""
        if self._velocities is None or self._velocities[0] != wheel_radius:
            speeds = np.empty((2, len(self.x)))
            robot_loops.velocities_of(self.theta, self.psi_left, self.psi_right, wheel_radius, speeds)
            self._velocities = (wheel_radius, speeds[0], speeds[1])
        return self._velocities[1:]

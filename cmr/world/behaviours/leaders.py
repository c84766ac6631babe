"""The leaders of robots, where each robot may have its own."""

import numpy as np

from cmr.world.behaviours.team import Indices, Memory
from cmr.world.surroundings import MISSING, Members


class Leaders:
    """Looks up the leaders of robots; their ids are in `leader` of a behaviour's memory."""

    def __init__(self, memory: Memory) -> None:
        self._memory = memory
        self._known: tuple[Indices, Members, Indices] | None = None

    def adopt(self, robot_id: int, settings: dict[str, object]) -> None:
        """Set one robot's own leader, or another value of its memory."""
        row, self._known = self._memory.row(robot_id), None
        for name, value in settings.items():
            self._memory[name][row] = value

    def places(self, row: Indices, robot_ids: tuple[int, ...], members: Members) -> Indices:
        """Return the indices, among all robots, of the leaders of these robots at `row` of the memory.

        The result is cached while the arguments are the same. No robot is its own leader.
        """
        if self._known is None or self._known[0] is not row or self._known[1] is not members:
            leader = self._memory["leader"][row]
            index = members.index_of(leader)
            index[leader == np.array(robot_ids, np.int64)] = MISSING
            self._known = (row, members, index)
        return self._known[2]

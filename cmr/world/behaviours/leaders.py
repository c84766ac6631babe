"""Who goes by whom: the leaders of robots that each may have one of their own."""

import numpy as np

from cmr.world.behaviours.team import Indices, Memory
from cmr.world.surroundings import MISSING, Members


class Leaders:
    """The leaders of robots, as their ids are in `leader` of a behaviour's memory."""

    def __init__(self, memory: Memory) -> None:
        self._memory = memory
        self._known: tuple[Indices, Members, Indices] | None = None

    def adopt(self, robot_id: int, settings: dict[str, object]) -> None:
        """Let one robot have a leader, or whatever else is remembered of each, of its own."""
        row, self._known = self._memory.row(robot_id), None
        for name, value in settings.items():
            self._memory[name][row] = value

    def places(self, row: Indices, robot_ids: tuple[int, ...], members: Members) -> Indices:
        """Return where the leaders of these robots, at `row` of the memory, are among everybody.

        The answer is kept as long as the same are asked for. Nobody is a leader of its own.
        """
        if self._known is None or self._known[0] is not row or self._known[1] is not members:
            leader = self._memory["leader"][row]
            index = members.index_of(leader)
            index[leader == np.array(robot_ids, np.int64)] = MISSING
            self._known = (row, members, index)
        return self._known[2]

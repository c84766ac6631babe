"""A shadow: does as its leader does, in a place of its own, turns on the spot included."""

from typing import ClassVar

import numpy as np

from cmr.model.parameters import RobotParameters
from cmr.world.behaviours.leaders import Leaders
from cmr.world.behaviours.team import Duties, Memory, TeamBehaviour
from cmr.world.lazy_module import LazyModule
from cmr.world.view import Robots, WorldView

tracking = LazyModule("cmr.world.behaviours.tracking")


class Shadow(TeamBehaviour):
    """Do as the robot `leader` does from now on: the same way and the same turns, from one's own place and heading.

    So a virtual leader makes a real robot drive any manoeuvre, spins on the spot included, which `follow` cannot. It
    stands while the leader is not in the world, and begins again, from where it is, when it comes back, after a stop of
    its own, or when it is half a metre from where it should be. It goes round nobody and needs as much room as its
    leader.
    """

    per_robot: ClassVar[frozenset[str]] = frozenset({"leader"})

    def __init__(self, leader: int = 10) -> None:
        self._memory = Memory(leader=leader, tracked=0.0, turn=0.0, shift_x=0.0, shift_y=0.0)
        self._leaders = Leaders(self._memory)

    def adopt(self, robot_id: int, settings: dict[str, object]) -> None:
        """Let one robot have a leader of its own."""
        self._leaders.adopt(robot_id, settings)

    def prepare(self) -> None:
        """Load the compiled function by a turn of nobody."""
        nobody = np.zeros(0)
        self.commands(0, Robots.of([]), WorldView(), RobotParameters(nobody, nobody, nobody, nobody))

    def commands(self, utime: int, me: Robots, world: WorldView, parameters: RobotParameters) -> Duties:
        """Return the duties that take robots to where their leaders' motion takes them."""
        around, memory = world.surroundings(), self._memory
        row = memory.rows(me.robot_id)
        pose = (np.ascontiguousarray(column, dtype=float) for column in me.state[:3])
        kept = (memory["tracked"], memory["turn"], memory["shift_x"], memory["shift_y"])
        duties = np.empty((2, len(row)))
        tracking.track(
            *(float(utime), row, self._leaders.places(row, me.robot_id, around.members)),
            *(around.x, around.y, around.theta, around.psi_left, around.psi_right, *pose),
            *(parameters.wheel_radius, parameters.k1, parameters.base_width, *kept, *duties),
        )
        return duties.T

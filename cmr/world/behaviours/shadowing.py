"""A shadow copies its leader's motion at a place of its own, including turns on the spot."""

from typing import ClassVar

import numpy as np

from cmr.model.parameters import RobotParameters
from cmr.world.behaviours.leaders import Leaders
from cmr.world.behaviours.team import Duties, Memory, TeamBehaviour
from cmr.world.lazy_module import LazyModule
from cmr.world.view import Robots, WorldView

tracking = LazyModule("cmr.world.behaviours.tracking")


class Shadow(TeamBehaviour):
    """Copy the motion of the robot `leader` from now on: the same path and turns, from the robot's own pose.

    A virtual leader can thus make a real robot drive any manoeuvre, including spins on the spot, which `follow` cannot.
    The robot stops while the leader is not in the world. It starts again from its current pose when the leader returns,
    after a stop of its own, or when it is half a metre off. It avoids no obstacles and needs as much room as its
    leader.
    """

    per_robot: ClassVar[frozenset[str]] = frozenset({"leader"})

    def __init__(self, leader: int = 10) -> None:
        self._memory = Memory(leader=leader, tracked=0.0, turn=0.0, shift_x=0.0, shift_y=0.0)
        self._leaders = Leaders(self._memory)

    def adopt(self, robot_id: int, settings: dict[str, object]) -> None:
        """Set one robot's own leader."""
        self._leaders.adopt(robot_id, settings)

    def prepare(self) -> None:
        """Load the compiled function by running it with no robots."""
        nobody = np.zeros(0)
        self.commands(0, Robots.of([]), WorldView(), RobotParameters(nobody, nobody, nobody, nobody))

    def commands(self, utime: int, me: Robots, world: WorldView, parameters: RobotParameters) -> Duties:
        """Return the duties that make robots copy their leaders' motion."""
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

"""A robot that does what MOTOR_COMMAND_N says: for virtual robots steered by an outside controller."""

from cmr.model.parameters import RobotParameters
from cmr.world.behaviours.behaviour import Behaviour
from cmr.world.commands import CommandMemory
from cmr.world.view import Robot, WorldView


class Commanded(Behaviour):
    """Drive the newest motor command, as a real robot's driver would: zero when it is older than 0.5 s."""

    def __init__(self) -> None:
        self._memory = CommandMemory()

    def take_command(self, utime: int, left: float, right: float) -> None:
        """Keep the command until it is too old."""
        self._memory.take(utime, left, right)

    def command(self, utime: int, _me: Robot, _world: WorldView, _parameters: RobotParameters) -> tuple[float, float]:
        """Return the newest command, or zero."""
        return self._memory.at(utime)

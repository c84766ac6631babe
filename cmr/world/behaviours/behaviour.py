"""The abstract behaviour of one robot."""

from abc import ABC, abstractmethod
from collections.abc import Iterable

from cmr.bus.message import Message
from cmr.bus.streams import Stream
from cmr.model.parameters import RobotParameters
from cmr.world.commands import CommandMemory
from cmr.world.view import Robot, WorldView


class BehaviourError(Exception):
    """A behaviour's description cannot be used; the text says what is wrong and what is allowed."""


class Behaviour(ABC):
    """Decides what one robot does, from what it knows of the world.

    Derive from it, give the constructor keyword arguments with defaults, and name the class as
    `your.module:YourClass` where cmr-sim or cmr-pilot asks for a behaviour, or register it in the entry-point group
    `cmr.behaviours`. One that comes to an end sets `finished`,
    and cmr-pilot ends with it; `problem` is then a sentence that says why it ended before its time, and what to do.
    """

    finished = False
    problem = ""

    @abstractmethod
    def command(self, utime: int, me: Robot, world: WorldView, parameters: RobotParameters) -> tuple[float, float]:
        """Return the duties (left, right), -1 to 1, for the robot `me` at `utime` [us].

        `parameters` are those of the robot's model. Called some 20 to 100 times a second.
        """

    def hear(self, utime: int, channel: str, message: Message) -> None:  # noqa: B027 - few look at sensors themselves
        """Take what the robot's driver and sensors say: MOTOR_FEEDBACK_N, GYRO_N, POSE_N. Ignored unless overridden."""

    def prepare(self) -> None:  # noqa: B027 - most have nothing to load
        """Load what deciding takes, if that takes long: called before the first turn, where nobody waits."""

    def tell(self, utime: int) -> Iterable[tuple[Stream[Message], Message]]:  # noqa: ARG002 - most have nothing to say
        """Return what is to be published at `utime` [us] besides commands, of streams on which each robot has one.

        Called after each command. Nothing unless overridden.
        """
        return ()

    def take_waypoints(self, x: list[float], y: list[float]) -> None:  # noqa: B027 - not every robot has waypoints
        """Take a path to drive, as points [m; world frame]; an empty one means stop. Ignored unless overridden."""

    def take_command(self, utime: int, left: float, right: float) -> None:  # noqa: B027 - few robots are steered so
        """Take a motor command from the bus. Ignored unless overridden."""


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

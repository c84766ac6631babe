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

    Derive from it, give the constructor keyword arguments with defaults, and give its name as `your.module:YourClass`
    to cmr-sim or cmr-pilot, or register it in the entry-point group `cmr.behaviours`. A behaviour that ends sets
    `finished`, and cmr-pilot then exits. If it ended early, `problem` is a sentence that says why and what to do.
    """

    finished = False
    problem = ""

    @abstractmethod
    def command(self, utime: int, me: Robot, world: WorldView, parameters: RobotParameters) -> tuple[float, float]:
        """Return the duties (left, right), -1 to 1, for the robot `me` at `utime` [us].

        `parameters` are those of the robot's model. Called some 20 to 100 times a second.
        """

    def hear(self, utime: int, channel: str, message: Message) -> None:  # noqa: B027 - few read sensors directly
        """Handle MOTOR_FEEDBACK_N, GYRO_N and POSE_N of the robot. Ignored unless overridden."""

    def prepare(self) -> None:  # noqa: B027 - most have nothing to load
        """Load or compile what `command` needs, if that takes long. Called before the first turn, when nothing waits
        for it.
        """

    def tell(self, utime: int) -> Iterable[tuple[Stream[Message], Message]]:  # noqa: ARG002 - most publish nothing
        """Return messages to publish at `utime` [us] besides commands, on streams with a channel per robot.

        Called after each command. Returns nothing unless overridden.
        """
        return ()

    def take_waypoints(self, x: list[float], y: list[float]) -> None:  # noqa: B027 - not every robot has waypoints
        """Accept a path to drive, as points [m; world frame]; an empty one means stop. Ignored unless overridden."""

    def take_command(self, utime: int, left: float, right: float) -> None:  # noqa: B027 - few behaviours use it
        """Accept a motor command from the bus. Ignored unless overridden."""


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

"""The abstract behaviour, and how a behaviour is made from its description on the command line."""

import inspect
from abc import ABC, abstractmethod
from importlib import import_module

from cmr.model.parameters import RobotParameters
from cmr.world.view import Robot, WorldView

SHIPPED = {
    "figure_eight": "cmr.world.behaviours.leading:FigureEight",
    "follow": "cmr.world.behaviours.following:Follow",
    "commanded": "cmr.world.behaviours.commanded:Commanded",
}


class BehaviourError(Exception):
    """A behaviour's description cannot be used; the text says what is wrong and what is allowed."""


class Behaviour(ABC):
    """Decides what one robot does, from what it knows of the world.

    Derive from it, give the constructor keyword arguments with defaults, and name the class as
    `your.module:YourClass` where cmr-sim or cmr-pilot asks for a behaviour.
    """

    @abstractmethod
    def command(self, utime: int, me: Robot, world: WorldView, parameters: RobotParameters) -> tuple[float, float]:
        """Return the duties (left, right), -1 to 1, for the robot `me` at `utime` [us].

        `parameters` are those of the robot's model. Called some 20 to 100 times a second.
        """

    def take_waypoints(self, x: list[float], y: list[float]) -> None:  # noqa: B027 - not every robot has waypoints
        """Take a path to drive, as points [m; world frame]; an empty one means stop. Ignored unless overridden."""

    def take_command(self, utime: int, left: float, right: float) -> None:  # noqa: B027 - few robots are steered so
        """Take a motor command from the bus. Ignored unless overridden."""


def make_behaviour(description: str, settings: dict[str, str]) -> Behaviour:
    """Return the behaviour that `description` names: a shipped one, or `module:Class`; settings go to its constructor.

    Raises BehaviourError when there is no such behaviour or setting, or a value is not a number.
    """
    target = SHIPPED.get(description, description)
    module_name, _colon, class_name = target.partition(":")
    try:
        kind = getattr(import_module(module_name), class_name)
    except (ImportError, AttributeError, ValueError) as error:
        raise BehaviourError(
            f"There is no behaviour {description!r} ({error}). Shipped: {', '.join(SHIPPED)}; yours: module:Class."
        ) from error
    if not (inspect.isclass(kind) and issubclass(kind, Behaviour)):
        raise BehaviourError(f"{description} is not a class derived from cmr.world.behaviours.Behaviour.")
    allowed = inspect.signature(kind).parameters
    unknown = set(settings) - set(allowed)
    if unknown:
        raise BehaviourError(f"{description} has no setting {min(unknown)!r}; it has {', '.join(allowed) or 'none'}.")
    values: dict[str, float] = {}
    for name, text in settings.items():
        try:
            values[name] = int(text) if allowed[name].annotation is int else float(text)
        except ValueError as error:
            raise BehaviourError(f"{description}: {name}={text} is not a number of the right kind") from error
    try:
        behaviour: Behaviour = kind(**values)
    except (ValueError, TypeError) as error:
        raise BehaviourError(f"{description}: {error}") from error
    return behaviour

"""The abstract behaviour, and how a behaviour is made from its description on the command line."""

import inspect
import math
from abc import ABC, abstractmethod
from importlib import import_module

from cmr.model.parameters import RobotParameters
from cmr.world.view import Robot, WorldView

SHIPPED = {
    "figure_eight": "cmr.world.behaviours.leading:FigureEight",
    "follow": "cmr.world.behaviours.following:Follow",
    "commanded": "cmr.world.behaviours.commanded:Commanded",
    "manoeuvre": "cmr.world.behaviours.manoeuvring:DriveManoeuvre",
}


LARGEST_SETTING = 1e9  # metres, seconds, robots


class BehaviourError(Exception):
    """A behaviour's description cannot be used; the text says what is wrong and what is allowed."""


class Behaviour(ABC):
    """Decides what one robot does, from what it knows of the world.

    Derive from it, give the constructor keyword arguments with defaults, and name the class as
    `your.module:YourClass` where cmr-sim or cmr-pilot asks for a behaviour. One that comes to an end sets `finished`,
    and cmr-pilot ends with it; `problem` is then a sentence that says why it ended before its time, and what to do.
    """

    finished = False
    problem = ""

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

    Raises BehaviourError when there is no such behaviour or setting, or a value is not what the setting takes.
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
    values = {name: _value(name, text, allowed[name].annotation) for name, text in settings.items()}
    try:
        behaviour: Behaviour = kind(**values)
    except (ValueError, TypeError) as error:
        raise BehaviourError(f"{description}: {error}") from error
    return behaviour


def _value(name: str, text: str, annotation: object) -> float | str:
    """Return a setting's value: a text where the constructor asks for `str`, otherwise a number."""
    if annotation is str:
        return text
    return number_of(name, text, int if annotation is int else float)


def number_of(name: str, text: str, kind: type[int] | type[float] = float) -> float:
    """Return the number that a setting is given as.

    Raises BehaviourError when it is none, of another kind, or larger than any laboratory.
    """
    try:
        value = kind(text)
    except ValueError:
        value = math.nan
    if not abs(value) <= LARGEST_SETTING:
        whole = "a whole number" if kind is int else "a number"
        raise BehaviourError(f"{name}={text} is not {whole} from {-LARGEST_SETTING:g} to {LARGEST_SETTING:g}")
    return value

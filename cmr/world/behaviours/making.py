"""Make behaviours from their descriptions: a name and settings as text."""

import inspect
import math
from collections.abc import Iterable, Mapping
from importlib import import_module
from typing import TypeAlias, get_args

from cmr.world.behaviours.behaviour import Behaviour, BehaviourError
from cmr.world.behaviours.team import TeamBehaviour

AnyBehaviour: TypeAlias = Behaviour | TeamBehaviour

SHIPPED = {
    "figure_eight": "cmr.world.behaviours.leading:FigureEight",
    "follow": "cmr.world.behaviours.following:Follow",
    "waypoints": "cmr.world.behaviours.waypoints:Waypoints",
    "shadow": "cmr.world.behaviours.shadowing:Shadow",
    "formation": "cmr.world.behaviours.formation:Formation",
    "flock": "cmr.world.behaviours.flocking:Flock",
    "right_of_way": "cmr.world.behaviours.right_of_way:RightOfWay",
    "commanded": "cmr.world.behaviours.behaviour:Commanded",
    "manoeuvre": "cmr.world.behaviours.manoeuvring:DriveManoeuvre",
    "investigate": "cmr.investigation.behaviour:Investigate",
}
GROUP = "cmr.behaviours"  # entry-point group for behaviours of other packages
LARGEST_SETTING = 1e9  # metres, seconds, robots


def make_behaviour(description: str, settings: Mapping[str, str]) -> AnyBehaviour:
    """Return the behaviour that `description` names: a shipped one, one registered by a package, or `module:Class`.

    Settings go to its constructor. Raises BehaviourError when there is no such behaviour or setting, or a value does
    not fit the setting.
    """
    kind = _kind(description)
    return _made(kind, description, _values(kind, description, settings))


def make_behaviours(descriptions: Mapping[int, tuple[str, Mapping[str, str]]]) -> dict[int, AnyBehaviour]:
    """Return the behaviours of many robots, by robot id; those that can share a TeamBehaviour do.

    They can share one if name and settings are the same, except for settings in `per_robot`. Raises BehaviourError as
    make_behaviour does.
    """
    shared: dict[object, TeamBehaviour] = {}
    made: dict[int, AnyBehaviour] = {}
    for robot_id, (description, settings) in descriptions.items():
        kind = _kind(description)
        values = _values(kind, description, settings)
        per_robot = kind.per_robot if issubclass(kind, TeamBehaviour) else ()
        own = {name: values[name] for name in values if name in per_robot}
        key = (kind, *sorted((name, value) for name, value in values.items() if name not in own))
        behaviour = shared.get(key)
        if behaviour is None or own:
            alone = _made(kind, description, values)  # also for shared behaviours, to check the values
            if isinstance(alone, Behaviour):
                made[robot_id] = alone
                continue
            behaviour = shared.setdefault(key, alone)
        if per_robot:
            behaviour.adopt(robot_id, _with_defaults(kind, per_robot, own))
        made[robot_id] = behaviour
    return made


def _kind(description: str) -> type[AnyBehaviour]:
    """Return the class of a behaviour."""
    target = SHIPPED.get(description) or _of_packages().get(description, description)
    module_name, _colon, class_name = target.partition(":")
    try:
        kind = getattr(import_module(module_name), class_name)
    except (ImportError, AttributeError, ValueError) as error:
        raise BehaviourError(
            f"There is no behaviour {description!r} ({error}). Shipped: {', '.join(SHIPPED)}; "
            f"{_listed(_of_packages())}yours: module:Class."
        ) from error
    if not (inspect.isclass(kind) and issubclass(kind, Behaviour | TeamBehaviour)):
        raise BehaviourError(
            f"{description} is not a class derived from cmr.world.behaviours.Behaviour or TeamBehaviour."
        )
    return kind


def _of_packages() -> dict[str, str]:
    """Return the behaviours that installed packages register; the names of shipped ones cannot be taken."""
    from importlib.metadata import entry_points  # this import is slow compared with a command's start

    return {entry.name: entry.value for entry in entry_points(group=GROUP)}


def _listed(names: Mapping[str, str]) -> str:
    return f"of packages: {', '.join(sorted(names))}; " if names else ""


def _values(kind: type[AnyBehaviour], description: str, settings: Mapping[str, str]) -> dict[str, float | str]:
    """Convert the settings to the constructor's arguments."""
    allowed = inspect.signature(kind).parameters
    unknown = set(settings) - set(allowed)
    if unknown:
        raise BehaviourError(f"{description} has no setting {min(unknown)!r}; it has {', '.join(allowed) or 'none'}.")
    return {name: _value(name, text, allowed[name].annotation) for name, text in settings.items()}


def _made(kind: type[AnyBehaviour], description: str, values: Mapping[str, float | str]) -> AnyBehaviour:
    try:
        behaviour: AnyBehaviour = kind(**values)
    except (ValueError, TypeError) as error:
        raise BehaviourError(f"{description}: {error}") from error
    return behaviour


def _with_defaults(
    kind: type[AnyBehaviour], per_robot: Iterable[str], own: Mapping[str, float | str]
) -> dict[str, object]:
    """Return the values of all per-robot settings, defaults included."""
    parameters = inspect.signature(kind).parameters
    return {name: own.get(name, parameters[name].default) for name in per_robot}


def _value(name: str, text: str, annotation: object) -> float | str:
    """Return a setting's value: text if the constructor's annotation or default is `str`, otherwise a number."""
    if annotation in (str, "str") or str in get_args(annotation):
        return text
    return number_of(name, text, int if annotation in (int, "int") else float)


def number_of(name: str, text: str, kind: type[int] | type[float] = float) -> float:
    """Parse the number of a setting.

    Raises BehaviourError if it is not a number, of the wrong kind, or too large.
    """
    try:
        value = kind(text)
    except ValueError:
        value = math.nan
    if not abs(value) <= LARGEST_SETTING:
        whole = "a whole number" if kind is int else "a number"
        raise BehaviourError(f"{name}={text} is not {whole} from {-LARGEST_SETTING:g} to {LARGEST_SETTING:g}")
    return value

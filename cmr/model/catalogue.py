"""All effects by name, and all parameters: those of CMR, those that installed packages add, and laws.

The catalogue holds what has a cause that can be named. The model also knows generic terms, which have none.

A package adds effects by an entry point of the group `cmr.effects`, each pointing at one `Effect`. A law, which came
with the parameters of a robot or from a file, is added by `learn` while a process runs, and is an entry from then on.
"""

from collections.abc import Callable, Collection, Mapping, Sequence
from functools import cache
from importlib.metadata import entry_points
from itertools import chain
from threading import Lock
from typing import ParamSpec, TypeVar

from cmr.model import parameters as paper
from cmr.model.effect import Effect
from cmr.model.effects import electronics, generic, ground, motors, sensors
from cmr.model.laws.effect import law_effect
from cmr.model.laws.law import Law, LawError
from cmr.model.parameters import ParameterDefinition, RobotParameters
from cmr.model.velocity_controller import CONTROLLER_DEFINITIONS

ENTRY_POINTS = "cmr.effects"
P = ParamSpec("P")
R = TypeVar("R")
OWN = (*electronics.EFFECTS, *motors.EFFECTS, *ground.EFFECTS, *sensors.EFFECTS)


def catalogue_of(effects: tuple[Effect, ...]) -> dict[str, Effect]:
    """Return the effects by name.

    Raises ValueError where two effects or parameters have the same name.
    """
    names = [effect.name for effect in effects]
    numbers = [parameter.name for parameter in chain(paper.PARAMETER_DEFINITIONS, *(e.all_parameters for e in effects))]
    for taken in (names, numbers):
        twice = sorted({name for name in taken if taken.count(name) > 1})
        if twice:
            raise ValueError(f"more than one effect uses the name {', '.join(twice)}")
    return {effect.name: effect for effect in effects}


def definitions_of(catalogue: Mapping[str, Effect]) -> dict[str, ParameterDefinition]:
    """Return all parameters of the model by name, the paper's first."""
    return {
        parameter.name: parameter
        for parameter in chain(paper.PARAMETER_DEFINITIONS, *(effect.all_parameters for effect in catalogue.values()))
    }


CATALOGUE = catalogue_of((*OWN, *(point.load() for point in entry_points(group=ENTRY_POINTS))))
GENERIC_TERMS = catalogue_of(generic.EFFECTS)
MODELLED = catalogue_of((*CATALOGUE.values(), *GENERIC_TERMS.values()))
DEFINITIONS = definitions_of(MODELLED)
MOST_LAWS = 100  # that a process learns: they come with parameters from the bus, too
LAWS: dict[str, Law] = {}  # those that this process knows; their effects are in CATALOGUE, too
_LEARNING = Lock()
_FORGETTING: list[Callable[[], None]] = []


def remembered(function: Callable[P, R]) -> Callable[P, R]:
    """Compute what depends on the catalogue once, and again when the catalogue has changed."""
    kept = cache(function)
    _FORGETTING.append(kept.cache_clear)
    return kept  # type: ignore[return-value]  # a cache wants arguments that have a hash


def learn(law: Law, estimates: Mapping[str, float] | None = None) -> Effect:
    """Add a law to the catalogue of this process and return its effect; `estimates` as in `law_effect`.

    Whoever knows the law already gets the effect that is there. Raises LawError, a ValueError, where the name is taken
    by another law, or by an effect or parameter, and for one law more than MOST_LAWS.
    """
    with _LEARNING:
        known = LAWS.get(law.name)
        if known is not None:
            if not known.is_same(law):
                raise LawError(f"{law.name} is the name of another law, {' and '.join(known.formulas)}", "name")
            return CATALOGUE[law.name]
        if len(LAWS) >= MOST_LAWS:
            raise LawError(f"this process knows {MOST_LAWS} laws already, which is as many as it learns", "name")
        effect = law_effect(law, estimates)
        try:
            catalogue_of((*MODELLED.values(), effect))
        except ValueError as error:
            raise LawError(str(error), "name") from None
        # New names come before what makes others look for them.
        DEFINITIONS.update({parameter.name: parameter for parameter in effect.all_parameters})
        MODELLED[law.name] = CATALOGUE[law.name] = effect
        LAWS[law.name] = law
        _forget_what_depended_on_it()
        return effect


def unlearn(name: str) -> None:
    """Take a law out of the catalogue of this process, such as one that was only tried.

    Raises KeyError for a name that is no law's.
    """
    with _LEARNING:
        del LAWS[name]
        for parameter in CATALOGUE[name].all_parameters:
            del DEFINITIONS[parameter.name]
        del MODELLED[name], CATALOGUE[name]
        _forget_what_depended_on_it()


def _forget_what_depended_on_it() -> None:
    for forget in _FORGETTING:
        forget()


def needed(effects: Mapping[str, Effect], names: Collection[str]) -> list[Effect]:
    """Return those of some effects that a model with parameters of these `names` has: of laws only those that are used.

    All others are compiled in from the beginning; each set of laws takes seconds to compile.
    """
    return [
        effect
        for name, effect in effects.items()
        if name not in LAWS or any(parameter.name in names for parameter in effect.parameters)
    ]


def definition(name: str) -> ParameterDefinition:
    """Return what a parameter is.

    Raises KeyError, which lists the known ones, for a name that is no parameter.
    """
    for known in (DEFINITIONS, CONTROLLER_DEFINITIONS):
        if name in known:
            return known[name]
    raise KeyError(f"unknown parameter {name}; known: {', '.join(DEFINITIONS)}")


def effects_on(values: Mapping[str, object]) -> list[Effect]:
    """Return the effects that these parameter values, by name, switch on; generic terms come last.

    Raises KeyError for a name that is no parameter.
    """
    for name in values:
        definition(name)
    return [effect for effect in MODELLED.values() if effect.is_on(values)]


def typical(effect: Effect) -> dict[str, float]:
    """Return the effect's parameters at their typical size."""
    return {parameter.name: float(parameter.typical or 0.0) for parameter in effect.parameters}


def with_effects(parameters: RobotParameters, values: Mapping[str, object]) -> RobotParameters:
    """Return the parameters with these values, by name, in place of their own."""
    return RobotParameters.of({**parameters.values, **values})


def together(robots: Sequence[RobotParameters]) -> RobotParameters:
    """Return the parameters of many robots as one: arrays of shape (n,); what one lacks is neutral."""
    import numpy as np  # a driver reads parameters, and has no arrays

    names = dict.fromkeys(name for robot in robots for name in robot.values)
    return RobotParameters.of(
        {
            name: np.array([robot.values.get(name, definition(name).neutral) for robot in robots], float)
            for name in names
        }
    )

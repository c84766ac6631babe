"""All effects and parameters by name: those of CMR, of installed packages, and laws.

The catalogue contains effects with a nameable cause. The model also has generic terms, which have none.

A package adds effects by an entry point of the group `cmr.effects`, each pointing at one `Effect`. A law, from a
robot's parameters or a file, is added by `learn` at run time, and is then an entry as well.
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

    Raises ValueError for duplicate names of effects or parameters.
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
MOST_LAWS = 100  # learned by one process: they also come with parameters from the bus
LAWS: dict[str, Law] = {}  # known to this process; their effects are also in CATALOGUE
_LEARNING = Lock()
_FORGETTING: list[Callable[[], None]] = []


def remembered(function: Callable[P, R]) -> Callable[P, R]:
    """Cache a function of the catalogue, and recompute it when the catalogue has changed."""
    kept = cache(function)
    _FORGETTING.append(kept.cache_clear)
    return kept  # type: ignore[return-value] # a cache needs hashable arguments


def learn(law: Law, estimates: Mapping[str, float] | None = None) -> Effect:
    """Add a law to the catalogue of this process and return its effect; `estimates` as in `law_effect`.

    A known law returns its existing effect. Raises LawError, a ValueError, if the name belongs to another law, an
    effect or a parameter, and beyond MOST_LAWS.
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
        # Register new names before anything makes others look them up.
        DEFINITIONS.update({parameter.name: parameter for parameter in effect.all_parameters})
        MODELLED[law.name] = CATALOGUE[law.name] = effect
        LAWS[law.name] = law
        _forget_what_depended_on_it()
        return effect


def unlearn(name: str) -> None:
    """Remove a law from the catalogue of this process, for example one that was only tested.

    Raises KeyError for an unknown law.
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
    """Return the effects needed by a model with parameters of these `names`: laws only if they are used.

    All others are always compiled in; each set of laws takes seconds to compile.
    """
    return [
        effect
        for name, effect in effects.items()
        if name not in LAWS or any(parameter.name in names for parameter in effect.parameters)
    ]


def definition(name: str) -> ParameterDefinition:
    """Return the definition of a parameter.

    Raises KeyError, listing the known ones, for an unknown name.
    """
    for known in (DEFINITIONS, CONTROLLER_DEFINITIONS):
        if name in known:
            return known[name]
    raise KeyError(f"unknown parameter {name}; known: {', '.join(DEFINITIONS)}")


def effects_on(values: Mapping[str, object]) -> list[Effect]:
    """Return the effects switched on by these parameter values, by name; generic terms come last.

    Raises KeyError for an unknown parameter.
    """
    for name in values:
        definition(name)
    return [effect for effect in MODELLED.values() if effect.is_on(values)]


def typical(effect: Effect) -> dict[str, float]:
    """Return the effect's parameters at their typical size."""
    return {parameter.name: float(parameter.typical or 0.0) for parameter in effect.parameters}


def with_effects(parameters: RobotParameters, values: Mapping[str, object]) -> RobotParameters:
    """Return the parameters with these values, by name, replacing their own."""
    return RobotParameters.of({**parameters.values, **values})


def together(robots: Sequence[RobotParameters]) -> RobotParameters:
    """Return the parameters of many robots as one: arrays of shape (n,); missing ones are neutral."""
    import numpy as np  # a driver reads parameters, and has no arrays

    names = dict.fromkeys(name for robot in robots for name in robot.values)
    return RobotParameters.of(
        {
            name: np.array([robot.values.get(name, definition(name).neutral) for robot in robots], float)
            for name in names
        }
    )

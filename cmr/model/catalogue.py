"""All effects by name, and all parameters: those of CMR and those that installed packages add.

The catalogue holds what has a cause that can be named. The model also knows generic terms, which have none.

A package adds effects by an entry point of the group `cmr.effects`, each pointing at one `Effect`.
"""

from collections.abc import Mapping, Sequence
from importlib.metadata import entry_points
from itertools import chain

from cmr.model import parameters as paper
from cmr.model.effect import Effect
from cmr.model.effects import electronics, generic, ground, motors, sensors
from cmr.model.parameters import ParameterDefinition, RobotParameters
from cmr.model.velocity_controller import CONTROLLER_DEFINITIONS

ENTRY_POINTS = "cmr.effects"
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

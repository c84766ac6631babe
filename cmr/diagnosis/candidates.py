"""Where to look for each effect of the catalogue: values from which a fit may start, scaled to the robot."""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np

from cmr.model.catalogue import CATALOGUE, definition
from cmr.model.effect import Effect
from cmr.model.parameters import ParameterDefinition

# The robot that typical sizes stand for; those of others are scaled by dimension.
USUAL_ACCELERATION, USUAL_RATE, USUAL_WIDTH, USUAL_TURN = 118.0, 118.0 * 0.054, 0.16, 2.0  # rad/s^2, 1/s, m, rad/s
LIMITS = (0.35, 0.55, 0.75, 1.0, 1.3, 1.8, 2.6)  # multiples of the typical size at which a limit is tried
THRESHOLDS = (0.4, 1.0, 1.8)
MOMENTS = 8  # of a drive at which a change is tried
PLACES = 14  # at which a patch of the floor is tried
RANDOM = ("command_jitter", "command_loss")  # show in the spread, not in the mean
SENSED = ("encoder_quantisation",)  # read off the encoder's ticks
SMALLEST = 0.15  # of the typical size: less is not worth a name


@dataclass(frozen=True)
class Scene:
    """What is known of a drive before anything is named: the robot's parameters, how long it took, where it went.

    `places` [m], shape (n, 2), are spread over where the robot was; `turning` [rad/s] is a usual yaw rate.
    """

    parameters: Mapping[str, float]
    seconds: float
    places: np.typing.NDArray[np.float64]
    turning: float


@dataclass(frozen=True)
class Trial:
    """An effect with values of its parameters; `threshold` says that half of the effect is not half of its value."""

    effect: str
    values: Mapping[str, float]
    threshold: bool


def size(parameter: ParameterDefinition, scene: Scene) -> float:
    """Return the typical size of a parameter on this robot, in its unit."""
    acceleration = scene.parameters["k2_over_k3"]
    rate = scene.parameters["k1"] * acceleration
    top = 1.0 / scene.parameters["k1"]
    factors = {
        "rad/s^2": acceleration / USUAL_ACCELERATION,
        "1/rad": acceleration / USUAL_ACCELERATION / (top * USUAL_RATE / USUAL_ACCELERATION) ** 2,
        "s/rad": USUAL_TURN / scene.turning,
        "duty/s": rate / USUAL_RATE,
    }
    factor = factors.get(parameter.unit, 1.0)
    if parameter.unit == "m" and parameter.switches:
        factor = scene.parameters["base_width"] / USUAL_WIDTH
    return float(parameter.typical or 1.0) * factor


def trials(scene: Scene, effects: Iterable[Effect] = CATALOGUE.values()) -> list[Trial]:
    """Return all trials, those of one effect side by side."""
    result = []
    for effect in effects:
        if effect.name in RANDOM or effect.name in SENSED:
            continue
        for places in _elsewhere(effect, scene):
            result += [Trial(effect.name, values | places, threshold) for values, threshold in _sizes(effect, scene)]
    return result


def _sizes(effect: Effect, scene: Scene) -> list[tuple[dict[str, float], bool]]:
    """Return values of the parameters that switch the effect on: each alone, a limit at several sizes."""
    switches = [parameter for parameter in effect.parameters if parameter.switches]
    neutral = {parameter.name: float(parameter.neutral or 0.0) for parameter in switches}
    result = []
    for parameter in switches:
        usual = size(parameter, scene)
        if is_limit(parameter):
            sizes, threshold = [usual * share for share in LIMITS], True
        elif parameter.unit == "duty":
            sizes, threshold = [usual * share for share in THRESHOLDS], True
        else:
            sizes, threshold = [usual], False
        result += [(neutral | {parameter.name: value}, threshold) for value in sizes if parameter.allows(value)]
    return result


def is_limit(parameter: ParameterDefinition) -> bool:
    """Tell whether a parameter limits something, so that its effect begins below the largest value."""
    return parameter.neutral is not None and (math.isinf(parameter.neutral) or parameter.neutral == parameter.upper)


def _elsewhere(effect: Effect, scene: Scene) -> list[dict[str, float]]:
    """Return values of the parameters that say when, where or at which angle."""
    choices: list[list[dict[str, float]]] = []
    others = [parameter for parameter in effect.parameters if not parameter.switches]
    names = {parameter.name for parameter in others}
    x, y = f"{effect.name}_x", f"{effect.name}_y"
    if {x, y} <= names:
        choices.append([{x: float(east), y: float(north)} for east, north in scene.places])
    for parameter in others:
        if parameter.name in (x, y):
            continue
        if parameter.unit == "s":
            moments = (np.arange(MOMENTS) + 1.0) / (MOMENTS + 1.0) * scene.seconds
            choices.append([{parameter.name: float(moment)} for moment in moments])
        elif parameter.unit == "rad":
            choices.append([{parameter.name: 0.0}, {parameter.name: math.pi / 2.0}])
        else:
            choices.append([{parameter.name: float(parameter.typical or 0.0)}])
    return [{name: value for part in parts for name, value in part.items()} for parts in product(*choices)]


def spread_out(points: np.typing.NDArray[np.float64], count: int) -> np.typing.NDArray[np.float64]:
    """Return `count` of the points (n, 2), each as far as possible from those before (farthest-point sampling)."""
    if len(points) == 0:
        return np.zeros((0, 2))
    chosen = [0]
    distance = np.hypot(*(points - points[0]).T)
    while len(chosen) < min(count, len(points)):
        chosen.append(int(np.argmax(distance)))
        distance = np.minimum(distance, np.hypot(*(points - points[chosen[-1]]).T))
    return points[chosen]


def lanes_of(sets: Sequence[Mapping[str, float]]) -> dict[str, object]:
    """Return one array for each parameter that any set has, or a number where all agree; neutral ones are left out."""
    result: dict[str, object] = {}
    for name in dict.fromkeys(name for one in sets for name in one):
        neutral = definition(name).neutral
        column = np.array([one.get(name, neutral) for one in sets], np.float64)
        if np.all(column == column[0]):
            if column[0] != neutral:
                result[name] = float(column[0])
        else:
            result[name] = column
    return result


def step_of(name: str, value: float, scene: Scene) -> float:
    """Return by how much a parameter is moved to see what it does, in its unit."""
    parameter = definition(name)
    if parameter.neutral is None:
        return 1e-3 * abs(value)
    if not parameter.switches:
        return {"s": 0.2, "m": 0.03, "rad": 0.1}.get(parameter.unit, 0.01)
    usual = size(parameter, scene)
    return 0.01 * abs(value) if is_limit(parameter) else 0.05 * usual


def worth_naming(values: Mapping[str, float], scene: Scene, names: Sequence[str]) -> bool:
    """Tell whether an effect is large enough to matter: some parameter of it a fair share of its typical size."""
    sizes = [
        abs(values[name]) >= SMALLEST * size(definition(name), scene)
        for name in names
        if definition(name).switches and not is_limit(definition(name))
    ]
    return not sizes or any(sizes)

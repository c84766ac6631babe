"""Starting values for the fit of each effect in the catalogue, scaled to the robot."""

import math
import re
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from itertools import product

import numpy as np

from cmr.model.catalogue import CATALOGUE, DEFINITIONS, LAWS, definition
from cmr.model.effect import Effect
from cmr.model.extended.statements import changed_by
from cmr.model.parameters import ParameterDefinition, Quantity
from cmr.parameters.file import MOTOR

# The robot that typical sizes refer to; for other robots they are scaled by dimension.
USUAL_ACCELERATION, USUAL_RATE, USUAL_WIDTH, USUAL_TURN = 118.0, 118.0 * 0.054, 0.16, 2.0
USUAL_EXTENT = 1.0  # m of its poses, from their origin
USUAL_INTERVAL = 0.04  # s between poses
LIMITS = (0.35, 0.55, 0.75, 1.0, 1.3, 1.8, 2.6)  # multiples of the typical size at which a limit is tested
THRESHOLDS = (0.4, 1.0, 1.8)  # multiples of the typical size at which a threshold is tested
CHANGED = (0.4, 0.7, 0.9, 1.1, 1.4, 2.0)  # multiples of a known limit or threshold of the robot
# A position measured as p (1 + k |p|^2) folds back where k |p|^2 is below -1/3. A fit cannot get there from other k:
# with the fold in the wrong place, the model is worse than without it.
FOLDS = (0.5, 0.55, 0.6, 0.66, 0.72, 0.79, 0.87, 0.95, 1.05, 1.15, 1.26, 1.4)  # times the typical k, tested negative
TURNS = tuple(eighth * math.pi / 4.0 for eighth in (-3, -2, -1, 1, 2, 3, 4))  # rad
# A gyro that lags by a whole period of the commands resembles the response to the previous command, so smaller
# latencies are tested.
PORTION_OF_LATENCY = 0.4
# Poses that lag by this many typical sizes or more show little of the motion at their stamps: a fit started at 0 does
# not reach the true latency, so larger ones are tested directly.
FAR = 2.0
EVERYWHERE = 1e3  # m, radius of a region that contains everything
# Velocity controllers accelerate more gently than motors can: to the top wheel speed in about a second. [duty/s]
GENTLE = 1.0
DELAYS = tuple(name for name, parameter in DEFINITIONS.items() if parameter.kind == "delay")
# Stages of the model's step that end with the wheel speeds; they are irrelevant if these are given.
DRIVING = frozenset(
    (
        *("start", "packet", "command", "actuator", "voltage", "current", "acceleration", "coupling"),
        *("memory", "robot_memory"),
    )
)
OF_WHEELS = (*DRIVING, "place", "encoder_time", "encoder")
OF_PLACE = frozenset(("x", "y", "theta", "cosine", "sine"))  # a robot's position and heading, as named in statements
# Only commands distinguish these from the wheel radius itself.
AS_THE_RADIUS = tuple(name for name, effect in CATALOGUE.items() if "wheel_radius" in effect.same_without)
# Prior standard deviation of sizes, as a multiple of the typical size. Larger sizes must explain more.
SPREAD, SPREAD_OF_RARE = 5.0, 1.0
SURE = 3.0  # standard deviations
SMALLEST = 0.3  # of the typical size: a smaller effect is not named,
SMALLEST_OF_A_LIMIT = 0.1  # nor is a limit that changed by less than this share


@dataclass(frozen=True)
class Excitation:
    """The known properties of a drive before the search.

    These are the robot's parameters, a usual yaw rate `turning` [rad/s], its usual distance from the origin of the
    poses `extent` [m], a yaw rate that it exceeded at times `fastest` [rad/s], and the usual time between poses
    `interval` [s]. `controlled` says that the commands go to a velocity controller in the robot, `poses_late` [s] is
    the apparent latency of the poses before any model is fitted. `given` are the parameters, by name, of known effects
    of the robot: the search is for deviations from them.
    """

    parameters: Mapping[str, float]
    turning: float
    extent: float = USUAL_EXTENT
    fastest: float = 0.0
    interval: float = USUAL_INTERVAL
    controlled: bool = False
    poses_late: float = 0.0
    laws: frozenset[str] = frozenset()
    given: Mapping[str, float] = field(default_factory=dict)

    def neutral(self, name: str) -> float:
        """Return a parameter's value without a deviation: the given value, otherwise neutral."""
        return self.given.get(name, float(definition(name).neutral or 0.0))

    def gives(self, effect: Effect) -> bool:
        """Return whether the robot is known to have an effect."""
        return effect.is_on(self.given)

    def departs(self, effect: Effect, values: Mapping[str, float]) -> bool:
        """Return whether values change an effect from the given ones, or switch it on if it is not given."""
        if not self.gives(effect):
            return effect.is_on(values)
        own = [one.name for one in effect.parameters if one.switches and one.name in values]
        return any(values[name] != self.neutral(name) for name in own)

    def without(self, values: Mapping[str, float], names: Collection[str]) -> dict[str, float]:
        """Return the values without parameters `names` of effects; given ones take their given values."""
        kept = {name: value for name, value in values.items() if name not in names}
        return {**kept, **{name: self.given[name] for name in names if name in self.given}}


@dataclass(frozen=True)
class Trial:
    """An effect with values of its parameters; `threshold` says that the effect is not proportional to its value.

    An effect that begins at some time is tested as if it had begun with the drive, and one limited to a place as if it
    were everywhere; `local` ("time", "place", or "" for neither) says which is to be located afterwards. A `spare`
    trial is one of many similar ones. `portion` is the size tested as a share of the typical one. `origin` are the
    given values that the trial changes, for a known effect.
    """

    effect: str
    values: Mapping[str, float]
    threshold: bool
    local: str = ""
    spare: bool = False
    portion: float = 1.0
    origin: Mapping[str, float] = field(default_factory=dict)


def size(parameter: ParameterDefinition, excitation: Excitation) -> float:
    """Return the typical size of a parameter on this robot, in its unit."""
    acceleration = excitation.parameters["k2_over_k3"]
    rate = excitation.parameters["k1"] * acceleration
    top = 1.0 / excitation.parameters["k1"]
    factors = {
        "rad/s^2": acceleration / USUAL_ACCELERATION,
        "1/rad": acceleration / USUAL_ACCELERATION / (top * USUAL_RATE / USUAL_ACCELERATION) ** 2,
        "s/rad": USUAL_TURN / excitation.turning,
        "duty/s": rate / USUAL_RATE,
        "1/m^2": min(1.0, (USUAL_EXTENT / max(excitation.extent, 1e-6)) ** 2),
    }
    if excitation.controlled and parameter.kind == "acceleration":
        return GENTLE / (rate if parameter.unit == "duty" else 1.0)
    factor = factors.get(parameter.unit, 1.0)
    if parameter.grows_with_interval:
        factor = max(1.0, excitation.interval / USUAL_INTERVAL)
    if parameter.unit == "m" and parameter.switches:
        factor = excitation.parameters["base_width"] / USUAL_WIDTH
    return float(parameter.typical or 1.0) * factor


def trials(excitation: Excitation, effects: Iterable[Effect] = CATALOGUE.values()) -> list[Trial]:
    """Return all trials, those of one effect side by side."""
    result = []
    for effect in effects:
        if not effect.is_fitted:
            continue
        if excitation.gives(effect):
            result += _changes(effect, excitation)
            continue
        portion = _portion(effect)
        for others in _others(effect):
            result += [
                Trial(effect.name, values | others, threshold, effect.locality, portion=portion)
                for values, threshold in _sizes(effect, excitation)
            ]
        result += [*_folds(effect), *_turned(effect), *_far(effect, excitation)]
    return result


def _portion(effect: Effect) -> float:
    """Return the share of its typical size at which an effect is tested."""
    return PORTION_OF_LATENCY if effect.lateness_of == "gyro" else 1.0


def _changes(effect: Effect, excitation: Excitation) -> list[Trial]:
    """Return trials of a known effect of the robot: each size larger, and limits also smaller."""
    origin = {parameter.name: excitation.neutral(parameter.name) for parameter in effect.parameters}
    portion = _portion(effect)
    result = []
    for parameter in (one for one in effect.parameters if one.switches):
        at = origin[parameter.name]
        if parameter.is_limit or parameter.kind == "threshold":
            changed, threshold = [at * share for share in CHANGED if math.isfinite(at)], True
        else:
            change = portion * size(parameter, excitation)
            changed, threshold = [at + change if parameter.allows(at + change) else at - change], False
        result += [
            Trial(effect.name, {**origin, parameter.name: value}, threshold, portion=portion, origin=origin)
            for value in changed
            if value != at and parameter.allows(value)
        ]
    return result


def _sizes(effect: Effect, excitation: Excitation) -> list[tuple[dict[str, float], bool]]:
    """Return values of the parameters that switch the effect on: each alone, a limit at several sizes."""
    switches = [parameter for parameter in effect.parameters if parameter.switches]
    neutral = {parameter.name: float(parameter.neutral or 0.0) for parameter in switches}
    result = []
    for parameter in switches:
        usual = size(parameter, excitation)
        if parameter.is_limit:
            sizes, threshold = [usual * share for share in LIMITS], True
        elif parameter.kind == "threshold":
            sizes, threshold = [usual * share for share in THRESHOLDS], True
        else:
            sizes, threshold = [usual * _portion(effect)], False
        result += [(neutral | {parameter.name: value}, threshold) for value in sizes if parameter.allows(value)]
    return result


def _folds(effect: Effect) -> list[Trial]:
    """Return trials of a map distorted so much that it folds."""
    return [
        Trial(effect.name, {parameter.name: -share * float(parameter.typical or 0.0)}, threshold=True, spare=True)
        for parameter in effect.parameters
        if parameter.kind == "stretch"
        for share in FOLDS
    ]


def _turned(effect: Effect) -> list[Trial]:
    """Return trials of a sensor rotated by a large angle, which a fit started at a small angle does not reach."""
    return [
        Trial(effect.name, {parameter.name: turn}, threshold=True, spare=True)
        for parameter in effect.parameters
        if parameter.kind == "angle" and parameter.switches
        for turn in TURNS
    ]


def _far(effect: Effect, excitation: Excitation) -> list[Trial]:
    """Return the trial of poses that are as late as they seem, if that is far from 0."""
    return [
        Trial(effect.name, {parameter.name: excitation.poses_late}, threshold=True, spare=True)
        for parameter in effect.parameters
        if effect.lateness_of == "poses" and parameter.kind == "delay"
        if excitation.poses_late > FAR * size(parameter, excitation)
    ]


@cache
def driving_parameters() -> frozenset[str]:
    """Return the parameters that only affect how commands become wheel speeds."""
    return frozenset(
        parameter.name
        for effect in CATALOGUE.values()
        for parameter in effect.parameters
        if all(stage in DRIVING for stage, lines in effect.equations.items() if _speaks_of(lines, parameter.name))
    )


def wheel_parameters(values: Mapping[str, float]) -> frozenset[str]:
    """Return the parameters, of `values` by name, that affect wheel motion and encoder readings.

    If an effect depends on position or heading, all parameters are returned.
    """
    spoken: set[str] = set(MOTOR)
    for effect in CATALOGUE.values():
        if effect.is_on(values):
            spoken |= _words_of_wheels(effect.name)
    return frozenset(values) if spoken & OF_PLACE else frozenset(spoken & set(values))


@cache
def _words_of_wheels(name: str) -> frozenset[str]:
    """Return the variables in an effect's statements on the wheels and their encoders."""
    equations = CATALOGUE[name].equations
    return frozenset(word for stage in OF_WHEELS for word in re.findall(r"\w+", equations.get(stage, "")))


def _speaks_of(lines: str, name: str) -> bool:
    return re.search(rf"\b{name}\b", lines) is not None


def effects_of_rolling(laws: Collection[str] = ()) -> tuple[Effect, ...]:
    """Return the effects that can be seen in a robot driven by its measured wheel speeds, without commands; `laws`
    lists the laws included.
    """
    effects = (e for e in CATALOGUE.values() if set(e.equations) - DRIVING)
    return tuple(e for e in effects if (e.name in laws if e.name in LAWS else not _acts_by_accelerations(e)))


def _acts_by_accelerations(effect: Effect) -> bool:
    """Return whether an effect acts through the wheels' accelerations, which do not exist for given wheel speeds."""
    return any(_speaks_of(lines, "domega") for stage, lines in effect.equations.items() if stage not in DRIVING)


def can_be_small(effect: Effect) -> bool:
    """Return whether an effect has sizes about 0: not a limit, not tied to a time or place, not random."""
    return effect.is_fitted and not effect.locality and not _has_kinks(effect)


def is_rough(effect: Effect) -> bool:
    """Return whether the sum of squares may be discontinuous in the effect's parameters.

    Sticking wheels start a little earlier or not at all, limits and gaps are reached or not, and a time or place
    includes one reading more or less.
    """
    return _has_kinks(effect) or "wheel" in effect.equations or "break_away" in changed_by(effect, "acceleration")


def _has_kinks(effect: Effect) -> bool:
    """Return whether an effect has a limit, a threshold, or a parameter such as a time, that does not switch it on."""
    return any(one.is_limit or one.kind == "threshold" or not one.switches for one in effect.parameters)


def _others(effect: Effect) -> list[dict[str, float]]:
    """Return values of the parameters that do not switch the effect on: from the start, everywhere, at two angles."""
    choices = [[(parameter.name, value) for value in _choices(parameter)] for parameter in effect.parameters]
    return [dict(one) for one in product(*(choice for choice in choices if choice))]


def _choices(parameter: ParameterDefinition) -> list[float]:
    if parameter.switches:
        return []
    if parameter.kind == "angle":
        return [0.0, math.pi / 2.0, math.pi, -math.pi / 2.0]
    if parameter.kind == "radius":
        return [EVERYWHERE]
    return [0.0] if parameter.kind in ("time", "x", "y") else [float(parameter.typical or 0.0)]


def lanes_of(sets: Sequence[Mapping[str, float]]) -> dict[str, Quantity]:
    """Return one array for each parameter that any set has, or a number where all agree; neutral ones are left out."""
    result: dict[str, Quantity] = {}
    for name in dict.fromkeys(name for one in sets for name in one):
        neutral = definition(name).neutral
        column = np.array([one.get(name, neutral) for one in sets], np.float64)
        if np.all(column == column[0]):
            if column[0] != neutral:
                result[name] = float(column[0])
        else:
            result[name] = column
    return result


def step_of(name: str, value: float, excitation: Excitation) -> float:
    """Return the finite-difference step of a parameter, in its unit."""
    parameter = definition(name)
    if parameter.neutral is None:
        return 1e-3 * abs(value)
    if not parameter.switches:
        return {"s": 0.2, "m": 0.03, "rad": 0.1}.get(parameter.unit, 0.01)
    usual = size(parameter, excitation)
    return 0.01 * abs(value) if parameter.is_limit else 0.05 * usual


def rarity(effect: str) -> float:
    """Return how much more a rare effect must lower the sum of squares than another to be preferred to it."""
    return CATALOGUE[effect].rarity if effect in CATALOGUE else 0.0


def unlikelihood(values: Mapping[str, float], excitation: Excitation) -> float:
    """Return the prior penalty of the sizes of effects, as a sum of squares; limits, times and places have none.

    Without it, huge sizes of effects that the data hardly distinguish could cancel each other.
    """
    total = 0.0
    for effect in CATALOGUE.values():
        if can_be_small(effect) and excitation.departs(effect, values):
            spread = SPREAD_OF_RARE if effect.rarity else SPREAD
            usual = [(one.name, spread * size(one, excitation)) for one in effect.parameters]
            total += sum(
                ((values.get(name, 0.0) - excitation.given.get(name, 0.0)) / most) ** 2 for name, most in usual
            )
    return total


def worth_naming(
    values: Mapping[str, float], stds: Mapping[str, float], excitation: Excitation, share: float = 1.0
) -> bool:
    """Return whether an effect is large enough to matter, or at least this `share` of that.

    At least one parameter must be a fair share of its typical size.
    """
    known = [definition(name) for name in values if definition(name).switches]
    sizes = {one.name: share * least_worth_naming(one, excitation) for one in known}
    changes = {name: abs(values[name] - excitation.given.get(name, 0.0)) for name in sizes}
    return any(least == 0.0 or changes[name] > max(least, SURE * stds.get(name, 0.0)) for name, least in sizes.items())


def least_worth_naming(parameter: ParameterDefinition, excitation: Excitation) -> float:
    """Return the smallest size of a parameter that matters, or the smallest change of a given one; 0 for a limit."""
    if parameter.is_limit:
        given = excitation.given.get(parameter.name, math.inf)
        return SMALLEST_OF_A_LIMIT * given if math.isfinite(given) else 0.0
    return SMALLEST * size(parameter, excitation)


def seen_later(values: Mapping[str, float], effect: Effect, seconds: float) -> dict[str, float]:
    """Return the values with the latencies that an effect seems like longer by some seconds, instead of its size."""
    return {**values, **{name: values.get(name, 0.0) + seconds for name in effect.seems_like}}

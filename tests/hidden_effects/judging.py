"""Whether the diagnosis of one log is right, by what was hidden in it. Pure functions of a row."""

import math
from collections.abc import Mapping

from tests.hidden_effects.rows import Row
from tests.hidden_effects.sets import SAME_MATHEMATICS
from tests.reference_plant import TYPICAL

RELATIVE, DEVIATIONS = 0.05, 3.0  # a parameter is right within this share, or within so many standard deviations
LATENCIES = ("pose_latency", "gyro_latency", "command_delay", "wheel_speed_latency")
LATENCY_SHARE = 0.1  # of a latency by which it may be off in windows
SHORTEST_LATENCY = 0.04  # s, of poses; less need not be named
PHASE_SPAN = 1.0  # rad; what a phase is off is compared with
EVERYTHING = "any effect"  # that a recommended drive would show

Interval = tuple[float, float, float, float]  # value, standard deviation, lower and upper end


def twins(effect: str) -> frozenset[str]:
    """Return the effects that are the same mathematics as this one."""
    return next((same - {effect} for same in SAME_MATHEMATICS if effect in same), frozenset())


def names(row: Row, rank: int, effect: str) -> bool:
    """Tell whether the effect named at this rank is this one.

    Of effects that are the same mathematics either name counts, if the others stand beside it.
    """
    same = twins(effect) | {effect}
    name = row.names[rank]
    return name in same and same - {name} <= set(row.indistinguishable[rank])


def may_be(row: Row, rank: int, effect: str) -> bool:
    """Tell whether the effect named at this rank is this one, or is said not to be told from it."""
    return row.names[rank] == effect or effect in row.indistinguishable[rank]


def right_first(row: Row) -> bool:
    """Tell whether the first effect named is the hidden one."""
    return bool(row.names) and names(row, 0, row.case.effects[0])


def wrongly_named(row: Row) -> bool:
    """Tell whether an effect is named that is not hidden, without a hidden one beside it."""
    return any(not any(may_be(row, rank, effect) for effect in row.case.effects) for rank in range(len(row.names)))


def all_named(row: Row) -> bool:
    """Tell whether all hidden effects are named."""
    ranks = range(len(row.names))
    return all(any(names(row, rank, effect) for rank in ranks) for effect in row.case.effects)


def large(row: Row) -> tuple[str, ...]:
    """Return the hidden effects that are large enough to be named: not a latency of less than a usual pose's time."""
    return tuple(e for e in row.case.effects if e != "pose_latency" or row.parameters[e] > SHORTEST_LATENCY)


def hidden_first(row: Row) -> bool:
    """Tell whether the first effect named is one of those hidden; if none is large enough, there need be no name."""
    if not row.names:
        return not row.error and not large(row)
    return any(names(row, 0, effect) for effect in row.case.effects)


def all_large_named(row: Row) -> bool:
    """Tell whether all hidden effects are named that are large enough."""
    return not row.error and all(any(names(row, k, effect) for k in range(len(row.names))) for effect in large(row))


def latencies_right(row: Row) -> list[bool]:
    """Tell of each hidden latency that was found, or should have been, whether it is right."""
    result = []
    for name in (name for name in LATENCIES if name in row.case.effects):
        value, std = row.estimates.get(name, (0.0, 0.0, 0.0, 0.0))[:2]
        if name in row.estimates or name in large(row):
            true = row.parameters[name]
            result.append(abs(value - true) <= max(LATENCY_SHARE * true, DEVIATIONS * std))
    return result


def flagged(row: Row) -> bool:
    """Tell whether the diagnosis says that something remains which it cannot explain."""
    return row.verdict == "unexplained" or row.unexplained


def silent(row: Row) -> bool:
    """Tell whether the diagnosis finds nothing: no name, and nothing that it calls unexplained."""
    return row.verdict == "no_effect" and not row.names and not flagged(row)


def parameters_of(row: Row) -> dict[str, tuple[float, Interval]]:
    """Return truth and estimate of every parameter of the hidden effects that was estimated, by its name.

    Where the same mathematics goes by another name, the truth is what that name's parameter is then.
    """
    result = {}
    for name, true in row.parameters.items():
        for other in (name, *twins(name)):
            if other in row.estimates:
                result[other] = (true if other == name else 1.0 / (1.0 + true) - 1.0, row.estimates[other])
                break
    return result


def parameters_right(row: Row) -> bool:
    """Tell whether all parameters of what is hidden are within 5 % or three standard deviations."""
    estimated = parameters_of(row)
    own = {name for effect in row.case.effects for name in TYPICAL[effect]}
    return len(estimated) >= len(own) and all(_right(row, name, *pair) for name, pair in estimated.items())


def covered(row: Row) -> list[bool]:
    """Tell for each parameter of what is hidden whether its 95 % interval holds the truth."""
    return [
        estimate[2] <= estimate[0] - _error(name, true, estimate) <= estimate[3]
        for name, (true, estimate) in parameters_of(row).items()
    ]


def covered_of_paper(row: Row, estimates: Mapping[str, Interval]) -> list[bool]:
    """Tell for each of the paper's parameters that was estimated whether its 95 % interval holds the truth."""
    return [estimate[2] <= row.robot[name] <= estimate[3] for name, estimate in estimates.items()]


def told_as_hidden(row: Row) -> bool:
    """Tell whether just what is hidden is named, by its own name: the paper's parameters then mean what they do."""
    return set(row.names) == set(row.case.effects)


def _right(row: Row, name: str, true: float, estimate: Interval) -> bool:
    allowed = max(RELATIVE * _span(row, name, true), DEVIATIONS * estimate[1])
    return abs(_error(name, true, estimate)) <= allowed


def _error(name: str, true: float, estimate: Interval) -> float:
    off = estimate[0] - true
    return math.remainder(off, 2.0 * math.pi) if name.endswith("_phase") else off


def _span(row: Row, name: str, true: float) -> float:
    """Return what 5 % are of: the size of what is hidden, not of its share along x or of where it is."""
    if name.startswith("slope"):
        return math.hypot(row.parameters["slope_x"], row.parameters["slope_y"])
    if name in ("surface_patch_x", "surface_patch_y"):
        return row.parameters["surface_patch_radius"]
    return PHASE_SPAN if name.endswith("_phase") else abs(true)


def is_timed(row: Row) -> bool:
    """Tell whether the time of the diagnosis was measured."""
    return math.isfinite(row.cpu_seconds)


def tells_what_next(row: Row) -> bool:
    """Tell whether nothing is named, but a drive in which what is hidden would show: one for it, or for any effect."""
    words = [effect.replace("_", " ") for effect in row.case.effects]
    shown = any(word in row.next_experiment.lower() for word in (*words, EVERYTHING))
    return row.verdict == "no_effect" and shown

"""The numbers that decide about an effect, each with its limit and a sentence with the comparison."""

import math
from collections.abc import Iterable, Mapping

from cmr.estimation.candidates import SURE, Excitation, least_worth_naming
from cmr.estimation.search.trace import Measure
from cmr.model.catalogue import definition
from cmr.model.effect import Effect

LIKELIHOOD_RATIO = "likelihood_ratio"


def with_unit(value: float, unit: str) -> str:
    """Return a value with its unit, two significant digits; the unit "-" is left out."""
    number = f"{value:#.2g}".rstrip(".") if abs(value) < 99.5 else f"{value:.0f}"
    return number if unit in ("", "-") else f"{number} {unit}"


def too_small_to_be_named(measures: Iterable[Measure]) -> str:
    """Return a sentence that lists sizes of effects with the limits that they are below."""
    sizes = [f"{one.quantity} {with_unit(abs(one.value), '')} < {with_unit(one.limit, one.unit)}" for one in measures]
    return f"Too small to be named: {', '.join(sizes)}."


def size_below_limit(
    effect: Effect, values: Mapping[str, float], stds: Mapping[str, float], excitation: Excitation
) -> Measure | None:
    """Return by how much an effect is too small to be named; None if it is large enough (`worth_naming`).

    Of several parameters, it is the one nearest to its limit. `stds` are the standard deviations that are known.
    """
    switches = [definition(one.name) for one in effect.parameters if one.switches]
    changes = {one.name: values[one.name] - excitation.given.get(one.name, 0.0) for one in switches}
    leasts = {one.name: least for one in switches if (least := least_worth_naming(one, excitation)) > 0.0}
    if len(leasts) < len(switches) or not switches:
        return None
    limits = {name: max(least, SURE * stds.get(name, 0.0)) for name, least in leasts.items()}
    if any(abs(changes[name]) > limit for name, limit in limits.items()):
        return None
    name = max(limits, key=lambda one: abs(changes[one]) / limits[one])
    limit, least = limits[name], leasts[name]
    unit, what = definition(name).unit, "Its size" if len(effect.parameters) == 1 else f"Its {name}"
    if excitation.gives(effect):
        what = f"The change of {name}"
    written, least_written = with_unit(changes[name], unit), with_unit(limit, unit)
    if limit > least:
        sentence = f"{what}, {written}, is less than {SURE:g} of its standard deviations, {least_written}."
    else:
        sentence = f"{what}, {written}, is below what matters here, {least_written}."
    return Measure(name, changes[name], limit, unit, sentence)


def likelihood_ratio(drop: float, least: float, *, unusual: bool = False) -> Measure:
    """Return the likelihood ratio of an effect that is below its threshold, which is higher for unusual sizes."""
    threshold = (
        f"the threshold for sizes as unusual as these, {least:.1f}." if unusual else f"the threshold, {least:.1f}."
    )
    return Measure(LIKELIHOOD_RATIO, drop, least, "-", f"Its likelihood ratio, {drop:.1f}, is below {threshold}")


def moment_at_an_end(name: str, moment: float, moving: tuple[float, float]) -> Measure:
    """Return the moment [s] at which an effect would begin, when the robot has hardly moved or will hardly move."""
    first = moment <= moving[0]
    limit, end = (moving[0], "earliest") if first else (moving[1], "latest")
    sentence = f"It would begin at {moment:.1f} s; this drive can show a change at {limit:.1f} s at the {end}."
    return Measure(name, moment, limit, "s", sentence)


def place_everywhere(name: str, reach: float, extent: float) -> Measure:
    """Return the radius around the origin [m] of a place that contains the whole drive."""
    sentence = f"The place would contain all of the drive, {with_unit(extent, 'm')} around the start."
    return Measure(name, reach, extent, "m", sentence)


def turns_exceeded(name: str, value: float, seen: float) -> Measure:
    """Return a limit [rad/s] of the turns that the robot exceeded in the measurements."""
    sentence = f"It limits turns to {value:.2g} rad/s, but the robot was measured at {seen:.2g} rad/s."
    return Measure(name, value, seen, "rad/s", sentence)


def implausible_change(name: str, factor: float, most: float) -> Measure:
    """Return the factor by which a parameter of the paper's would change."""
    factor = max(factor, 1.0 / factor) if factor > 0.0 else math.inf
    sentence = f"With it, {name} would change by a factor of {factor:.1f}; at most {most:g} is plausible."
    return Measure(f"{name}_factor", factor, most, "-", sentence)


def at_the_end(name: str, value: float) -> Measure:
    """Return a value that is at the end of its parameter's range."""
    unit = definition(name).unit
    return Measure(name, value, value, unit, f"{name} would be at the end of its range, {with_unit(value, unit)}.")


def undetermined(name: str, std: float) -> Measure:
    """Return the standard deviation of a parameter that the data do not determine."""
    return Measure(f"{name}_std", std, math.nan, definition(name).unit, f"These drives do not determine {name}.")


def left_out_gain(gain: float) -> Measure:
    """Return the log-likelihood that an effect adds on data left out of the fit."""
    sentence = f"On data left out of the fit it adds {gain:.1f} to the log-likelihood; this must be more than 0."
    return Measure("left_out_log_likelihood", gain, 0.0, "-", sentence)


def of_one_moment(rest: float, least: float, seconds: float) -> Measure:
    """Return the gain of an effect without the moment in which it explains most."""
    sentence = (
        f"Without the {seconds:.2g} s in which it explains most, it lowers -2 log likelihood by {rest:.1f}; "
        f"{least:.1f} would be needed."
    )
    return Measure("likelihood_ratio_of_other_moments", rest, least, "-", sentence)


def readings_lost(rise: float, most: float) -> Measure:
    """Return by how much less likely an effect of a sensor makes that sensor's readings."""
    sentence = (
        f"It raises -2 log likelihood of its own sensor's readings by {rise:.1f}; at most {most:.1f} may be chance."
    )
    return Measure("likelihood_ratio_of_its_readings", rise, most, "-", sentence)


def coarse_tick(tick: float, coarse: float) -> Measure:
    """Return the size [rad] of a coarse encoder's tick."""
    sentence = f"One tick of the encoders is {tick:.2g} rad; more than {coarse:.2g} rad is coarse."
    return Measure("tick", tick, coarse, "rad", sentence)

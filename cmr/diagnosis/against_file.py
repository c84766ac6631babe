"""Compare a robot with a parameter file: differences in effects and in other parameters."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

from cmr.diagnosis.result import (
    EFFECTS_FOUND,
    LAW_FOUND,
    NO_EFFECT,
    PARAMETERS_DIFFER,
    UNEXPLAINED,
    Against,
    Departure,
    Diagnosis,
    NamedEffect,
)
from cmr.estimation.candidates import SMALLEST, SURE, Excitation, size
from cmr.estimation.estimates import Estimate
from cmr.estimation.estimation import Estimation
from cmr.estimation.gain import Gain, with_mean_of_chance
from cmr.estimation.search.measures import with_unit
from cmr.model.catalogue import CATALOGUE, definition
from cmr.parameters.file import ParameterFile

# Share of a value by which a parameter must differ to be reported. Motor response is less well known.
LEAST_SHARE = 0.02
LEAST_SHARES = {"k2_over_k3": 0.05, "response_time": 0.05}


def with_given_baseline(estimation: Estimation) -> Estimation:
    """Return the estimation with the robot as given as baseline, instead of the fit with its effects."""
    if estimation.whole is None or estimation.nominal is None:
        return estimation
    found = estimation.found
    base = replace(found.base, values={**found.base.values, **estimation.nominal.values})
    extended = replace(estimation.whole.extended, found=replace(found, base=base))
    return replace(estimation, whole=replace(estimation.whole, extended=extended))


def compared(diagnosis: Diagnosis, estimation: Estimation, file: ParameterFile, against: Against) -> Diagnosis:
    """Return the diagnosis of a robot compared with that of a `file`, by its differences from it.

    The errors of the file's robot are those of the baseline, and the gain is over them. Without differences, the file's
    robot is also the extended one.
    """
    assert diagnosis.extended is not None
    given = {name: value.value for name, value in file.values.items()}
    excitation = estimation.found.problem.excitation
    effects = tuple(
        _with_given(one, given, against)
        for one in diagnosis.effects
        if not _is_known(one, diagnosis.effects, given, excitation)
    )
    departures = tuple(_departures(diagnosis.extended.estimates, given))
    against = replace(against, effects=file.effects, departures=departures)
    result = replace(
        diagnosis,
        against=against,
        effects=effects,
        verdict=_verdict(effects, departures, diagnosis),
        baseline=diagnosis.nominal,
        gain=diagnosis.gain_over_nominal,
        nominal=None,
        gain_over_nominal=None,
    )
    return replace(result if result.is_extended else _as_the_file_has_it(result, given), sentence=_sentence(result))


def _is_known(
    one: NamedEffect, named: Sequence[NamedEffect], given: Mapping[str, float], excitation: Excitation
) -> bool:
    """Return whether a named effect is present as in the file.

    Random effects, and those read off the data, are not part of a fit, and so are found again whatever the file says.
    So is the mean delay of jitter if its spread cannot be distinguished from a delay.
    """
    rivals = {*one.indistinguishable_from} - {other.name for other in named}
    by_chance = [name for name, effect in CATALOGUE.items() if name in rivals and one.name in effect.on_average]
    if by_chance:
        given = with_mean_of_chance(given, {name: given.get(name, 0.0) for name in by_chance})
    elif CATALOGUE[one.name].is_fitted:
        return False
    return all(name in given and _is_as_given(name, of, given[name], excitation) for name, of in one.estimates.items())


def _is_as_given(name: str, estimate: Estimate, given: float, excitation: Excitation) -> bool:
    """Return whether a size does not differ from that in the file significantly and by more than is worth naming."""
    least = SMALLEST * size(definition(name), excitation)
    return abs(estimate.value - given) <= max(least, SURE * estimate.std)


def _with_given(one: NamedEffect, given: Mapping[str, float], against: Against) -> NamedEffect:
    """Return a named effect with its values in the file, if present there, and with both in its sentence."""
    known = {name: given[name] for name in one.estimates if name in given}
    if not known:
        return one
    changes = [
        f"{name} is {with_unit(one.estimates[name].value, definition(name).unit)}, in the file "
        f"{with_unit(value, definition(name).unit)}"
        for name, value in known.items()
        if definition(name).switches
    ]
    return replace(one, given=known, cause=f"{one.cause} {against.name} has it in another size: {'; '.join(changes)}.")


def _departures(estimates: Mapping[str, Estimate], given: Mapping[str, float]) -> Iterator[Departure]:
    """Yield the parameters, except those of effects, that differ from the file significantly and by more than a
    little.
    """
    for name, estimate in estimates.items():
        if name in given and definition(name).neutral is None:
            least = LEAST_SHARES.get(name, LEAST_SHARE) * abs(given[name])
            if abs(estimate.value - given[name]) > max(least, SURE * estimate.std):
                yield Departure(name=name, given=given[name], estimate=estimate)


def _verdict(effects: Sequence[NamedEffect], departures: Sequence[Departure], diagnosis: Diagnosis) -> str:
    if effects:
        return EFFECTS_FOUND
    if diagnosis.laws.found:
        return LAW_FOUND
    if diagnosis.unexplained.present:
        return UNEXPLAINED
    return PARAMETERS_DIFFER if departures else NO_EFFECT


def _as_the_file_has_it(diagnosis: Diagnosis, given: Mapping[str, float]) -> Diagnosis:
    """Return the diagnosis for a robot that agrees with the file."""
    gain = diagnosis.gain
    if gain is not None:
        gain = Gain(ratio=1.0, interval=(1.0, 1.0), signals=dict.fromkeys(gain.signals, 1.0))
    return replace(diagnosis, extended=diagnosis.baseline, parameters=given, gain=gain)


def _sentence(diagnosis: Diagnosis) -> str:
    """Return a sentence on the differences from the file, and which file it is."""
    against = diagnosis.against
    assert against is not None
    file = f"{against.name} (sha256 {against.sha256[:12]})"
    if diagnosis.verdict in (LAW_FOUND, UNEXPLAINED):
        return f"Against {file}: {diagnosis.sentence}"
    parts = [effect.cause for effect in diagnosis.effects]
    parts += [
        f"{one.name} is {one.estimate.value:.4g} {definition(one.name).unit}, in the file {one.given:.4g}."
        for one in against.departures
    ]
    if parts:
        rest = " There remain errors that no effect of the catalogue explains." if diagnosis.unexplained.present else ""
        return f"The robot departs from {file}. {' '.join(parts)}{rest}"
    unseen = len(diagnosis.not_visible)
    effects = "effect" if unseen == 1 else "effects"
    but = f", but {unseen} {effects} of the catalogue would not be visible in these drives" if unseen else ""
    return f"The robot is that of {file}: nothing that departs from it is large enough to be named{but}."

"""Finish a search: drop what has become redundant or does not matter, make sure of the values, put in order."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from cmr.diagnosis.candidates import locality, worth_naming
from cmr.diagnosis.fitting import Fit
from cmr.diagnosis.inflation import Inflation
from cmr.diagnosis.judging import TOO_SMALL, Named, Tried, held_out_gain, needed, why_not
from cmr.diagnosis.placing import explored
from cmr.diagnosis.polishing import polished
from cmr.diagnosis.study import Study
from cmr.model.parameters import DEFINITIONS as PAPER


@dataclass(frozen=True)
class Finished:
    """The effects named, each judged beside all others, and the final fit with what is to be added to its doubts.

    `dropped` are effects that did not stand this, and why.
    """

    named: list[Named]
    dropped: list[tuple[Tried, str]]
    final: Fit
    doubts: Mapping[str, float]


def finished(study: Study, named: Sequence[Named], current: Fit, inflation: Inflation) -> Finished:
    """Finish a search that named some effects, with `current` as its last fit."""
    standing, small, final = _without_small(study, named, current)
    dropped = [(tried, TOO_SMALL) for tried in small]
    doubts: dict[str, float] = {}
    for one in standing:
        final, doubt = _made_sure(study, final, one)
        doubts.update(doubt)
    while standing:
        alone = len(standing) == 1 and not dropped
        standing = [_at(final, standing[0])] if alone else _beside_the_others(study, standing, final)
        reasons = [why_not(study, one.before, one.tried, inflation) for one in standing]
        failing = [(one, why) for one, why in zip(standing, reasons, strict=True) if why not in ("", TOO_SMALL)]
        if not failing:
            break
        worst, why = min(failing, key=lambda pair: pair[0].tried.drop)
        dropped.append((worst.tried, why))
        standing = [one for one in standing if one is not worst]
        final = worst.before
    both = {name: float(np.hypot(doubt, doubts.get(name, 0.0))) for name, doubt in study.doubts(final).items()}
    return Finished(standing, dropped, final, {**doubts, **both})


def _made_sure(study: Study, fit: Fit, one: Named) -> tuple[Fit, dict[str, float]]:
    names = [parameter.name for parameter in one.tried.effect.parameters]
    return explored(study, fit, names) if locality(one.tried.effect) == "place" else polished(study, fit, names)


def _at(final: Fit, one: Named) -> Named:
    """Return an effect that stands alone with its final values: what it explains is known."""
    return replace(one, tried=replace(one.tried, values=final.values, fit=final))


def _beside_the_others(study: Study, standing: Sequence[Named], final: Fit) -> list[Named]:
    """Return each effect with what it explains beside all others, and the fit without it."""
    result = []
    for one, before in zip(standing, study.fits([_left_out(one, final) for one in standing], final.noise), strict=True):
        drop, held_out = before.squares - final.squares, held_out_gain(study, before, final)
        result.append(replace(one, before=before, tried=Tried(one.tried.effect, drop, final.values, final, held_out)))
    return result


def _left_out(one: Named, final: Fit) -> tuple[dict[str, float], tuple[str, ...]]:
    """Return where a fit without an effect begins, and what is free in it.

    What the paper's parameters were before the effect came in is nearer to what they are without it.
    """
    values, names = without(final, [one])
    return {**values, **{name: value for name, value in one.before.values.items() if name in PAPER}}, names


def _without_small(study: Study, named: Sequence[Named], current: Fit) -> tuple[list[Named], list[Tried], Fit]:
    """Return the effects that matter, those that do not, with their values, and the fit without these."""
    matters = [_matters(study, one, current) for one in named]
    small = [one for one, does in zip(named, matters, strict=True) if not does]
    if not small:
        return list(named), [], current
    fit = study.fit(*without(current, small), current.noise, renew=0)
    tried = [replace(one.tried, values=current.values) for one in small]
    return [one for one, does in zip(named, matters, strict=True) if does], tried, fit


def _matters(study: Study, one: Named, fit: Fit) -> bool:
    names = [parameter.name for parameter in one.tried.effect.parameters]
    values, stds = {name: fit.values[name] for name in names}, {name: fit.std(name) for name in names}
    return worth_naming(values, stds, study.scene)


def pruned(study: Study, named: list[Named], current: Fit, inflation: Inflation) -> tuple[list[Named], Fit]:
    """Drop effects that the others have made redundant."""
    unsure = list(named)
    while unsure:
        fits = study.fits([without(current, [one]) for one in unsure], current.noise)
        enough = [needed(one.tried.effect) * inflation.of(one.tried.effect.name) for one in unsure]
        redundant = [fit.squares - current.squares < least for fit, least in zip(fits, enough, strict=True)]
        if not any(redundant):
            break
        first = redundant.index(True)
        named = [one for one in named if one is not unsure[first]]
        current, unsure = fits[first], unsure[first + 1 :]
    return named, current


def without(fit: Fit, effects: Sequence[Named]) -> tuple[dict[str, float], tuple[str, ...]]:
    """Return the values of a fit, and the names of what is free in it, without some effects."""
    own = {parameter.name for one in effects for parameter in one.tried.effect.parameters}
    values = {name: value for name, value in fit.values.items() if name not in own}
    return values, tuple(name for name in fit.names if name not in own)

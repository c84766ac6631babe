"""Finish a search: drop what has become redundant or does not matter, make sure of the values, put in order."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from cmr.diagnosis.candidates import locality, worth_naming
from cmr.diagnosis.inflation import Inflation
from cmr.diagnosis.judging import TOO_SMALL, Named, Tried, held_out_gain, needed, why_not
from cmr.diagnosis.placing import explored
from cmr.diagnosis.polishing import polished
from cmr.diagnosis.study import Fit, Study
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
        standing = [_at(final, one) if alone else _beside_the_others(study, one, final) for one in standing]
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


def _beside_the_others(study: Study, one: Named, final: Fit) -> Named:
    """Return an effect with what it explains beside all others, and the fit without it."""
    own = {parameter.name for parameter in one.tried.effect.parameters}
    names = tuple(name for name in final.names if name not in own)
    # What the paper's parameters were before the effect came in is nearer to what they are without it.
    values = {name: value for name, value in final.values.items() if name not in own}
    values |= {name: value for name, value in one.before.values.items() if name in PAPER}
    before = study.fit(values, names, final.noise, renew=0)
    drop, held_out = before.squares - final.squares, held_out_gain(study, before, final)
    return replace(one, before=before, tried=Tried(one.tried.effect, drop, final.values, final, held_out))


def _without_small(study: Study, named: Sequence[Named], current: Fit) -> tuple[list[Named], list[Tried], Fit]:
    """Return the effects that matter, those that do not, with their values, and the fit without these."""
    matters = [_matters(study, one, current) for one in named]
    small = [one for one, does in zip(named, matters, strict=True) if not does]
    if not small:
        return list(named), [], current
    own = {parameter.name for one in small for parameter in one.tried.effect.parameters}
    values = {name: value for name, value in current.values.items() if name not in own}
    fit = study.fit(values, tuple(name for name in current.names if name not in own), current.noise, renew=0)
    tried = [replace(one.tried, values=current.values) for one in small]
    return [one for one, does in zip(named, matters, strict=True) if does], tried, fit


def _matters(study: Study, one: Named, fit: Fit) -> bool:
    names = [parameter.name for parameter in one.tried.effect.parameters]
    values, stds = {name: fit.values[name] for name in names}, {name: fit.std(name) for name in names}
    return worth_naming(values, stds, study.scene)


def pruned(study: Study, named: list[Named], current: Fit, inflation: Inflation) -> tuple[list[Named], Fit]:
    """Drop effects that the others have made redundant."""
    for one in list(named):
        own = {parameter.name for parameter in one.tried.effect.parameters}
        names = tuple(name for name in current.names if name not in own)
        values = {name: value for name, value in current.values.items() if name not in own}
        without = study.fit(values, names, current.noise, renew=0)
        if without.squares - current.squares < needed(one.tried.effect) * inflation.of(one.tried.effect.name):
            named = [other for other in named if other is not one]
            current = without
    return named, current

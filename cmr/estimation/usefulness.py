"""Final verdict: remove effects that do not help on left-out data.

With E_s(m) the root mean square error of signal s of a model m on left-out data, an effect k stays if

    max_s E_s(without k) / E_s(with k) >= OF_USE

over wheel speeds, yaw rate and path of free runs or, for an effect of a sensor, the one-step prediction errors of its
readings. With all effects, no free-run error may grow much. Held-out recordings have a veto: their path error must not
become significantly worse (95 % interval of the ratio).
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from cmr.estimation.averaging import Posterior, averaged, averaged_about
from cmr.estimation.candidates import can_be_small
from cmr.estimation.gain import Gain, Measured, left_out_gains, measure
from cmr.estimation.gauss_newton import Fit
from cmr.estimation.search.criteria import TOO_SMALL, SelectedEffect, left_out_errors
from cmr.estimation.search.elimination import without
from cmr.estimation.search.selection import Search
from cmr.estimation.search.trace import Measure, with_removed
from cmr.estimation.segments import Segment
from cmr.estimation.unexplained.extending import Extended, chance_of
from cmr.model.catalogue import CATALOGUE

# Limits of the gain: significantly below the first, on left-out parts or held-out recordings, or, for any signal, below
# the last, unless significant.
WORSE, WORSE_HELD_OUT, MUCH_WORSE = 0.95, 1.0, 0.8
OF_USE = 1.01  # least growth of some error without an effect
TAKEN_BACK = "Free runs on data left out of the fit are less accurate with it."
IN_WORDS = {
    "psi": "the wheel speeds of free runs",
    "yaw_rate": "the yaw rate of free runs",
    "pose": "the path of free runs",
}


class _Use(NamedTuple):
    """The usefulness of an effect: the largest growth of an error without it, with a sentence; `vetoed` by held-out
    data.

    Vetoed effects are ordered first.
    """

    ratio: float
    measure: Measure
    vetoed: bool = False


@dataclass(frozen=True)
class Whole:
    """The search result and the average over undetected effects; the latter None if one-step errors are useless.

    It is also None if the average itself predicts worse than the paper's model; `extra_stds` then contain the standard
    deviations of an average about the fit. They are additional standard deviations of some parameters of the final
    model.
    """

    extended: Extended
    average: Posterior | None
    extra_stds: Mapping[str, float]

    @property
    def model(self) -> Fit | Posterior:
        """The final model."""
        return self.extended.final if self.average is None else self.average


def that_holds(whole: Extended, segments: Sequence[Segment], held_out: Sequence[Segment]) -> tuple[Whole, Measured]:
    """Return the model without effects that are useless in free runs, and its errors.

    The fit with the named effects is judged, and the average about it returned: an average shrinks doubtful effects.
    """
    judge, extra_stds = _Judge(segments, held_out), whole.found.extra_stds
    whole = judge.of_use(whole)
    found = whole.found
    measured = measure(found.problem, found.base, whole.final, chance_of(found), segments, held_out)
    while judge.deviates(measured.gain, whole) and (whole.term or _fitted(found)):
        whole = _as_the_paper_if_alone(judge.without_the_worst(whole))
        found = whole.found
        measured = measure(found.problem, found.base, whole.final, chance_of(found), segments, held_out)
    if not found.problem.one_step:
        return Whole(whole, None, found.extra_stds), measured
    names = [one.candidate.effect.name for one in found.named]
    undisputed = [one.candidate.effect.name for one in found.named if not one.rivals]
    average = averaged(found.problem, _with_what_is_small(whole), found.inflation, names, undisputed)
    of_average = measure(found.problem, found.base, average, chance_of(found), segments, held_out)
    if judge.deviates(of_average.gain, whole) and not judge.deviates(measured.gain, whole):
        about = averaged_about(found.problem, whole.final, found.inflation, names)
        return Whole(whole, None, _with_those_of(about, whole.final, found.extra_stds)), measured
    return Whole(whole, average, extra_stds), of_average


def _with_those_of(average: Posterior, fit: Fit, extra_stds: Mapping[str, float]) -> dict[str, float]:
    """Return the extra_stds of a fit that replaces an average: the undetected effects remain possible."""
    apart = {name: np.hypot(average.std(name), average.values[name] - fit.values[name]) for name in fit.names}
    return {name: float(np.hypot(extra_stds.get(name, 0.0), own)) for name, own in apart.items()}


@dataclass(frozen=True)
class _Judge:
    """Free runs in the `segments` that a model was fitted to, and in those that the user held out, if any."""

    segments: Sequence[Segment]
    held_out: Sequence[Segment]

    def deviates(self, gain: Gain, whole: Extended) -> bool:
        """Return whether the whole model is worse than the paper's.

        Free runs do not use sensors: if the model has only laws of sensors in addition, its parameters may still differ
        slightly.
        """
        if gain.interval[0] > 1.0:
            return False
        worse = WORSE_HELD_OUT if self.held_out and not whole.only_reads_otherwise else WORSE
        return gain.interval[1] < worse or any(ratio < MUCH_WORSE for ratio in gain.signals.values())

    def of_use(self, whole: Extended) -> Extended:
        """Return the model without the effects that are too small to matter, the least useful first.

        If effects too small to be named are omitted, others compensate for them and may appear useless. Such an effect
        is judged again beside them.
        """
        while fitted := _fitted(whole.found):
            use = self._use(whole, whole.final, fitted)
            weak = [number for number, one in enumerate(use) if one.ratio < OF_USE and not one.vetoed]
            beside = _beside_what_is_small(whole) if weak else None
            again = self._use(whole, beside, [fitted[number] for number in weak]) if beside else []
            for number, one in zip(weak, again, strict=False):
                use[number] = one if one.vetoed or one.ratio >= OF_USE else use[number]
            worst = min(range(len(use)), key=lambda number: (not use[number].vetoed, use[number].ratio))
            if use[worst].ratio >= OF_USE and not use[worst].vetoed:
                break
            why = TAKEN_BACK if use[worst].vetoed else TOO_SMALL
            whole = _as_the_paper_if_alone(_without(whole, fitted[worst], why, use[worst].measure))
        return _as_the_paper_if_alone(whole)

    def _use(self, whole: Extended, model: Fit, fitted: Sequence[SelectedEffect]) -> list[_Use]:
        """Return the usefulness of each effect in a model: which error grows most without it."""
        problem, chance = whole.found.problem, chance_of(whole.found)
        without_it = problem.without(model, [[one.candidate.effect] for one in fitted])
        gains = left_out_gains(problem, without_it, model, chance, self.segments, [])
        ratios = [
            {**_in_words(gain), **_of_readings(whole, one, fit, model)}
            for one, fit, gain in zip(fitted, without_it, gains, strict=True)
        ]
        if not self.held_out:
            return [_largest(one) for one in ratios]
        of_held_out = left_out_gains(problem, without_it, model, chance, self.segments, self.held_out)
        return [
            _vetoed(gain) if _speaks_against(gain) else _largest({**one, **_in_words(gain, " in held-out recordings")})
            for one, gain in zip(ratios, of_held_out, strict=True)
        ]

    def without_the_worst(self, whole: Extended) -> Extended:
        """Return the model without its laws or generic term, or without the effect that gains least."""
        if whole.term:
            return whole.without_term()
        fitted = _fitted(whole.found)
        problem, chance = whole.found.problem, chance_of(whole.found)
        without_it = problem.without(whole.final, [[one.candidate.effect] for one in fitted])
        gains = left_out_gains(problem, without_it, whole.final, chance, self.segments, self.held_out)
        worst = int(np.argmin([_of_path(gain) for gain in gains]))
        where = "in the held-out recordings" if self.held_out else "on left-out data"
        return _without(whole, fitted[worst], TAKEN_BACK, _of_little_use(_of_path(gains[worst]), where))


def _beside_what_is_small(whole: Extended) -> Fit | None:
    """Return the fit that includes effects too small to be named; None if there are none."""
    seen = whole.found.seen
    more = seen is not None and set(whole.final.names) < set(seen.names)
    return seen if more and not whole.term and whole.found.problem.one_step else None


def _of_readings(whole: Extended, one: SelectedEffect, without_it: Fit, model: Fit) -> dict[str, float]:
    """Return the growth of each signal's left-out errors without a sensor effect, by description.

    Each fold is predicted by fits without it, to first order.
    """
    if not one.candidate.effect.is_sensor:
        return {}
    problem = whole.found.problem
    signal = np.concatenate([np.full(len(times), name) for p in problem.predictors for name, times in p.times.items()])
    before, after = (left_out_errors(fit, problem.folds) for fit in (without_it, model))
    return {
        f"the one-step prediction of the {name.replace('_', ' ')}": float(
            np.linalg.norm(before[signal == name]) / np.linalg.norm(after[signal == name])
        )
        for name in map(str, np.unique(signal))
    }


def _in_words(gain: Gain, where: str = "") -> dict[str, float]:
    """Return the ratios of a gain by description."""
    return {IN_WORDS.get(name, name) + where: ratio for name, ratio in gain.signals.items()}


def _largest(ratios: Mapping[str, float]) -> _Use:
    """Return the largest of some ratios of errors without an effect to those with it; 0 if there are none."""
    if not ratios:
        return _Use(0.0, Measure("error_ratio", math.nan, OF_USE, "-", "No error was measured that it could reduce."))
    what = max(ratios, key=lambda name: ratios[name])
    sentence = (
        f"Without it no error on left-out data grows by {100.0 * (OF_USE - 1.0):.0f} % or more: the largest change is "
        f"{100.0 * (ratios[what] - 1.0):+.2f} %, in {what}."
    )
    return _Use(ratios[what], Measure("error_ratio", ratios[what], OF_USE, "-", sentence))


def _vetoed(gain: Gain) -> _Use:
    """Return the usefulness of an effect that makes paths of held-out recordings worse."""
    low, high = (1.0 / ratio for ratio in reversed(gain.interval))
    sentence = (
        f"On the held-out recordings the path error of free runs is {1.0 / gain.ratio:.2f} times as large with it "
        f"(95 %: {low:.2f} to {high:.2f})."
    )
    return _Use(gain.ratio, Measure("held_out_error_ratio", gain.ratio, WORSE_HELD_OUT, "-", sentence), vetoed=True)


def _of_little_use(ratio: float, where: str) -> Measure:
    """Return the ratio of errors without an effect to those with it, the smallest one if all together do harm."""
    sentence = (
        f"With the named effects, free runs {where} are less accurate than with the paper's model. Without this effect "
        f"their error changes by {100.0 * (ratio - 1.0):+.2f} %."
    )
    return Measure("error_ratio", ratio, math.nan, "-", sentence)


def _speaks_against(gain: Gain) -> bool:
    """Return whether held-out recordings veto an effect: the path is significantly worse, and nothing else better."""
    return gain.interval[1] < WORSE_HELD_OUT and max(gain.signals.values()) < OF_USE


def _of_path(gain: Gain) -> float:
    return gain.ratio if math.isfinite(gain.ratio) else min(gain.signals.values(), default=1.0)


def _with_what_is_small(whole: Extended) -> Fit:
    """Return the fit with values that include unnamed effects, as the start of an average.

    Rare effects are left out: if one is small, more common ones with the same effect are likelier.
    """
    final, seen = whole.final, whole.found.seen
    if whole.term or not seen:
        return final
    usual = [effect for effect in CATALOGUE.values() if can_be_small(effect) and not effect.rarity]
    own = {parameter.name for effect in usual for parameter in effect.parameters}
    of_seen = {name: value for name, value in seen.values.items() if name in own or name in final.names}
    values = {**final.values, **of_seen}
    return Fit(values, final.names, final.rest, final.slopes, final.noise)


def _as_the_paper_if_alone(whole: Extended) -> Extended:
    """Return the paper's model if nothing extends it."""
    alone = whole.term is None and not whole.found.named
    return replace(whole, found=as_the_paper_has_it(whole.found)) if alone else whole


def as_the_paper_has_it(found: Search) -> Search:
    """Return the search result with the paper's model as the final one.

    The two fits weight the same data differently, by plain and by estimated noise, so their difference and the
    uncertainty of each are added.
    """
    final, base, of_base = found.final, found.base, found.problem.extra_stds(found.base)
    extra_stds = {
        name: math.hypot(final.std(name), final.values[name] - base.values[name], of_base[name]) for name in base.names
    }
    return replace(found, final=base, extra_stds=extra_stds)


def _fitted(found: Search) -> list[SelectedEffect]:
    """Return the fitted effects, strongest first; others are random or read off the data."""
    return [one for one in found.named if not one.estimates]


def _without(whole: Extended, leaving: SelectedEffect, why: str, measure: Measure) -> Extended:
    """Refit the model without an effect; `measure` states the reason in numbers."""
    found, problem = whole.found, whole.found.problem

    def refit(fit: Fit) -> Fit:
        return problem.fit(*without(problem, fit, [leaving]), fit.noise, renew=0)

    removed: Sequence[tuple[str, float]] = [(leaving.candidate.effect.name, leaving.candidate.drop)]
    remaining = replace(
        found,
        final=refit(found.final),
        named=[one for one in found.named if one is not leaving],
        others=[(replace(leaving.candidate, measure=measure), why), *found.others],
        decisions=with_removed(found.decisions, removed, measure.sentence, (measure,)),
    )
    term = replace(whole.term, fit=refit(whole.term.fit)) if whole.term else None
    return replace(whole, found=remaining, term=term)

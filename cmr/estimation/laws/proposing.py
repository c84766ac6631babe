"""Propose laws for what a search of the catalogue has left, and put them into the model."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from cmr.estimation.estimates import Estimate
from cmr.estimation.gain import Gain, measure
from cmr.estimation.gauss_newton import Fit
from cmr.estimation.laws.candidates import Candidate
from cmr.estimation.laws.curves import curve_of
from cmr.estimation.laws.linearised import Linearised, is_of_wheels
from cmr.estimation.laws.naming import law_of
from cmr.estimation.laws.polish import Polished
from cmr.estimation.laws.result import APPROXIMATION, LAW, NO_LAW, TIE, LawFound, Laws
from cmr.estimation.laws.scan import penalty
from cmr.estimation.laws.searching import ALONE, LEAST, LEFT, SET, Data, Offer, Refused, offered
from cmr.estimation.prediction import Predictor
from cmr.estimation.problem import Problem
from cmr.estimation.search.selection import Search, small_effects, with_small_effects
from cmr.estimation.segments import Segment
from cmr.estimation.unexplained.generic import Extension
from cmr.model.catalogue import LAWS, learn, unlearn
from cmr.model.laws.law import Law

BY_FREE_RUNS = "Models were fitted to free runs, whose errors say nothing of single moments: no law was looked for."
WITHOUT_POSES = "Neither poses nor a gyro show how the body moves: no law was looked for."
LARGEST_LOSS = 0.97  # ratio of free runs' errors on data left out below which a law does harm,
LEAST_GAIN = 1.05  # and that some signal's must reach: as of generic terms, what changes nothing to be seen is no law
HARM = "Free runs on data left out of the fit are less accurate with the best formula."
TOO_LITTLE = "The best formula is too small to matter: no free run on data left out of the fit is 5 % more accurate."
LAST_THIRD = (
    "The law was tried on the last third of the drive, which is weak evidence: a held-out drive of another kind would "
    "say more."
)
STRUCTURE_LEFT = "Structure is left beside it: it approximates something unknown."
MANOEUVRE = "multisine, circles at two speeds and two radii in both directions, big steps at speed"
# Likelihood ratio to first order that a law must have where the diagnosis sees no structure in what is left: the model
# itself is inexact by some 50, physics that matters has 300 or more, and fitting a law takes seconds.
UNSEEN = 100.0
RIVALS_NAMES = 0.3  # share of what the strongest name explains that a law alone must explain to first order
INEXACT = 0.008  # share of a coefficient by which the model is inexact; as of effects


@dataclass(frozen=True)
class Proposal:
    """The answer of a search for laws; where laws stand in the model, the fit with them, `alone` without any names."""

    laws: Laws
    extension: Extension | None = None
    alone: bool = False


def proposed(problem: Problem, found: Search, held_out: Sequence[Segment], more: bool) -> Proposal:
    """Look for laws beside what a search of a problem found, and without it; `more` says that structure remains."""
    if not problem.by_moments:
        return Proposal(Laws(reasons=(BY_FREE_RUNS,)))
    if not any({"yaw_rate", "heading"} & {*one.times} for one in found.problem.predictors):
        return Proposal(Laws(reasons=(WITHOUT_POSES,)))
    other = _problem_of(held_out, found)
    at_least = 0.0 if more else UNSEEN
    data, beside = _beside(found, other, at_least)
    fitted = [one for one in found.named if not one.estimates]
    if fitted and found.problem is problem and (isinstance(beside, Offer) or len(fitted) > 1 or more):
        model = Linearised.about(problem, found.base.values, found.base.names)
        without = Data.of(problem, model, other)
        least = RIVALS_NAMES * max(one.candidate.drop for one in fitted)
        alone = offered(without, model, (), 0.0, max(at_least, least))
        if isinstance(alone, Offer) and _better_alone(without, alone, beside):
            return _in_the_model(without, found.base, alone, found, held_out)
    if isinstance(beside, Offer):
        return _in_the_model(data, found.final, beside, found, held_out)
    manoeuvre = MANOEUVRE if beside.several else ""
    return Proposal(Laws(answer=NO_LAW, reasons=(beside.reason,), manoeuvre=manoeuvre))


def _problem_of(held_out: Sequence[Segment], found: Search) -> Problem | None:
    """Return the problem of segments held out; None without any, or where effects of chance were taken out of data."""
    segments = [one for one in held_out if len(one.observations.given) == 0]
    if not segments or any(one.estimates for one in found.named):
        return None
    return Problem([Predictor(one) for one in segments], found.problem.gains, found.problem.excitation)


def _beside(found: Search, other: Problem | None, at_least: float) -> tuple[Data, Offer | Refused]:
    """Return the law that stands beside all that was found, effects that are too small to be named included."""
    fit = with_small_effects(found)
    model = Linearised.about(found.problem, fit.values, fit.names)
    selected = [one.candidate.effect.name for one in found.named]
    selected += [one.effect.name for one in small_effects(found)]
    explained = max(0.0, found.base.squares - found.final.squares)
    data = Data.of(found.problem, model, other)
    return data, offered(data, model, selected, explained, at_least)


def _better_alone(data: Data, alone: Offer, beside: Offer | Refused) -> bool:
    """Return whether a law without names explains more than names do, or as much as they do with a law.

    It must do so on data held out, too.
    """
    if isinstance(beside, Offer):
        both = alone.before.quality() - beside.after.quality()
        as_well = data.held_out(beside.after, alone.after) > -ALONE * alone.held_out
        return both < (1.0 + ALONE) * alone.gain and as_well
    names = beside.before
    if names is None:
        return False
    samples = int(np.count_nonzero(data.fitted))
    spared = (len(names.model.names) - len(alone.after.model.names)) * math.log(samples)
    more = names.quality() - alone.after.quality() + spared - sum(penalty(law, samples) for law in alone.laws)
    return more > LEAST and data.held_out(names, alone.after) > LEAST


def _in_the_model(data: Data, before: Fit, offer: Offer, found: Search, held_out: Sequence[Segment]) -> Proposal:
    """Put the laws of an offer into the model, and fit it; they are entries of the catalogue from then on.

    The model `before` is that with all that was named, or the paper's.
    """
    problem = data.problem
    alone = before is found.base and any(not one.estimates for one in found.named)
    laws, sizes, known = [], dict[str, float](), set(LAWS)
    for candidate, coefficients in zip(offer.laws, offer.after.coefficients, strict=True):
        law = law_of(candidate)
        sizes |= dict(zip(law.coefficients, coefficients, strict=True))
        learn(law, sizes)
        laws.append(law)
    constants = {law.parameter_of(name): value for law in laws for name, value in law.constants.items()}
    start = {**before.values, **_moved(before, offer), **sizes, **constants}
    fit = problem.fit(start, (*before.names, *sizes), offer.after.noise, renew=1)
    gain = measure(problem, before, fit, {}, [predictor.segment for predictor in problem.predictors], held_out).gain
    harm = min(gain.signals.values(), default=1.0) < LARGEST_LOSS
    if harm or max(gain.signals.values(), default=1.0) < LEAST_GAIN:
        _forget([law for law in laws if law.name not in known])
        return Proposal(Laws(answer=NO_LAW, reasons=(HARM if harm else TOO_LITTLE,)))
    found_laws = tuple(_found(law, fit, offer, gain, found.inflation) for law in laws)
    result = Laws(
        answer=_answer(offer),
        found=found_laws,
        rivals=tuple(_rival(one, found_laws[0]) for one in offer.alike),
        names_withdrawn=tuple(one.candidate.effect.name for one in found.named) if alone else (),
        reasons=_reasons(offer, held_out),
        curve=tuple(curve_of(offer.after, number, law, *data.tried_on(offer.after)) for number, law in enumerate(laws)),
    )
    return Proposal(result, Extension(tuple(sizes), fit, 0.5 * offer.held_out, gain), alone)


def _forget(laws: Sequence[Law]) -> None:
    """Take laws that were only tried out of the catalogue."""
    for law in laws:
        unlearn(law.name)


def _found(law: Law, fit: Fit, offer: Offer, gain: Gain, inflation: float) -> LawFound:
    """Return a law as it stands in a fit."""
    estimates = {
        name: Estimate(fit.values[name], math.hypot(math.sqrt(inflation) * fit.std(name), INEXACT * fit.values[name]))
        for name in law.coefficients
    }
    return LawFound(
        law=law, estimates=estimates, gain=gain, held_out=0.5 * offer.held_out, score=offer.score, left=offer.left
    )


def _moved(before: Fit, offer: Offer) -> Mapping[str, float]:
    """Return the values of the model's own parameters as they are with the laws."""
    return {name: offer.after.values[name] for name in before.names if name in offer.after.values}


def _answer(offer: Offer) -> str:
    if offer.left > LEFT:
        return APPROXIMATION
    close = [one for one in offer.alike if one.quality() < offer.after.quality() + SET]
    return TIE if close else LAW


def _reasons(offer: Offer, held_out: Sequence[Segment]) -> tuple[str, ...]:
    reasons = [
        f"It lowers -2 log likelihood by {offer.gain:.0f} on the fitted data, and by {offer.held_out:.0f} on data that "
        "it was not fitted to."
    ]
    if not held_out:
        reasons.append(LAST_THIRD)
    if offer.left > LEFT:
        reasons.append(STRUCTURE_LEFT)
    return tuple(reasons)


def _rival(fit: Polished, best: LawFound) -> LawFound:
    """Return a law that is not distinguished from the one in the model, as it was fitted to first order."""
    law = law_of(fit.laws[-1])
    estimates = {
        name: Estimate(value, math.nan) for name, value in zip(law.coefficients, fit.coefficients[-1], strict=True)
    }
    return LawFound(law=law, estimates=estimates, gain=best.gain, held_out=math.nan, score=math.nan, left=math.nan)


def described(candidate: Candidate) -> str:
    """Return a candidate in a few words, for those who study the search."""
    side = f" {candidate.side}" if is_of_wheels(candidate.place) else ""
    return f"{candidate.place}{side}: {' and '.join(candidate.formulas)} {dict(candidate.constants) or ''}".strip()

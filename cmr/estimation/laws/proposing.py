"""Propose laws for the residuals of a search of the catalogue, and add them to the model."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from cmr.estimation.estimates import Estimate
from cmr.estimation.gain import Gain, measure
from cmr.estimation.gauss_newton import Fit
from cmr.estimation.laws.candidates import Candidate
from cmr.estimation.laws.curves import curve_of
from cmr.estimation.laws.linearised import is_of_wheels
from cmr.estimation.laws.naming import law_of
from cmr.estimation.laws.polish import Polished
from cmr.estimation.laws.result import APPROXIMATION, LAW, NO_LAW, TIE, LawFound, Laws
from cmr.estimation.laws.rivals import (
    Hypothesis,
    Rivalry,
    against_both,
    against_names,
    beside_names,
    effects_of,
    leaves_nothing,
    still_needed,
    with_needed_names,
    without_names,
)
from cmr.estimation.laws.searching import ANOTHER, LEFT, PROMISING, SEEN, Offer, Refused, Scanned
from cmr.estimation.prediction import Predictor
from cmr.estimation.problem import Problem
from cmr.estimation.search.selection import Search
from cmr.estimation.segments import Segment
from cmr.estimation.unexplained.generic import Extension
from cmr.model.catalogue import LAWS, learn, unlearn
from cmr.model.laws.law import Law
from cmr.model.laws.places import PLACES

BY_FREE_RUNS = "Models were fitted to free runs, whose errors say nothing of single moments: no law was looked for."
WITHOUT_POSES = "Neither poses nor a gyro show how the body moves: no law was looked for."
LARGEST_LOSS = 0.97  # ratio of free runs' errors on data left out below which a law does harm,
LEAST_GAIN = 1.05  # and that some signal's must reach: as of generic terms, what changes nothing to be seen is no law
HARM = "Free runs on data left out of the fit are less accurate with the best formula."
TOO_LITTLE = "The best formula is too small to matter: no free run on data left out of the fit is 5 % more accurate."
UNDETERMINED = "The best formulas stand in for each other: the data do not determine the coefficients of each."
SURE = 3.0  # standard deviations from 0 required of at least one coefficient of each law
LAST_THIRD = (
    "The law was tried on the last third of the drive, which is weak evidence: a held-out drive of another kind would "
    "say more."
)
MISFIT = "Its coefficients change along its own variables: the formula is not quite the right one."
UNSURE = "Other constants explain the errors as well, and say something else: this drive does not determine them."
SERIES = "Two terms of the same variables stand for one formula that is not known."
STRUCTURE_LEFT = "Structure is left beside it: it approximates something unknown."
MANOEUVRE = "multisine, circles at two speeds and two radii in both directions, big steps at speed"
DECISIVE = 100.0  # improvement in -2 log likelihood on held-out data from which a law matters regardless of free runs
# Required of a law of a sensor, which free runs do not show. Its variables come from the observer, which follows the
# noisy readings: over a few centimetres, robots without any law reached up to 20. Gyro readings are not followed, so
# the variables of its laws are independent of them.
OF_A_SENSOR, OF_A_GYRO = 50.0, 20.0
INEXACT = 0.008  # model-form uncertainty of a coefficient, as a share, as for effects
UNKNOWN = Gain(ratio=math.nan, interval=(math.nan, math.nan), signals={})


@dataclass(frozen=True)
class Proposal:
    """The result of a search for laws.

    If laws are in the model, `extension` is the fit with them, and `before` the one without them and without the
    `withdrawn` effects. `seen` is the best fit with a formula that shows that structure exists, whether or not the
    formula holds.
    """

    laws: Laws
    extension: Extension | None = None
    before: Fit | None = None
    withdrawn: tuple[str, ...] = ()
    seen: Polished | None = None


def proposed(problem: Problem, found: Search, held_out: Sequence[Segment], more: bool) -> Proposal:
    """Look for laws beside what a search of a problem found, and without it; `more` says that structure remains."""
    if not problem.one_step:
        return Proposal(Laws(reasons=(BY_FREE_RUNS,)))
    if not any({"yaw_rate", "heading"} & {*one.times} for one in found.problem.predictors):
        return Proposal(Laws(reasons=(WITHOUT_POSES,)))
    other = _problem_of(held_out, found)
    beside = beside_names(found, other)
    promising = PROMISING if more else _least_unseen(beside)
    effects = effects_of(found)
    if not effects or found.problem is not problem or not (len(effects) > 1 or more or beside.best > ANOTHER):
        return _answered(beside, beside.offer(promising), found, held_out)
    alone = without_names(problem, found, other)
    if not alone.is_worth_it(effects):
        return _answered(beside, beside.offer(promising), found, held_out)
    law = alone.offer()  # something is there, as the effects say
    if isinstance(law, Refused) or beside.before is None:
        return _answered(beside, beside.offer(promising), found, held_out)
    rivalry = against_names(alone.data, law, beside.before, len(effects))
    if rivalry is Rivalry.BETTER and leaves_nothing(law):
        return _alone(alone, law, found, other, held_out)
    both = beside.offer(promising)
    if isinstance(both, Offer) and rivalry is not Rivalry.WORSE:
        rivalry = against_both(alone.data, law, both)
    if rivalry is Rivalry.BETTER:
        return _alone(alone, law, found, other, held_out)
    if rivalry is Rivalry.TIED:
        return _tied(alone, law, found, held_out)
    return _answered(beside, both, found, held_out)


def _alone(
    alone: Hypothesis, law: Offer, found: Search, other: Problem | None, held_out: Sequence[Segment]
) -> Proposal:
    """Return the proposal of a law that stands without names, but for those that explain something beside it."""
    needed, named = still_needed(law, found), [one.candidate.effect.name for one in found.named]
    if not needed:
        return _in_the_model(alone, law, found, held_out, tuple(named))
    some = with_needed_names(found, needed, other)
    both = some.offer()
    return _answered(some, both, found, held_out, tuple(name for name in named if name not in needed))


def _tied(alone: Hypothesis, law: Offer, found: Search, held_out: Sequence[Segment]) -> Proposal:
    """Return the proposal if effects together explain as much as one law: they stay, and the law is a rival.

    If the effects were too small to be named, the law is used in the model instead.
    """
    reason = f"{' and '.join(one.effect.name for one in effects_of(found))} together explain the errors as well."
    if any(not one.estimates for one in found.named):
        rivals = (_rival(law.after),)
        return Proposal(Laws(answer=TIE, rivals=rivals, reasons=(reason,), manoeuvre=MANOEUVRE))
    proposal = _in_the_model(alone, law, found, held_out, ())
    if not proposal.laws.found:
        return proposal
    answer = proposal.laws.answer if proposal.laws.answer == APPROXIMATION else TIE
    laws = replace(proposal.laws, answer=answer, reasons=(*proposal.laws.reasons, reason), manoeuvre=MANOEUVRE)
    return replace(proposal, laws=laws)


def _answered(
    beside: Hypothesis,
    offer: Offer | Refused,
    found: Search,
    held_out: Sequence[Segment],
    withdrawn: tuple[str, ...] = (),
) -> Proposal:
    """Return a proposal with a law beside a model, or without a law."""
    if isinstance(offer, Offer):
        return _in_the_model(beside, offer, found, held_out, withdrawn)
    rivals = tuple(map(_rival, offer.rivals))
    answer, manoeuvre = TIE if rivals else NO_LAW, MANOEUVRE if offer.several else ""
    laws = Laws(answer=answer, rivals=rivals, reasons=(offer.reason,), manoeuvre=manoeuvre)
    return Proposal(laws, seen=offer.rivals[0] if rivals else offer.seen)


def _problem_of(held_out: Sequence[Segment], found: Search) -> Problem | None:
    """Return the problem of segments held out; None without any, or where effects of chance were taken out of data."""
    segments = [one for one in held_out if len(one.observations.given) == 0]
    if not segments or any(one.estimates for one in found.named):
        return None
    return Problem([Predictor(one) for one in segments], found.problem.gains, found.problem.excitation)


def _in_the_model(
    beside: Hypothesis, offer: Offer, found: Search, held_out: Sequence[Segment], withdrawn: tuple[str, ...]
) -> Proposal:
    """Put the laws of an offer into the model, and fit it; they are entries of the catalogue from then on."""
    data, before, known = beside.data, beside.fit, set(LAWS)
    laws = [law_of(candidate) for candidate in offer.laws]
    sizes = {
        name: value
        for law, own in zip(laws, offer.after.coefficients, strict=True)
        for name, value in zip(law.coefficients, own, strict=True)
    }
    for law in laws:
        learn(law, {name: sizes[name] for name in law.coefficients})
    constants = {law.parameter_of(name): value for law in laws for name, value in law.constants.items()}
    start = {**before.values, **_moved(before, offer), **sizes, **constants}
    fit = data.problem.fit(start, (*before.names, *sizes), offer.after.noise, renew=1)
    segments = [predictor.segment for predictor in data.problem.predictors]
    gain = measure(data.problem, before, fit, {}, segments, held_out).gain
    stands = tuple(_found(law, fit, offer, gain, found.inflation) for law in laws)
    why_not = _why_not(offer, gain, stands)
    if why_not:
        _forget([law for law in laws if law.name not in known])
        seen = offer.after if offer.gain >= SEEN and why_not != UNDETERMINED else None
        return Proposal(Laws(answer=NO_LAW, reasons=(why_not,)), seen=seen)
    tried = data.tried_on(offer.after)
    result = Laws(
        answer=_answer(offer),
        found=stands,
        rivals=tuple(map(_rival, offer.alike)),
        names_withdrawn=withdrawn,
        reasons=_reasons(offer, held_out),
        curve=tuple(curve_of(offer.after, number, law, *tried) for number, law in enumerate(laws)),
        manoeuvre=MANOEUVRE if _answer(offer) == TIE else "",
    )
    extension = Extension(tuple(sizes), fit, 0.5 * offer.held_out, gain)
    return Proposal(result, extension, before, withdrawn, offer.after)


def _why_not(offer: Offer, gain: Gain, laws: Sequence[LawFound]) -> str:
    """Return why laws are not taken as they stand in a fit; empty if they are."""
    if min(gain.signals.values(), default=1.0) < LARGEST_LOSS:
        return HARM
    if any(all(abs(one.value) < SURE * one.std for one in law.estimates.values()) for law in laws):
        return UNDETERMINED
    return "" if _matters(offer, gain) else TOO_LITTLE


def _matters(offer: Offer, gain: Gain) -> bool:
    """Return whether laws matter: in free runs, or beyond doubt in one-step predictions of the sensors.

    A law of a sensor does not affect the path, so its readings on held-out data decide.
    """
    of_sensors = any(PLACES[law.place].of_sensors for law in offer.laws)
    seen = not of_sensors and max(gain.signals.values(), default=1.0) >= LEAST_GAIN
    return seen or offer.held_out >= _decisive(offer.laws)


def _decisive(laws: Sequence[Candidate]) -> float:
    """Return the improvement in -2 log likelihood from which laws exist beyond doubt."""
    if all(law.place == "gyro" for law in laws):
        return OF_A_GYRO
    return OF_A_SENSOR if any(PLACES[law.place].of_sensors for law in laws) else DECISIVE


def _least_unseen(beside: Hypothesis) -> float:
    """Return the score to first order that a law must have where the diagnosis sees no structure in what is left.

    A fit takes seconds, and a lower score would hardly be decisive.
    """
    first = beside.first
    return _decisive([first.scores[0].candidate]) if isinstance(first, Scanned) and first.scores else DECISIVE


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
    if offer.approximate:
        return APPROXIMATION
    return TIE if offer.tied else LAW


def _reasons(offer: Offer, held_out: Sequence[Segment]) -> tuple[str, ...]:
    reasons = [
        f"It lowers -2 log likelihood by {offer.gain:.0f} on the fitted data, and by {offer.held_out:.0f} on data that "
        "it was not fitted to."
    ]
    if not held_out:
        reasons.append(LAST_THIRD)
    if offer.left > LEFT:
        reasons.append(STRUCTURE_LEFT)
    if offer.misfit > 0.0:
        reasons.append(MISFIT)
    if offer.series:
        reasons.append(SERIES)
    if offer.undetermined:
        reasons.append(UNSURE)
    return tuple(reasons)


def _rival(fit: Polished) -> LawFound:
    """Return a law that is not in the model, as fitted to first order."""
    law = law_of(fit.laws[-1])
    estimates = {
        name: Estimate(value, math.nan) for name, value in zip(law.coefficients, fit.coefficients[-1], strict=True)
    }
    return LawFound(law=law, estimates=estimates, gain=UNKNOWN, held_out=math.nan, score=math.nan, left=math.nan)


def described(candidate: Candidate) -> str:
    """Return a short description of a candidate, for studies of the search."""
    side = f" {candidate.side}" if is_of_wheels(candidate.place) else ""
    return f"{candidate.place}{side}: {' and '.join(candidate.formulas)} {dict(candidate.constants) or ''}".strip()

"""Propose laws for the residuals of a search of the catalogue, and add them to the model."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache

from cmr.estimation.estimates import Estimate
from cmr.estimation.gain import Gain, measure
from cmr.estimation.gauss_newton import Fit
from cmr.estimation.laws.candidates import Candidate
from cmr.estimation.laws.curves import curve_of
from cmr.estimation.laws.linearised import is_of_wheels
from cmr.estimation.laws.naming import law_of
from cmr.estimation.laws.offers import LEFT, Data, Offer, Refused
from cmr.estimation.laws.refining import Refined
from cmr.estimation.laws.result import APPROXIMATION, LAW, NO_LAW, TIE, LawFound, Laws
from cmr.estimation.laws.rivals import (
    Hypothesis,
    Rivalry,
    against_both,
    against_names,
    beside_names,
    by_chance,
    effects_of,
    fitted_of,
    leaves_nothing,
    still_needed,
    with_needed_names,
    without_names,
)
from cmr.estimation.laws.searching import ANOTHER, Scanned, is_seen
from cmr.estimation.laws.standing import forget, stood
from cmr.estimation.prediction import Predictor
from cmr.estimation.problem import Problem
from cmr.estimation.search.chance import chance_on_commands
from cmr.estimation.search.selection import Search
from cmr.estimation.segments import Segment
from cmr.estimation.unexplained.generic import Extension, improves
from cmr.model.catalogue import LAWS
from cmr.model.laws.law import Law
from cmr.model.laws.places import PLACES

WITHOUT_POSES = "Neither poses nor a gyro show how the body moves: no law was searched for."
LARGEST_LOSS = 0.97  # ratio of free runs' errors on data left out below which a law is harmful,
LEAST_GAIN = 1.05  # and that at least one signal must reach: a law without visible effect is none
HARM = "Free runs on data left out of the fit are less accurate with the best formula."
BUT_HOLDS = (
    "From moment to moment it holds there: what disturbs the robot may matter more in free runs than the formula."
)
TOO_LITTLE = "The best formula is too small to matter: no free run on data left out of the fit is 5 % more accurate."
DOUBTFUL = "No other structure seems to remain, and on data left out of the fit the best formula is uncertain."
UNDETERMINED = "The best formulas stand in for each other: the data do not determine the coefficients of each."
SURE = 3.0  # standard deviations from 0 required of at least one coefficient of each law
LAST_THIRD = (
    "The law was tried on the last third of the drive, which is weak evidence: a held-out drive of another kind would "
    "say more."
)
MISFIT = "Its coefficients change along its own variables: the formula is not quite the right one."
UNSURE = "Other constants fit as well but give other values elsewhere: this drive does not determine them."
SERIES = "Two terms of the same variables stand for one formula that is not known."
STRUCTURE_LEFT = "Structure remains beside it: it approximates something unknown."
MANOEUVRE = "multisine, circles at two speeds and two radii in both directions, big steps at speed"
UNSEEN = 25.0  # first-order score from which a law is fitted if nothing seems to remain; a fit takes seconds
CROSSING = "crossing the place from several sides"
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
    problem: Problem | None = None
    withdrawn: tuple[str, ...] = ()
    seen: Refined | None = None


def proposed(problem: Problem, found: Search, held_out: Sequence[Segment], more: bool) -> Proposal:
    """Search for laws beside the effects found, and without them; `more` says that structure remains."""
    if not any({"yaw_rate", "heading"} & {*one.times} for one in found.problem.predictors):
        return Proposal(Laws(reasons=(WITHOUT_POSES,)))
    other = _problem_of(held_out, found)
    beside = beside_names(found, other)
    # For models fitted by free runs, these decide.
    both = cache(beside.offer if more or not problem.one_step else lambda: _unseen(beside))
    effects = effects_of(found)
    several = len(effects) > 1 or (effects and (more or beside.best > ANOTHER))
    if problem.one_step and several:  # free runs name motor effects, which errors of the body do not show
        # Use the original recording: one law's effect may also have looked like lost commands.
        for given in [problem] if found.problem is problem else [problem, found.problem]:
            known = set(LAWS)
            proposal = _instead_of_names(without_names(given, found, beside), beside, both, found, held_out)
            if proposal and (given is found.problem or not _acts_by_chance(proposal)):
                return proposal
            forget((law.law for law in proposal.laws.found) if proposal else (), known)
    return _answered(beside, both(), found, held_out)


def _acts_by_chance(proposal: Proposal) -> bool:
    """Return whether random effects on the commands show, or may show, beside the laws of a proposal."""
    if proposal.extension is None or proposal.problem is None:
        return True
    fit = proposal.extension.fit
    return chance_on_commands(proposal.problem, (), (), fit, fit) is not None


def _instead_of_names(
    alone: Hypothesis,
    beside: Hypothesis,
    both: Callable[[], Offer | Refused],
    found: Search,
    held_out: Sequence[Segment],
) -> Proposal | None:
    """Return the proposal of a law that replaces effects or ties with them; None if the effects are better.

    `both` returns the best law beside them.
    """
    effects = effects_of(found)
    if beside.before is None or not alone.is_worth_it(effects):
        return None
    law = alone.offer_instead(beside.before)
    if isinstance(law, Refused):
        return None
    rivalry = against_names(alone.data, law, beside.before, len(effects))
    if rivalry is Rivalry.BETTER and leaves_nothing(law):
        return _alone(alone, law, found, held_out)
    with_names = both()
    if isinstance(with_names, Offer) and rivalry is not Rivalry.WORSE:
        rivalry = against_both(alone.data, law, with_names)
    if rivalry is Rivalry.BETTER:
        return _alone(alone, law, found, held_out)
    return _tied(alone, law, found, held_out) if rivalry is Rivalry.TIED else None


def _alone(alone: Hypothesis, law: Offer, found: Search, held_out: Sequence[Segment]) -> Proposal:
    """Return the proposal of a law that replaces the effects, except those that explain something beside it."""
    needed = still_needed(law, found)
    gone = [one.effect.name for one in fitted_of(found) if one.effect.name not in needed]
    if alone.problem is not found.problem:
        gone += [one.candidate.effect.name for one in by_chance(found)]
    if not needed:
        return _in_the_model(alone, law, found, held_out, tuple(gone))
    some = with_needed_names(alone.problem, found, needed, alone.data.other)
    return _answered(some, some.offer(), found, held_out, tuple(gone))


def _tied(alone: Hypothesis, law: Offer, found: Search, held_out: Sequence[Segment]) -> Proposal:
    """Return the proposal if effects together explain as much as one law: they stay, and the law is a rival.

    If the effects were too small to be named, the law is used in the model instead.
    """
    reason = f"{' and '.join(one.effect.name for one in effects_of(found))} together explain the errors as well."
    if fitted_of(found):
        rivals = (_rival(law.settled),)
        return Proposal(Laws(answer=TIE, rivals=rivals, reasons=(reason,), manoeuvre=_manoeuvre(law.laws)))
    proposal = _in_the_model(alone, law, found, held_out, ())
    if not proposal.laws.found:
        return proposal
    answer = proposal.laws.answer if proposal.laws.answer == APPROXIMATION else TIE
    reasons = (*proposal.laws.reasons, reason)
    laws = replace(proposal.laws, answer=answer, reasons=reasons, manoeuvre=_manoeuvre(law.laws))
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
    """Return the problem of held-out segments; None without any, or if random effects were removed from the data.

    For models fitted by free runs, errors are those of the body given the measured wheels.
    """
    segments = [one for one in held_out if len(one.observations.given) == 0]
    if not found.problem.one_step:
        segments = [one.rolling for one in held_out if len(one.rolled)]
    if not segments or by_chance(found):
        return None
    return Problem([Predictor(one) for one in segments], found.problem.gains, found.problem.excitation)


def _in_the_model(
    beside: Hypothesis, offer: Offer, found: Search, held_out: Sequence[Segment], withdrawn: tuple[str, ...]
) -> Proposal:
    """Add the laws of an offer to the model, and fit it; from then on they are entries of the catalogue."""
    standing = stood(beside, offer)
    data, before, problem = beside.data, beside.fit, beside.problem
    segments = [predictor.segment for predictor in problem.predictors]
    gain = measure(problem, before, standing.fit, {}, segments, held_out).gain
    stands = tuple(_found(law, standing.fit, offer, gain, found.inflation) for law in standing.laws)
    why_not = _why_not(offer, gain, stands, problem)
    if why_not:
        standing.forget()
        there = why_not != UNDETERMINED and is_seen(offer.before, offer.after, data)
        seen = offer.after if there else None
        # If an effect is named, its own shape may be slightly wrong: then no formula is a rival.
        sure = offer.held_out >= _decisive(offer.laws) and not found.named
        if why_not == HARM and sure and not gain.interval[1] < 1.0:
            rivals = tuple(map(_rival, (offer.settled, *offer.alike)))
            return Proposal(Laws(answer=TIE, rivals=rivals, reasons=(why_not, BUT_HOLDS)), seen=seen)
        return Proposal(Laws(answer=NO_LAW, reasons=(why_not,)), seen=seen)
    tried = data.tried_on(offer.settled)
    result = Laws(
        answer=_answer(offer),
        found=stands,
        rivals=tuple(map(_rival, offer.alike)),
        names_withdrawn=withdrawn,
        reasons=_reasons(offer, data),
        curve=tuple(curve_of(offer.settled, number, law, *tried) for number, law in enumerate(standing.laws)),
        manoeuvre=_deciding(offer),
    )
    extension = Extension(standing.names, standing.fit, 0.5 * offer.held_out, gain)
    return Proposal(result, extension, before, problem, withdrawn, offer.after)


def _why_not(offer: Offer, gain: Gain, laws: Sequence[LawFound], problem: Problem) -> str:
    """Return why laws are not accepted as they are in a fit of a problem; empty if they are.

    One-step errors of a robot judged by free runs prove nothing: there free runs decide.
    """
    if min(gain.signals.values(), default=1.0) < LARGEST_LOSS:
        return HARM
    if any(all(abs(one.value) < SURE * one.std for one in law.estimates.values()) for law in laws):
        return UNDETERMINED
    return "" if (_matters(offer, gain) if problem.one_step else improves(gain)) else TOO_LITTLE


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


def _unseen(beside: Hypothesis) -> Offer | Refused:
    """Return the law beside a model whose residuals show no structure to the diagnosis, or why there is none.

    It must be decisive: to first order, or on left-out data, since the noise may have absorbed most of it before.
    """
    first = beside.first
    likely = [first.scores[0].candidate] if isinstance(first, Scanned) and first.scores else []
    offer = beside.offer(min(UNSEEN, _decisive(likely)) if likely else UNSEEN)
    if isinstance(offer, Refused) or max(beside.best, offer.held_out) >= _decisive(offer.laws):
        return offer
    return Refused(DOUBTFUL, offer.before)


def _found(law: Law, fit: Fit, offer: Offer, gain: Gain, inflation: float) -> LawFound:
    """Return a law as it is in a fit."""
    estimates = {
        name: Estimate(fit.values[name], math.hypot(math.sqrt(inflation) * fit.std(name), INEXACT * fit.values[name]))
        for name in law.coefficients
    }
    return LawFound(
        law=law, estimates=estimates, gain=gain, held_out=0.5 * offer.held_out, score=offer.score, left=offer.left
    )


def _answer(offer: Offer) -> str:
    if offer.approximate:
        return APPROXIMATION
    return TIE if offer.tied else LAW


def _deciding(offer: Offer) -> str:
    """Return the drive that would determine a formula or its constants; empty if this drive determines both."""
    if _answer(offer) != TIE and not offer.undetermined:
        return ""
    return _manoeuvre(offer.laws)


def _manoeuvre(laws: Sequence[Candidate]) -> str:
    """Return the drive that would decide between laws."""
    return CROSSING if any("disc(" in text for law in laws for text in law.formulas) else MANOEUVRE


def _reasons(offer: Offer, data: Data) -> tuple[str, ...]:
    reasons = [
        f"It lowers -2 log likelihood by {offer.gain:.0f} on the fitted data, and by {offer.held_out:.0f} on data that "
        "it was not fitted to."
    ]
    if data.other is None:
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


def _rival(fit: Refined) -> LawFound:
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

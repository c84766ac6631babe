"""Search for a law that explains remaining structure: a formula of the state, validated on held-out data.

Effects alone, effects with a law, and a law alone are rival hypotheses. Laws are searched for beside the model with all
selected effects and beside the paper's model. They are scored to first order (scan.py), the best are fitted with the
model's parameters and the noise (polish.py), equivalents of the catalogue are excluded (known.py), and the best one
must hold on held-out data with its fitted coefficients. The remaining residuals show whether it is a law or an
approximation of something unknown.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from cmr.estimation.laws.candidates import Candidate
from cmr.estimation.laws.constants import undetermined
from cmr.estimation.laws.further import Further
from cmr.estimation.laws.known import Catalogued
from cmr.estimation.laws.linearised import Linearised, is_of_wheels
from cmr.estimation.laws.misfit import misfit_of
from cmr.estimation.laws.offers import Data, Offer, Refused
from cmr.estimation.laws.refining import Refined, refined, refined_twice, score_of, with_best_constants
from cmr.estimation.laws.rest import Rest, rest_of
from cmr.estimation.laws.scan import Score, penalty, scan
from cmr.estimation.laws.variables import Speeds
from cmr.estimation.noise import Noise
from cmr.estimation.search.criteria import most_at_once
from cmr.model.laws.places import PLACES

LEAST = 10.0  # score, and gain on held-out data, that a law must exceed,
PROMISING = -5.0  # first-order score from which a law is fitted: noise estimated without it hides part of its gain
HOLDS = 0.1  # and share of its gain on the fitted data that must remain there, and without its best moment
OF_NAMES = 0.05  # share of the named effects' gain that a law beside them must reach
ALONE = 0.1  # share by which names and a law must be better than a law alone
ANOTHER = 0.0  # score from which a second law is fitted: noise estimated without it hides part of its gain
LARGEST_MOVE = 0.3  # relative change of K2/K3 by a law: beyond it, law and parameter compensate each other
BEST, NEWCOMERS = 4, 3  # laws that are fitted, and those added with the new noise
SETTLED = 3  # best of these whose constants are refined,
SHARE_TO_SETTLE = 0.5  # unless their distance from the best exceeds this share of the range
SET, SHARE_OF_SET = 6.0, 0.05  # laws closer than this, or this share of the gain, are not distinguished
SEEN = 100.0  # gain from which structure exists, even if no formula holds: model errors gain some 50
INEXACT = 0.01  # share of a law's gain due to an inexact shape of its formula: signs, for instance, are smoothed
MOST_ALIKE = 3  # laws that a drive may leave undistinguished: with more, it says too little for any
MOVING, FASTEST = 0.1, 0.98  # share of the usual top speed, a quantile of speeds, from which a robot moves
# Relative spread of the speed (0.05 on figure-eights, 0.9 on the rich drive), and of the share of turning in the
# wheels' motion, from 0 to 1: with less, the drive has one speed, or one radius.
ONE_SPEED, ONE_RADIUS = 0.25, 0.05
NARROW = "This drive has one speed or one radius, at which formulas cannot be distinguished: no law was searched for."
IDENTICAL = 0.99  # share of a law's own trace that another reproduces if both are mathematically the same
RESCORED = 400  # best laws that are rescored with the noise of the best one
SHOWN = 40  # best scores that are compared with the catalogue
NEARLY = 0.7  # of the first-order gain of the catalogue's best effect that a formula must reach


def offered(
    data: Data, model: Linearised, selected: Sequence[str], named: float, promising: float = PROMISING
) -> Offer | Refused:
    """Return the accepted law beside a model with the effects `selected`, or why there is none.

    `named` is the gain of these effects, of which the law must reach a share. Laws with a first-order score below
    `promising` are not fitted.
    """
    first = scanned(data, model, selected)
    return first if isinstance(first, Refused) else offered_of(first, named, promising)


@dataclass(frozen=True)
class Scanned:
    """A model fitted without a law, its residuals, and the first-order scores of laws, best first.

    It has the effects `selected`.
    """

    data: Data
    before: Refined
    rest: Rest
    scores: tuple[Score, ...]
    selected: tuple[str, ...]

    @property
    def best(self) -> float:
        """The best score."""
        return self.scores[0].score if self.scores else -math.inf

    @cached_property
    def catalogue(self) -> Catalogued:
        """The effects of the catalogue beside the model."""
        return Catalogued(self.before.model, self.rest, self.selected)


def scanned(data: Data, model: Linearised, selected: Sequence[str], noise: Noise | None = None) -> Scanned | Refused:
    """Score all laws beside a model with some effects `selected`, or return why none can be identified.

    They are scored with a `noise`; by default with that of the model's residuals.
    """
    if narrow(model):
        return Refused(NARROW, several=True)
    before = refined(model, (), data.fitted)
    if before is None:
        return Refused("The data do not determine the model's own parameters.")
    rest = rest_of(model, noise or before.noise, data.fitted)
    return Scanned(data, before, rest, tuple(Further.beside(model, rest).with_local()), tuple(selected))


def offered_of(
    first: Scanned, named: float, promising: float = PROMISING, least: float = LEAST, worth: float = 0.0
) -> Offer | Refused:
    """Return the accepted law beside a model with scored laws, if it scores `least` or more; see `offered`.

    If no first fit gains `worth`, no law is refined.
    """
    before = first.before
    if first.best < promising:
        return Refused("No formula explains more than chance finds among so many.", before)
    fits = _fits(first, worth)
    if isinstance(fits, Refused):
        return replace(fits, before=before)
    found = _judged(first.data, before, fits, named, first.selected, least)
    if isinstance(found, Offer) and found.left > ANOTHER:
        found = _with_second(first.data, found, first.selected)
    if isinstance(found, Offer) and found.left > found.score:
        return Refused("More structure remains beside the best formula than it explains.", before, seen=found.after)
    return found


def _fits(first: Scanned, worth: float) -> list[Refined] | Refused:
    """Return the fits of the best laws of a scan, and of further ones found with the best law's noise.

    Finally the constants of the best are refined. If none of the first fits gains `worth`, there are no others.
    """
    data, model, rest, known = first.data, first.before.model, first.rest, first.catalogue
    promising = _promising(first.scores, known)
    if not promising:
        return Refused("Effects of the catalogue explain as much here as formulas.")
    fits = _refined_all(rest, [one.candidate for one in promising[:BEST]], data, known)
    if not fits:
        return Refused("No formula could be fitted together with the model's parameters.")
    best = min(fits, key=lambda fit: _cost(fit, data))
    if first.before.quality() - best.quality() < worth:
        return Refused("The best formula explains less than half of what the effects explain.")
    again = rest_of(model, best.noise, data.fitted)
    met = {law.key for fit in fits for law in fit.laws}
    rescored = scan(model, again, [one.candidate for one in first.scores[:RESCORED]])
    newcomers = [one.candidate for one in _promising(rescored, known) if one.candidate.key not in met]
    fits += _refined_all(again, newcomers[:NEWCOMERS], data, known)
    return _settled(data, fits, known)


def _settled(data: Data, fits: Sequence[Refined], known: Catalogued) -> list[Refined]:
    """Refine the inner constants of the best fits with their own noise; return all fits."""
    ordered = sorted(fits, key=lambda fit: _cost(fit, data))
    far = _cost(ordered[0], data) + SHARE_TO_SETTLE * abs(ordered[0].quality() - ordered[-1].quality())
    for number, fit in enumerate(ordered[:SETTLED]):
        if not fit.laws[-1].constants or _cost(fit, data) > far:
            continue
        rest = rest_of(known.model, fit.noise, data.fitted)
        again = _refined_all(rest, fit.laws[-1:], data, known)
        if again and _cost(again[0], data) < _cost(fit, data):
            ordered[number] = again[0]
    return ordered


def narrow(model: Linearised) -> bool:
    """Return whether a robot drove at one speed, or round one radius: formulas are then equivalent for its sensors."""
    v, w = (np.concatenate([of.body[name] for of in model.variables]) for name in ("v", "w"))
    rim = 0.5 * model.values["base_width"] * np.abs(w)
    moving = np.abs(v) + rim > MOVING * np.quantile(np.abs(v) + rim, FASTEST)
    speed, turn = np.abs(v[moving]), rim[moving] / (np.abs(v) + rim)[moving]
    return bool(np.std(speed) < ONE_SPEED * np.mean(speed) or np.std(turn) < ONE_RADIUS)


def _with_second(data: Data, first: Offer, selected: Sequence[str]) -> Offer:
    """Return the offer with a second law beside the first, if one holds and reduces the remaining structure."""
    model, rest = first.after.model, first.after.rest
    known = Catalogued(model, rest, selected)
    promising = [one.candidate for one in _promising(first.further.with_local(), known)]
    fits = _refined_all(rest, promising[:NEWCOMERS], data, known, first.after.laws)
    if not fits:
        return first
    second = _judged(data, first.after, fits, OF_NAMES * first.gain, selected)
    if isinstance(second, Refused) or second.left > first.left:
        return first
    return replace(
        second,
        before=first.before,
        gain=first.before.quality() - second.after.quality(),
        score=score_of(first.before, second.after),
        held_out=data.held_out(first.before, second.after),
        misfit=max(first.misfit, second.misfit),
    )


def _promising(scores: Sequence[Score], known: Catalogued) -> list[Score]:
    """Return the best scores, without laws equivalent to the catalogue."""
    result: list[Score] = []
    for one in scores[:SHOWN]:
        if len(result) >= BEST + NEWCOMERS or one.score <= PROMISING:
            break
        again = any(one.candidate.key == other.candidate.key for other in result)
        if not again and one.gain > NEARLY * known.best and not known.has(one.candidate):
            result.append(one)
    return result


def _refined_all(
    rest: Rest, laws: Sequence[Candidate], data: Data, known: Catalogued, beside: Sequence[Candidate] = ()
) -> list[Refined]:
    """Return the plausible fits of laws, `beside` others, each with its best inner constants.

    With these constants, too, they must not be equivalent to the catalogue.
    """
    fits = []
    for law in laws:
        best = with_best_constants(known.model, law, rest)
        if best is not law and best.constants and known.has(best):
            continue
        fit = refined(known.model, [*beside, best], data.fitted)
        if fit is not None and _makes_sense(fit):
            fits.append(fit)
    return fits


def _makes_sense(fit: Refined) -> bool:
    """Return whether a law leaves the motor's gain nearly unchanged."""
    moved = fit.values["k2_over_k3"] / fit.model.values["k2_over_k3"]
    return 1.0 / (1.0 + LARGEST_MOVE) < moved < 1.0 + LARGEST_MOVE


def _cost(fit: Refined, data: Data) -> float:
    """Return -2 log likelihood with the penalty of the laws, on the data that are fitted."""
    return fit.quality() + sum(penalty(law, int(np.count_nonzero(data.fitted))) for law in fit.laws)


def _judged(
    data: Data,
    before: Refined,
    fits: Sequence[Refined],
    named: float,
    selected: Sequence[str],
    least: float = LEAST,
) -> Offer | Refused:
    """Return the best of some fits with a law, if it holds, with the fits that are not distinguished from it."""
    problem, names = data.problem, before.model.names
    best = min(fits, key=lambda fit: _cost(fit, data))
    # A law that acts alike or oppositely on both wheels is a law of the body.
    of_body = [fit for fit in fits if not is_of_wheels(fit.laws[-1].place) and _is_same(fit, best)]
    best = min(of_body, key=lambda fit: _cost(fit, data)) if of_body else best
    after = refined_twice(problem, names, best, data.fitted) or best
    if not _makes_sense(replace(after, model=before.model)):
        after = best
    further = Further.beside(after.model, after.rest)
    at_places = max(further.inflation(law.place) for law in after.laws)
    gain, score = before.quality() - after.quality(), score_of(before, after, at_places)
    if score >= least and _is_of_one_moment(after):
        return Refused("The best formula explains only one moment.", before)
    held_out = data.held_out(before, after)
    seen = after if score >= least and gain >= OF_NAMES * named and is_seen(before, after, data) else None
    if score < least or gain < OF_NAMES * named:
        return Refused("The best formula explains no more than errors of the model do.", before)
    if held_out < max(LEAST, HOLDS * gain * data.share_tried):
        return Refused("The best formula does not hold on data that it was not fitted to.", before, seen=seen)
    alike, tied = _alike(data, best, fits, gain)
    if len(tied) >= MOST_ALIKE:
        reason = f"This drive does not distinguish {len(tied) + 1} formulas that explain the errors as well."
        return Refused(reason, before, several=True, rivals=(best, *tied), seen=seen)
    left = further.best(further.inflation(), Catalogued(after.model, after.rest, selected).is_of_model)
    misfit = misfit_of(after) - INEXACT * gain
    settled = _steadily(after, data)
    loose = undetermined(settled, SET)
    return Offer(before, after, settled, gain, score, held_out, left, further, alike, tied, misfit, loose)


def _is_of_one_moment(fit: Refined) -> bool:
    """Return whether hardly any of the gain of a fit's last law remains without its best moment.

    The noise is that beside the law: without it, a single event raises the noise everywhere.
    """
    number = len(fit.laws) - 1
    gained = fit.rest_without(number).white ** 2 - fit.rest.white**2
    total, elsewhere = float(np.sum(gained)), float(np.sum(gained)) - most_at_once(fit.model.problem, gained)
    return elsewhere - penalty(fit.laws[number], int(np.count_nonzero(fit.mask))) < HOLDS * total


def is_seen(before: Refined, after: Refined, data: Data) -> bool:
    """Return whether the structure explained by laws exists, whatever the formula: also with the commanded speeds."""
    if before.quality() - after.quality() < SEEN:
        return False
    by_commands = refined(replace(after.model, speeds=Speeds.COMMANDED), after.laws, data.fitted)
    return by_commands is not None and before.quality() - by_commands.quality() >= SEEN


def _steadily(fit: Refined, data: Data) -> Refined:
    """Return a fit with inner constants found with variables that depend less on the observer.

    The gain from this is no evidence: a law could also remove the observer's noise.
    """
    laws = list(fit.laws)
    moving = [k for k, law in enumerate(laws) if law.constants and not PLACES[law.place].of_sensors]
    if not moving or fit.model.rolls:
        return fit
    model = replace(fit.model, speeds=Speeds.STEADY)
    for number in moving:
        steady = refined(model, laws, data.fitted)
        if steady is not None:
            laws[number] = with_best_constants(model, laws[number], steady.rest_without(number))
    settled = refined(model, laws, data.fitted)
    return settled if settled is not None and _cost(settled, data) < _cost(fit, data) - SET else fit


def _alike(
    data: Data, best: Refined, fits: Sequence[Refined], gain: float
) -> tuple[tuple[Refined, ...], tuple[Refined, ...]]:
    """Return the fits that are not distinguished from the best one, and those of them that are as good."""
    at_best = _cost(best, data) + _tried(data, best)
    others = [fit for fit in fits if fit is not best and not _is_same(fit, best)]
    behind = [(_cost(fit, data) + _tried(data, fit) - at_best, fit) for fit in others]
    alike = tuple(fit for off, fit in behind if off < max(SET, SHARE_OF_SET * gain))
    return alike, tuple(fit for off, fit in behind if off < SET)


def _is_same(fit: Refined, best: Refined) -> bool:
    """Return whether the last laws of two fits are equivalent after fitting the parameters, or have the same
    formula.
    """
    if fit.laws[-1].key == best.laws[-1].key:
        return True
    first = best.columns.shape[1] - len(best.coefficients[-1])
    basis = np.linalg.qr(best.columns[:, :first])[0]
    own = [one.columns[:, -len(one.coefficients[-1]) :] for one in (fit, best)]
    ours, its = (np.linalg.qr(columns - basis @ (basis.T @ columns))[0] for columns in own)
    shared = float(np.sum((ours.T @ its) ** 2))
    return shared > float(IDENTICAL * max(ours.shape[1], its.shape[1]))


def _tried(data: Data, fit: Refined) -> float:
    """Return -2 log likelihood of a fit on the test data."""
    return fit.quality(data.tried) if data.tried is not None else 0.0

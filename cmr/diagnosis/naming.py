"""Name effects one after the other: the one that explains most, if it also foretells what it was not fitted on."""

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import compress

import numpy as np

from cmr.calibration.result import Estimate
from cmr.diagnosis.candidates import Scene, worth_naming
from cmr.diagnosis.finishing import finished, pruned
from cmr.diagnosis.fitting import Fit
from cmr.diagnosis.gains import COARSE
from cmr.diagnosis.holding import alternatives, as_seen, contradicted, elsewhere, why_not_elsewhere
from cmr.diagnosis.inflation import Inflation
from cmr.diagnosis.judging import THRESHOLD, TOO_SMALL, Named, Tried, held_out_gain, needed, why_not
from cmr.diagnosis.packets import (
    JITTER,
    LOSS,
    Spread,
    largest_delay,
    period_of,
    share_lost,
    spread_of,
    without_jitter,
    without_loss,
)
from cmr.diagnosis.placing import placed
from cmr.diagnosis.screening import Score, Screening, screen
from cmr.diagnosis.study import Study
from cmr.model.catalogue import CATALOGUE, definition

PROMISING = 12  # effects that are fitted after the score test,
PROMISING_SHARE = 0.08  # if they explain this share of what the best explains
FINALISTS = 3  # that are fitted with everything free
TRUSTED_SHARE = 0.3  # of a trial's size: a score made nearer to it than this is to be trusted
CLOSE = 0.7  # of the best drop: an effect that explains less is no finalist
LEAST_DROP = 20.0
LEAST_SCORE = 10.0  # drop of the sum of squares from which a fit is worth while
ALIKE = 12.0  # drops that differ by less cannot be told apart,
ALIKE_SHARE = 0.02  # nor those that differ by less than this share
MOST_EFFECTS = 7  # with those that are too small to be named
LATE = ("command_delay", "electrical_lag", "slew_limit")  # as which jitter shows as long as its spread is not looked at
MEANS = ("command_delay", "electrical_lag")  # whose parameter is a mean delay [s]
MAYBE_CHANCE = 10.0  # drop from which delays are told one by one; below THRESHOLD both names stand
DOUBT_OF_JITTER = 0.05  # of its size: how delays are spread is not known
LEFT_BY_LATE = 0.003  # of what a fixed delay explains may be left in the spread
LEFT_BY_CHANCE = 0.05  # of what chance explains may be left, because the times told for single commands are rough
SURE_LOSS = 100.0  # drop from which commands are lost; clocks that are not quite even leave some spread, too
PERHAPS = 2.0  # standard deviations by which the share counted may be too small: that commands are lost is sure
LESS = "It explains less than the effect named."
SMALLER_SHOWN = 0.5  # of the typical size: a drive in which less would not show leaves an effect unseen
MOST_SMALL = 3  # such effects that are fitted to see what remains
COARSE_INFLATION = 40.0  # ticks of coarse encoders make errors that go with the speed
COURSE_INFLATION = 1.5  # for how many samples errors of courses count that last is known roughly
EQUAL = 3.0  # log-likelihood on data left out by which effects must differ to be told apart
READ_OFF = 1e-3  # relative standard deviation of what is read off the data


@dataclass(frozen=True)
class Search:
    """What the search found: the paper's model fitted, the final fit, the effects in order, and the runners-up.

    `study` is what the final fit explains: the recordings without what effects of chance did to them. `doubts` are to
    be added to the standard deviations of some parameters. `unseen` are effects that would not show in these drives.
    """

    study: Study
    base: Fit
    final: Fit
    named: list[Named]
    others: list[tuple[Tried, str]]
    inflation: float
    doubts: Mapping[str, float]
    unseen: tuple[str, ...]


def search(study: Study, base: Fit, say: Callable[[str], None]) -> Search:
    """Name effects until nothing significant is left, then drop what has become redundant.

    Effects of chance on the commands show in what the others leave; what they explain is taken out of the data, and
    the search begins anew.
    """
    found = _search(study, base, say)
    chance = None
    if study.by_moments and _tick(study) <= COARSE:
        late = [one for one in found.named if one.tried.effect.name in LATE]
        spread = spread_of(JITTER if late else LOSS, study, found.final)
        chance = _of_chance(found, late, spread) if spread else None
        if late and spread and chance is None:
            found = replace(found, named=[_perhaps_jitter(one, found, spread) for one in found.named])
    if chance is not None:
        by_chance, cleaned = chance
        say(f"Searching again without {by_chance.tried.effect.name} ...")
        clean_base = cleaned.fit(base.values, base.names, found.final.noise, renew=0)
        again = _search(cleaned, clean_base, say, LEFT_BY_CHANCE * by_chance.tried.drop / THRESHOLD)
        found = replace(again, base=base, named=[by_chance, *again.named])
    coarse = _coarse(study, found)
    named = [*(_perhaps_jitter(one, found, None) for one in found.named), coarse] if coarse else found.named
    return replace(found, named=sorted(_with_shadows_of_jitter(named), key=lambda one: -one.tried.drop))


def _search(study: Study, base: Fit, say: Callable[[str], None], least_of_wheels: float = 1.0) -> Search:
    """Search for what no chance is in; the inflation of what shows in the wheels is at least `least_of_wheels`."""
    current = base
    named: list[Named] = []
    others: list[tuple[Tried, str]] = []
    inflation = Inflation(1.0)
    while len(named) < MOST_EFFECTS:
        taken = [one.tried.effect.name for one in named]
        say(f"Trying {len(CATALOGUE) - len(taken)} effects beside {', '.join(taken) or 'the paper model'} ...")
        screening = screen(study, current.values, current.names, taken, current.noise if named else None)
        current = study.renewed(current, screening.noise)
        inflation = screening.inflation.at_least(COARSE_INFLATION if _tick(study) > COARSE else 1.0)
        inflation = replace(inflation, all=max(inflation.all, least_of_wheels))
        inflation = inflation if study.by_moments else Inflation(COURSE_INFLATION)
        chosen, others = _next(study, current, screening, inflation)
        if chosen is None:
            break
        named.append(chosen)
        assert chosen.tried.fit is not None
        current = chosen.tried.fit
        if len(named) > 1:
            named, current = pruned(study, named, current, inflation)
    last = finished(study, named, current, inflation)
    others = [*last.dropped, *others]
    unseen = _unseen(study, screening, [one.tried.effect.name for one in last.named])
    return Search(study, base, last.final, last.named, others, inflation.all, last.doubts, unseen)


def _next(
    study: Study, current: Fit, screening: Screening, inflation: Inflation
) -> tuple[Named | None, list[tuple[Tried, str]]]:
    """Return the effect to be named next, and why each of the others is not.

    One that is too small may explain so much that others, which matter, are not promising beside it: these are then
    fitted, too.
    """
    chosen, others = _choose(study, current, _fitted(study, current, screening), inflation)
    significant = THRESHOLD * inflation.all
    hiding = any(why == TOO_SMALL and PROMISING_SHARE * tried.drop > significant for tried, why in others)
    if chosen is None and hiding:
        ranked = _fitted(study, current, screening, significant, [tried for tried, _ in others])
        return _choose(study, current, ranked, inflation)
    return chosen, others


def _unseen(study: Study, screening: Screening, named: Collection[str]) -> tuple[str, ...]:
    """Return effects that these drives would not show at half their typical size, and those that cannot be tried."""
    tried = {effect.name for effect in study.effects}
    shown = {
        name
        for name, effect in CATALOGUE.items()
        if SMALLER_SHOWN**2 * screening.traces.get(name, np.inf) >= needed(effect) * screening.inflation.of(name)
    }
    return tuple(name for name in CATALOGUE if name not in named and not (name in tried and name in shown))


def _perhaps_jitter(one: Named, found: Search, jitter: Spread | None) -> Named:
    """Return a delay with jitter among its rivals, unless the spread of what follows commands speaks against it.

    `jitter` is None where ticks are too coarse for single commands to be told.
    """
    if one.tried.effect.name not in MEANS:
        return one
    mean = sum(found.final.values[parameter.name] for parameter in one.tried.effect.parameters)
    excluded = jitter is not None and jitter.drop_at(2.0 * mean) < -ALIKE * found.inflation
    return one if excluded else replace(one, rivals=(*one.rivals, JITTER))


def _with_shadows_of_jitter(named: Sequence[Named]) -> list[Named]:
    """Return the effects named; where jitter is or may be there, those as which it shows may be a part of it."""
    there = any(JITTER in (one.tried.effect.name, *one.rivals) for one in named)
    shadows = [there and one.tried.effect.name in LATE and JITTER not in one.rivals for one in named]
    return [
        replace(one, rivals=(*one.rivals, JITTER)) if shadow else one
        for one, shadow in zip(named, shadows, strict=True)
    ]


def _of_chance(found: Search, late: list[Named], spread: Spread) -> tuple[Named, Study] | None:
    """Return jitter or loss of commands, if what the search leaves shows it, and the study without it.

    `spread` is that of jitter where effects named make commands `late`, else that of loss.
    """
    of_late = max((one.tried.drop for one in late), default=0.0)
    if late and spread.drop > max(MAYBE_CHANCE * found.inflation, LEFT_BY_LATE * of_late):
        value = found.final.values
        mean = sum(value.get(parameter.name, 0.0) for one in late for parameter in one.tried.effect.parameters)
        mean = mean if all(one.tried.effect.name in MEANS for one in late) else 0.5 * spread.value
        drop = spread.drop + of_late
        rivals = tuple(one.tried.effect.name for one in late) if spread.drop < THRESHOLD else ()
        # The mean of the delays is known better than their spread.
        size = largest_delay(mean, period_of(found.study))
        largest = Estimate(size, DOUBT_OF_JITTER * size)
        return _chance(JITTER, largest, drop, rivals, late[0].before), without_jitter(found.study, spread, mean)
    share, std = share_lost(found.study, spread) if not late else (0.0, 0.0)
    matters = worth_naming({LOSS: share + PERHAPS * std}, {}, found.study.scene)
    if matters and spread.drop > SURE_LOSS * found.inflation:
        return _chance(LOSS, Estimate(share, std), spread.drop, (), found.final), without_loss(found.study, spread)
    return None


def _chance(name: str, estimate: Estimate, drop: float, rivals: tuple[str, ...], before: Fit) -> Named:
    tried = Tried(CATALOGUE[name], drop, {**before.values, name: estimate.value}, None, 0.5 * drop)
    return Named(tried, rivals, before, {name: estimate})


def with_small_effects(found: Search) -> Fit:
    """Return the final fit with the effects beside it that are there but too small to be named.

    What they explain is not unexplained.
    """
    small = [tried for tried, why in found.others if why == TOO_SMALL][:MOST_SMALL]
    if not small:
        return found.final
    own = [parameter.name for tried in small for parameter in tried.effect.parameters]
    values = {**found.final.values, **{n: t.values[n] for t in small for n in (p.name for p in t.effect.parameters)}}
    return found.study.fit(values, (*found.final.names, *own), found.final.noise, renew=0)


def _coarse(study: Study, found: Search) -> Named | None:
    """Return that the encoders have few ticks, if so: the readings themselves say it."""
    tick = _tick(study)
    if not tick > COARSE:
        return None
    name = "encoder_quantisation"
    value = 2.0 * np.pi / tick
    readings = sum(int(np.sum(predictor.piece.heard.wheel_use)) for predictor in study.predictors)
    # Each reading that falls on a tick, where a fine encoder would fall anywhere, is evidence.
    drop = 2.0 * readings * float(np.log(tick / COARSE) + 1.0)
    tried = Tried(CATALOGUE[name], drop, {**found.final.values, name: value}, None, 0.5 * drop)
    return Named(tried, (), found.final, {name: Estimate(value, value * READ_OFF)})


def _tick(study: Study) -> float:
    """Return the size [rad] of an encoder's tick."""
    return max(predictor.piece.tick for predictor in study.predictors)


def _choose(
    study: Study, current: Fit, ranked: list[Tried], inflation: Inflation
) -> tuple[Named | None, list[tuple[Tried, str]]]:
    """Return the best effect that holds, with its rivals, and why each of the others is not named.

    An effect that is too small to be named comes first if it explains more than one that is to be named: that one may
    be its shadow.
    """
    others: list[tuple[Tried, str]] = []
    chosen: Tried | None = None
    for candidate in _questions_fitted(study, current, ranked, inflation):
        tried, why = candidate, LESS
        if chosen is None:
            tried, why = _judged(study, current, tried, inflation)
        if chosen is None and not why:
            chosen = tried
        else:
            others.append((tried, why))
    small = next((tried for tried, why in others if why == TOO_SMALL), None)
    if chosen is None:
        return None, others
    if small is not None:
        others = [(chosen, LESS), *(other for other in others if other[0] is not small)]
        chosen = small
    margin = max(ALIKE * inflation.of(chosen.effect.name), ALIKE_SHARE * chosen.drop)
    close = [tried for tried, _ in others if chosen.drop - tried.drop < margin]
    if small is None and not study.by_moments:
        return _named_by_courses(study, current, chosen, others, close)
    rivals = tuple(tried.effect.name for tried in close if not why_not(study, current, tried, inflation))
    return Named(chosen, rivals, current), others


def _named_by_courses(
    study: Study, current: Fit, chosen: Tried, others: list[tuple[Tried, str]], close: list[Tried]
) -> tuple[Named, list[tuple[Tried, str]]]:
    """Return the best of the effects that explain the same as the chosen one, with the rest of these as its rivals.

    It is the one that holds best elsewhere; of equals, the catalogue's first.
    """
    judged = [_judged(study, current, one, Inflation(COURSE_INFLATION)) for one in close]
    alike = [chosen, *(one for one, why in judged if not why and alternatives(current, chosen.fit, one.fit))]
    gains = [elsewhere(study, current, one.fit).gain if one.fit else -np.inf for one in alike]
    equals = [one for one, gain in zip(alike, gains, strict=True) if gain > max(gains) - EQUAL]
    best = min(equals, key=lambda one: list(CATALOGUE).index(one.effect.name))
    others = [(chosen, LESS) if one.effect is best.effect else (one, why) for one, why in others]
    return Named(best, tuple(one.effect.name for one in alike if one is not best), current), others


def _questions_fitted(study: Study, current: Fit, ranked: list[Tried], inflation: Inflation) -> list[Tried]:
    """Return what was tried, with everything free wherever the judgement of the best that holds needs it.

    To fit these side by side is faster than one after the other.
    """
    reasons = [why_not(study, current, tried, inflation) for tried in ranked]
    asked = reasons.index("") + 1 if "" in reasons else len(reasons)
    unsure = [tried.fit is None and why in ("", TOO_SMALL) for tried, why in zip(ranked, reasons, strict=True)]
    return _with_everything(study, current, ranked, [*unsure[:asked], *[False] * (len(ranked) - asked)])


def _judged(study: Study, current: Fit, tried: Tried, inflation: Inflation) -> tuple[Tried, str]:
    """Return an effect and why it is not named; what would be is fitted with everything free."""
    why = why_not(study, current, tried, inflation)
    if tried.fit is None and why in ("", TOO_SMALL):
        tried = _with_everything(study, current, [tried], [True])[0]
        why = why_not(study, current, tried, inflation)
    if not why and (study.several or not study.by_moments):
        significant = needed(tried.effect) * inflation.of(tried.effect.name)
        why = why_not_elsewhere(study, current, tried.fit, significant)
    return tried, why


def _fitted(
    study: Study, current: Fit, screening: Screening, least: float | None = None, known: Sequence[Tried] = ()
) -> list[Tried]:
    """Fit the promising effects beside the model, the best ones with everything free; best first.

    They are those whose score is above `least`; by default, a share of the best one. What is `known` stands beside.
    """
    if least is None:
        least = max([LEAST_SCORE, *(PROMISING_SHARE * score.drop for score in screening.scores[:1])])
    there = {tried.effect.name for tried in known}
    promising = [score for score in screening.scores if score.drop > least][:PROMISING]
    promising = [score for score in promising if score.trial.effect not in there]
    if not promising:
        return list(known)
    effects = [CATALOGUE[score.trial.effect] for score in promising]
    names = [[parameter.name for parameter in effect.parameters] for effect in effects]
    quick = study.fit_beside(current, [start_of(score) for score in promising], names)
    tried = [
        Tried(effect, current.squares - squares, values)
        for effect, (values, squares) in zip(effects, quick, strict=True)
    ]
    stuck = [_stuck(one, score, study.scene) for one, score in zip(tried, promising, strict=True)]
    possible = [replace(one, values=as_seen(one.values, study.scene)) for one in tried]
    tried = _with_everything(study, current, possible, stuck)
    tried = sorted([*known, *tried], key=lambda one: -one.evidence)
    least = max(CLOSE * tried[0].drop, LEAST_DROP)
    final = [one.fit is None and one.drop > least for one in tried[:FINALISTS]]
    finalists = _with_everything(study, current, tried[:FINALISTS], final)
    return sorted([*finalists, *tried[FINALISTS:]], key=lambda one: -one.evidence)


def _stuck(tried: Tried, score: Score, scene: Scene) -> bool:
    """Tell whether a quick fit led astray: made things worse although the score, made near this size, foretold better
    ones, or came to what the robot was seen to exceed.
    """
    foretold_better = TRUSTED_SHARE < abs(score.share) < 1.0 / TRUSTED_SHARE
    return contradicted(tried.values, scene) or (tried.drop < 0.0 and foretold_better)


def start_of(score: Score) -> dict[str, float]:
    """Return the values from which a fit of a trial begins: its own, scaled by the share that the score found."""
    result = dict(score.trial.values)
    for name, value in score.trial.values.items():
        known = definition(name)
        if known.switches and not score.trial.threshold and value != known.neutral:
            share = float(np.clip(score.share, -3.0, 3.0))
            result[name] = float(np.clip(value * share, known.lower, known.upper))
    return result


def _with_everything(study: Study, current: Fit, tried: Sequence[Tried], chosen: Sequence[bool]) -> list[Tried]:
    """Return what was tried, the chosen ones fitted with everything free."""
    models = []
    for one in compress(tried, chosen):
        own = [parameter.name for parameter in one.effect.parameters]
        models.append((placed(study, one.effect, one.values, current.noise), (*current.names, *own)))
    fits = iter(study.fits(models, current.noise))
    return [_fully(study, current, one, next(fits)) if fully else one for one, fully in zip(tried, chosen, strict=True)]


def _fully(study: Study, current: Fit, tried: Tried, fit: Fit) -> Tried:
    return Tried(tried.effect, current.squares - fit.squares, fit.values, fit, held_out_gain(study, current, fit))

"""Name effects one after the other: the one that explains most, if it also foretells what it was not fitted on."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from cmr.diagnosis.candidates import lanes_of, size, worth_naming
from cmr.diagnosis.noise import Noise
from cmr.diagnosis.screening import Score, Screening, screen
from cmr.diagnosis.study import Fit, Study
from cmr.model.catalogue import CATALOGUE, definition
from cmr.model.effect import Effect
from cmr.recordings.signal import Floats

PROMISING = 12  # effects that are fitted after the score test
FINALISTS = 3  # that are fitted with everything free
CLOSE = 0.5  # of the best drop: an effect that explains less is no finalist
LEAST_DROP = 20.0
LEAST_SCORE = 10.0  # drop of the sum of squares from which a fit is worth while
THRESHOLD = 30.0  # drop of the sum of squares that one parameter must bring
PER_PARAMETER = 5.0  # more for each further one
ALIKE = 12.0  # drops that differ by less cannot be told apart,
ALIKE_SHARE = 0.02  # nor those that differ by less than this share
MOST_EFFECTS = 6


@dataclass(frozen=True)
class Tried:
    """An effect fitted beside others: its drop of the sum of squared white errors, and what it gains on left-out data.

    `fit` is None where only a quick fit was made.
    """

    effect: Effect
    drop: float
    values: Mapping[str, float]
    fit: Fit | None = None
    held_out: float = float("nan")


@dataclass(frozen=True)
class Named:
    """An effect accepted, with its rivals: effects that explain the data as well in its place."""

    tried: Tried
    rivals: tuple[Tried, ...]
    before: Fit


@dataclass
class Search:
    """What the search found: the paper's model fitted, the final fit, the effects in order, and the runners-up."""

    base: Fit
    final: Fit
    named: list[Named]
    others: list[tuple[Tried, str]]
    inflation: float = 1.0
    screenings: list[Screening] = field(default_factory=list)


def search(study: Study, base: Fit, say: Callable[[str], None]) -> Search:
    """Name effects until nothing significant is left, then drop what has become redundant."""
    current = base
    named: list[Named] = []
    others: list[tuple[Tried, str]] = []
    inflation = 1.0
    screenings = []
    while len(named) < MOST_EFFECTS:
        taken = [one.tried.effect.name for one in named]
        say(f"Trying {len(CATALOGUE) - len(taken)} effects beside {', '.join(taken) or 'the paper model'} ...")
        screening = screen(study, current.values, current.names, taken, current.noise if named else None)
        screenings.append(screening)
        current = study.fit(current.values, current.names, screening.noise, renew=0)
        inflation = screening.inflation
        ranked = _fitted(study, current, screening)
        others = [(tried, "") for tried in ranked]
        chosen, others = _choose(study, current, ranked, inflation)
        if chosen is None:
            break
        named.append(chosen)
        assert chosen.tried.fit is not None
        current = chosen.tried.fit
        if len(named) > 1:
            named, current = _pruned(study, named, current, inflation)
    return Search(base, current, named, others, inflation, screenings)


def _choose(
    study: Study, current: Fit, ranked: list[Tried], inflation: float
) -> tuple[Named | None, list[tuple[Tried, str]]]:
    """Return the best effect that holds, with its rivals, and why each of the others is not named."""
    others = []
    chosen: Tried | None = None
    for candidate in ranked:
        tried = candidate
        why = "explains less than the effect named"
        if chosen is None:
            why = why_not(study, tried, inflation)
            if not why and tried.fit is None:
                tried = _with_everything(study, current, tried)
                why = why_not(study, tried, inflation)
        if chosen is None and not why:
            chosen = tried
        else:
            others.append((tried, why))
    if chosen is None:
        return None, others
    margin = max(ALIKE * inflation, ALIKE_SHARE * chosen.drop)
    rivals = tuple(t for t, _ in others if chosen.drop - t.drop < margin and t.drop > needed(t.effect) * inflation)
    return Named(chosen, rivals, current), others


def why_not(study: Study, tried: Tried, inflation: float) -> str:
    """Return why an effect is not named, empty if nothing speaks against it."""
    if tried.drop < needed(tried.effect) * inflation:
        return "what it explains may be chance"
    names = [parameter.name for parameter in tried.effect.parameters]
    stds = {name: tried.fit.std(name) for name in names} if tried.fit else {}
    if not worth_naming({name: tried.values[name] for name in names}, stds, study.scene):
        return "too small to matter"
    if tried.fit is not None and not tried.held_out > 0.0:
        return "does not hold on data that it was not fitted on"
    return ""


def needed(effect: Effect) -> float:
    """Return the drop of the sum of squares below which an effect may be chance."""
    return THRESHOLD + PER_PARAMETER * (len(effect.parameters) - 1)


def _fitted(study: Study, current: Fit, screening: Screening) -> list[Tried]:
    """Fit the promising effects beside the model, the best ones with everything free; best first."""
    promising = [score for score in screening.scores if score.drop > LEAST_SCORE][:PROMISING]
    if not promising:
        return []
    effects = [CATALOGUE[score.trial.effect] for score in promising]
    names = [[parameter.name for parameter in effect.parameters] for effect in effects]
    quick = study.fit_beside(current, [start_of(score) for score in promising], names)
    tried = [
        Tried(effect, current.squares - squares, values)
        for effect, (values, squares) in zip(effects, quick, strict=True)
    ]
    tried.sort(key=lambda one: -one.drop)
    close = [one for one in tried[:FINALISTS] if one.drop > CLOSE * tried[0].drop and one.drop > LEAST_DROP]
    finalists = [_with_everything(study, current, one) for one in close]
    return sorted([*finalists, *tried[len(close) :]], key=lambda one: -one.drop)


def start_of(score: Score) -> dict[str, float]:
    """Return the values from which a fit of a trial begins: its own, scaled by the share that the score found."""
    result = dict(score.trial.values)
    for name, value in score.trial.values.items():
        known = definition(name)
        if known.switches and not score.trial.threshold and value != known.neutral:
            share = float(np.clip(score.share, -3.0, 3.0))
            result[name] = float(np.clip(value * share, known.lower, known.upper))
    return result


def _with_everything(study: Study, current: Fit, tried: Tried) -> Tried:
    names = (*current.names, *(parameter.name for parameter in tried.effect.parameters))
    fit = study.fit(tried.values, names, current.noise, renew=0)
    return Tried(tried.effect, current.squares - fit.squares, fit.values, fit, held_out_gain(study, current, fit))


def held_out_gain(study: Study, before: Fit, after: Fit) -> float:
    """Return the log-likelihood that a fit gains over another on folds that both leave out."""
    return 0.5 * (left_out(before, study.folds) - left_out(after, study.folds))


def left_out(fit: Fit, folds: np.typing.NDArray[np.int64]) -> float:
    """Return the sum of squared white errors of folds, each foretold by a fit without it (to first order)."""
    total = 0.0
    normal, right = fit.slopes.T @ fit.slopes, fit.slopes.T @ fit.rest
    for fold in np.unique(folds):
        inside = folds == fold
        slopes, rest = fit.slopes[inside], fit.rest[inside]
        remaining = normal - slopes.T @ slopes
        step = -np.linalg.lstsq(remaining, right - slopes.T @ rest, rcond=1e-10)[0]
        foretold = rest + slopes @ step
        total += float(foretold @ foretold)
    return total


def _pruned(study: Study, named: list[Named], current: Fit, inflation: float) -> tuple[list[Named], Fit]:
    """Drop effects that the others have made redundant."""
    for one in list(named):
        own = {parameter.name for parameter in one.tried.effect.parameters}
        names = tuple(name for name in current.names if name not in own)
        values = {name: value for name, value in current.values.items() if name not in own}
        without = study.fit(values, names, current.noise, renew=0)
        if without.squares - current.squares < needed(one.tried.effect) * inflation:
            named = [other for other in named if other is not one]
            current = without
    return named, current

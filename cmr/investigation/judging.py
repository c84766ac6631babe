"""Weigh the explanations on all data so far: nothing more, or one more effect of the catalogue beside those named.

Each explanation is fitted with priors, from its last fit and from the values that promise most in a score test; the
better fit counts. All have the same noise model, that of the score test, so that no rival hides in its own. With the
drop D of the sum of squares and k parameters of its own among n white errors,

    evidence = D - k log n - rarity,

twice the logarithm of the odds against nothing more (Schwarz, Annals of Statistics 6, 1978).
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from cmr.estimation.candidates import SMALLEST, is_rough, lanes_of, rarity, size, worth_naming
from cmr.estimation.gauss_newton import Fit
from cmr.estimation.noise import Noise
from cmr.estimation.search.screening import Score, Screening, screen, start_of
from cmr.investigation.evidence import Beliefs
from cmr.model.catalogue import CATALOGUE

ODDS = 1000.0  # at which an effect is named, or excluded
NAMED = 2.0 * math.log(ODDS)
OPEN = 18.0  # evidence (twice a logarithm of odds) by which a remaining explanation is at most behind the best
FITTED_BEHIND = 30.0  # explanations further behind are not fitted, only scored
MOST_FITTED = 10  # explanations that are fitted at once, the most promising ones first
HOPEFUL = 0.5  # share of the best score: a fit keeps more or less than slopes promise
MOST_BESIDE, WORTH_EXPLAINING = 2, 20.0  # effects beside which the noise is estimated; drop that each must promise
OTHER_SIZES, MOST_UNSTUCK = (0.6, 0.8, 1.25, 1.6), 3  # factors on the fitted size; number of rough effects to try
BETTER_START = 3.0  # by which a score must exceed the fit for the fit to begin again
HARDLY_NEW = 1.15  # ratio to the time of the last judgement
NOTHING = ""  # the name of the explanation without a further effect


@dataclass(frozen=True)
class Explanation:
    """One effect, by `name`, beside the named ones, or NOTHING more.

    `values` are all values of the model, `drop` is the drop of the sum of squares against nothing more, `penalty` the
    least drop required. An explanation that is not `fitted` was only scored.
    """

    name: str
    values: Mapping[str, float]
    drop: float
    penalty: float
    fitted: bool = True

    @property
    def evidence(self) -> float:
        """Twice the logarithm of its odds against no further effect."""
        return self.drop - self.penalty


@dataclass(frozen=True)
class Judgement:
    """The fit with nothing more than the effects `named`, and all explanations, best first.

    `screening` contains the first-order gain of every effect beside the fit.
    """

    problem: Beliefs
    noise: Noise
    base: Fit
    named: tuple[str, ...]
    explanations: tuple[Explanation, ...]
    screening: Screening
    _by_name: Mapping[str, Explanation] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "_by_name", {one.name: one for one in self.explanations})

    @property
    def best(self) -> Explanation:
        """The likeliest explanation."""
        return self.explanations[0]

    @property
    def left(self) -> tuple[Explanation, ...]:
        """The remaining explanations: not far behind the best, best first."""
        return tuple(one for one in self.explanations if one.evidence > self.best.evidence - OPEN)

    def of(self, name: str) -> Explanation | None:
        """Return the explanation of this name; None if it was not evaluated."""
        return self._by_name.get(name)

    def is_large(self, name: str, values: Mapping[str, float]) -> bool:
        """Return whether an effect with these values is large enough to matter; a limit may be out of reach."""
        effect, excitation = CATALOGUE[name], self.problem.excitation
        own = {parameter.name: values[parameter.name] for parameter in effect.parameters}
        limits = [parameter for parameter in effect.parameters if parameter.is_limit]
        if limits and all(own[one.name] > size(one, excitation) / SMALLEST for one in limits):
            return False
        return worth_naming(own, {}, excitation)

    @property
    def probabilities(self) -> dict[str, float]:
        """The probability of each explanation, by name."""
        weights = {
            one.name: math.exp(0.5 * max(one.evidence - self.best.evidence, -700.0)) for one in self.explanations
        }
        total = sum(weights.values())
        return {name: weight / total for name, weight in weights.items()}


def judge(
    problem: Beliefs,
    named: Sequence[str],
    start: Mapping[str, float],
    before: Judgement | None = None,
) -> Judgement:
    """Weigh all explanations beside effects `named`, whose fit begins at `start`; `before` is the last judgement."""
    free = (*problem.own, *own_parameters(named))
    known = _known(before, named)
    noise = _noise(problem, named, start, before)
    base = problem.fits([(start, free)], noise)[0]
    screening = screen(problem, base.values, free, named, noise, keep_noise=True)
    scored = {score.trial.effect: score for score in screening.scores}
    promised = {name: max(_promise(name, scored), known.get(name, (0.0, {}))[0]) for name in {*scored, *known}}
    penalties = {name: penalty(name, problem) for name in promised}
    hopes = {name: promised[name] - penalties[name] for name in promised}
    fits = _hopeful_fitted(problem, base, hopes, penalties, scored, known)
    explanations = [Explanation(NOTHING, base.values, 0.0, 0.0)]
    for name, fit in fits.items():
        explanations.append(Explanation(name, fit.values, base.squares - fit.squares, penalties[name]))
    for name in (name for name in scored if name not in fits):
        values = {**base.values, **start_of(scored[name])}
        explanations.append(Explanation(name, values, scored[name].drop, penalties[name], fitted=False))
    explanations.sort(key=lambda one: -one.evidence)
    return Judgement(problem, noise, base, tuple(named), tuple(explanations), screening)


def ahead_since(judgement: Judgement, other: Explanation, moment: float) -> float:
    """Return the lead of the likeliest explanation over another one by the data after a moment alone."""
    problem = judgement.problem
    white = problem.white(lanes_of([judgement.best.values, other.values]), judgement.noise)[: problem.rows_of_data]
    own, others = np.sum(white[problem.since(moment)] ** 2, axis=0)
    return float(others - own)


def own_parameters(effects: Sequence[str]) -> tuple[str, ...]:
    """Return the parameters of some effects."""
    return tuple(parameter.name for name in effects for parameter in CATALOGUE[name].parameters)


def _promise(name: str, scored: Mapping[str, Score]) -> float:
    return scored[name].drop if name in scored else 0.0


def _noise(problem: Beliefs, named: Sequence[str], start: Mapping[str, float], before: Judgement | None) -> Noise:
    """Return the noise beside one of a few models: nothing more, the last best, the effects with the most information.

    A model without a present effect overestimates the noise; one with too many effects makes just these look likely. So
    each model is judged with its own noise, by its likelihood minus the penalty of its parameters. The strongest
    effects are taken from the last judgement if hardly any data are new.
    """
    free = (*problem.own, *own_parameters(named))
    if before is not None and before.named == tuple(named) and problem.last < HARDLY_NEW * before.problem.last:
        first, noise = before.screening, problem.found(problem.errors(start))
    else:
        first = screen(problem, start, free, named, None)
        noise = first.noise
    models = [(NOTHING, dict(start))]
    if before is not None and before.named == tuple(named) and before.best.name != NOTHING:
        models.append((before.best.name, dict(before.best.values)))
    models += [(one.trial.effect, {**start, **start_of(one)}) for one in _most_telling(first, free)]
    names = [(*free, *own_parameters([name] if name else [])) for name, _ in models]
    fits = problem.fits([(values, of) for (_, values), of in zip(models, names, strict=True)], noise)
    noises = [problem.found(problem.errors(fit.values)) for fit in fits]
    costs = [
        float(np.sum(problem.white(fit.values, noise) ** 2))
        + noise.log_size
        + (penalty(name, problem) if name else 0.0)
        for (name, _), fit, noise in zip(models, fits, noises, strict=True)
    ]
    return noises[int(np.argmin(costs))]


def _most_telling(screening: Screening, free: Sequence[str]) -> list[Score]:
    """Return the scores of the few effects that together explain most, chosen one after the other."""
    left = screening.linear.beside(free, ())
    normal, pulls = left.normal.copy(), left.pulls.copy()
    by_effect = {score.trial.effect: score for score in screening.scores}
    effects = [trial.effect for trial in screening.trials]
    chosen: list[str] = []
    while len(chosen) < MOST_BESIDE:
        sizes = np.diag(normal)
        drops = np.where(sizes > 1e-6, pulls**2 / np.maximum(sizes, 1e-6), 0.0)
        drops[[number for number, name in enumerate(effects) if name in chosen or name not in by_effect]] = 0.0
        best = int(np.argmax(drops))
        if drops[best] < WORTH_EXPLAINING:
            break
        chosen.append(effects[best])
        share = normal[:, best] / sizes[best]
        pulls = pulls - share * pulls[best]
        normal = normal - np.outer(share, normal[best])
    return [by_effect[name] for name in chosen]


def penalty(name: str, problem: Beliefs) -> float:
    """Return the drop that makes an effect as likely as nothing more."""
    return len(CATALOGUE[name].parameters) * math.log(max(problem.rows_of_data, 2)) + rarity(name)


def _known(before: Judgement | None, named: Sequence[str]) -> dict[str, tuple[float, Mapping[str, float]]]:
    """Return drop and values of each explanation that was fitted, by name, if the same effects were named."""
    if before is None or before.named != tuple(named):
        return {}
    return {one.name: (one.drop, one.values) for one in before.explanations if one.name and one.fitted}


def _hopeful_fitted(
    problem: Beliefs,
    base: Fit,
    hopes: Mapping[str, float],
    penalties: Mapping[str, float],
    scored: Mapping[str, Score],
    known: Mapping[str, tuple[float, Mapping[str, float]]],
) -> dict[str, Fit]:
    """Return the best fit of each explanation, by name, whose score may bring its evidence near the best one's.

    A score promises more than a fit keeps: an explanation that was only scored must not be near the best or lead.
    """
    order = sorted(hopes, key=lambda name: -hopes[name])
    enough = HOPEFUL * max(hopes.values(), default=0.0) - FITTED_BEHIND
    fits: dict[str, Fit] = {}
    while names := [name for name in order if name not in fits and hopes[name] > enough][:MOST_FITTED]:
        new = _fitted(problem, base, names, scored, known)
        fits |= new | _unstuck(problem, base, new)
        enough = max(0.0, *(base.squares - fit.squares - penalties[name] for name, fit in fits.items())) - OPEN
    return fits


def _fitted(
    problem: Beliefs,
    base: Fit,
    names: Sequence[str],
    scored: Mapping[str, Score],
    known: Mapping[str, tuple[float, Mapping[str, float]]],
) -> dict[str, Fit]:
    """Return the best fit of each explanation, by name."""
    models = [(name, start) for name in names for start in _starts(name, base, scored, known)]
    own = {name: tuple(p.name for p in CATALOGUE[name].parameters) for name in names}
    fits = problem.fits([(start, (*base.names, *own[name])) for name, start in models], base.noise)
    result: dict[str, Fit] = {}
    for (name, _), fit in zip(models, fits, strict=True):
        if name not in result or fit.squares < result[name].squares:
            result[name] = fit
    return result


def _unstuck(problem: Beliefs, base: Fit, fits: Mapping[str, Fit]) -> dict[str, Fit]:
    """Return better fits of the strongest rough effects, by name, from other sizes.

    The sum of squares of an effect with a threshold is rough: a fit stays at its start, and a worse explanation may
    win.
    """
    leading = sorted((name for name in fits if _may_be_stuck(name)), key=lambda name: fits[name].squares)
    leading = [name for name in leading if base.squares - fits[name].squares > WORTH_EXPLAINING][:MOST_UNSTUCK]
    own = {name: tuple(p.name for p in CATALOGUE[name].parameters) for name in leading}
    starts = [(name, _resized(name, fits[name].values, factor)) for name in leading for factor in OTHER_SIZES]
    if not starts:
        return {}
    found = problem.fit_beside(base, [start for _, start in starts], [own[name] for name, _ in starts])
    best: dict[str, tuple[float, dict[str, float]]] = {}
    for (name, _), (values, squares) in zip(starts, found, strict=True):
        if squares < min(fits[name].squares - BETTER_START, best.get(name, (math.inf, {}))[0]):
            best[name] = squares, values
    refits = problem.fits([(values, (*base.names, *own[name])) for name, (_, values) in best.items()], base.noise)
    return {name: fit for name, fit in zip(best, refits, strict=True) if fit.squares < fits[name].squares}


def _may_be_stuck(name: str) -> bool:
    return is_rough(CATALOGUE[name]) and not CATALOGUE[name].locality


def _resized(name: str, values: Mapping[str, float], factor: float) -> dict[str, float]:
    """Return an effect's values with sizes times a factor, within their bounds."""
    return {
        p.name: float(np.clip(values[p.name] * (factor if p.switches else 1.0), p.lower, p.upper))
        for p in CATALOGUE[name].parameters
    }


def _starts(
    name: str, base: Fit, scored: Mapping[str, Score], known: Mapping[str, tuple[float, Mapping[str, float]]]
) -> Iterator[dict[str, float]]:
    """Yield starting values of an explanation's fit: its last fit, and those whose score promises more."""
    before = known.get(name)
    if before is not None:
        yield dict(before[1])
    score = scored.get(name)
    if score is not None and (before is None or score.drop > before[0] + BETTER_START or CATALOGUE[name].locality):
        yield {**base.values, **start_of(score)}

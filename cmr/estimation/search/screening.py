"""Screening: a score test of every effect of the catalogue at once.

With n white errors, p free parameters and c trials (an effect at a typical size):

    w (n,)    white errors of the current model
    J (n, p)  their change per step of each free parameter
    d (n, c)  their change with each trial
    P         = I - J (J' J)^-1 J', projection orthogonal to the free parameters
    size_c    = |P d_c|^2,    pull_c = d_c' P w
    share_c   = -pull_c / size_c, of the trial's size; one sign only where the effect has one
    drop_c    = -(2 share_c pull_c + share_c^2 size_c), which is pull_c^2 / size_c where the share is free

`drop` predicts the drop of S; by chance it is inflation times chi-squared (inflation.py).

The noise is estimated from the residuals after all effects together, and the free parameters, are fitted (to first
order, with a ridge 1 / reach^2 for each trial): noise estimated with a wrong model would absorb the model's errors.

Reference: C. R. Rao, Proceedings of the Cambridge Philosophical Society 44, 1948 (score test).
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from cmr.estimation.candidates import Trial, lanes_of, step_of, trials
from cmr.estimation.gauss_newton import inward
from cmr.estimation.noise import Noise
from cmr.estimation.prediction import Errors
from cmr.estimation.problem import Problem
from cmr.estimation.search.inflation import NOTHING, Beside, Inflation, inflation_of, left_by
from cmr.estimation.search.linear import Linear
from cmr.estimation.search.localisation import NOWHERE, Local, best_moment, best_place
from cmr.model.catalogue import CATALOGUE, definition
from cmr.model.effect import Effect
from cmr.recordings.signal import Floats

LARGEST_SHARE = 3.0  # of the typical size that the noise's model may use, and with which a fit may begin
MOST_AT_ONCE = 1.5  # of a trial's size with which a fit of several parameters begins
MOST_OF_A_LIMIT = 1.3  # of a trial's size that a limit's score may use


@dataclass(frozen=True)
class Score:
    """The score of a trial: the drop of the sum of squared white errors, at this share of the trial's size."""

    trial: Trial
    drop: float
    share: float


@dataclass(frozen=True)
class Screening:
    """The noise, the best score of each effect, best first, and the inflation of scores.

    `traces` is the detectability of each effect: the sum of squared white errors caused by its typical size. `linear`
    are the first-order products of all `trials`.
    """

    noise: Noise
    scores: tuple[Score, ...]
    inflation: Inflation
    traces: Mapping[str, float]
    trials: tuple[Trial, ...]
    linear: Linear


def screen(
    problem: Problem,
    values: Mapping[str, float],
    names: Sequence[str],
    selected: Sequence[str],
    noise: Noise | None,
    *,
    keep_noise: bool = False,
) -> Screening:
    """Score all effects but those `selected`, beside the free parameters `names` at `values`.

    With `keep_noise` the given noise is used; otherwise it is re-estimated, starting from the given one.
    """
    others = [one for one in problem.effects if one.name not in selected and _is_due(one, problem, selected)]
    attempts = trials(problem.excitation, others)
    steps = [inward(name, values[name], step_of(name, values[name], problem.excitation)) for name in names]
    sets = [dict(values)]
    sets += [{**values, name: values[name] + step} for name, step in zip(names, steps, strict=True)]
    sets += [problem.excitation.without(values, _own(name)) for name in selected]
    sets += [{**values, **trial.values} for trial in attempts]
    errors = problem.errors(lanes_of(sets))
    off = list(range(1 + len(names), 1 + len(names) + len(selected)))
    changes = [changes_of(one) for one in errors]
    explaining = [number for number in range(len(sets)) if number not in off]
    without = [chosen([one], off)[0] for one in changes]
    changes = chosen(changes, explaining) if off else changes
    if noise is None:
        plain = Noise.plain(problem.predictors, changes)
        noise = noise_of_all(problem, changes, plain, _reaches(attempts, len(names)))
    attempts, changes = _localised(problem, attempts, changes, len(names), noise, problem.rows(errors))
    if not keep_noise:
        noise = noise_of_all(problem, changes, noise, _reaches(attempts, len(names)))
    white = problem.made_white(changes, noise)
    beside = Beside.of(white, len(names), problem.of_wheels)
    linear = _linear(white, problem.made_white(without, noise) if off else white[:, :0], names, steps, selected)
    sizes = beside.sizes
    scores = [_score(trial, size, pull) for trial, size, pull in zip(attempts, sizes, beside.pulls, strict=True)]
    usual = [number for number, trial in enumerate(attempts) if not trial.spare]
    inflation = inflation_of([attempts[n].effect for n in usual], beside.only(np.array(usual, np.int64)))
    return Screening(noise, _best(scores), inflation, _traces(attempts, sizes), tuple(attempts), linear)


def _best(scores: Sequence[Score]) -> tuple[Score, ...]:
    """Return the best score of each effect, best first."""
    best: dict[str, Score] = {}
    for score in sorted(scores, key=lambda score: -score.drop):
        best.setdefault(score.trial.effect, score)
    return tuple(_together(score, scores) for score in best.values())


def _traces(attempts: Sequence[Trial], sizes: Floats) -> dict[str, float]:
    """Return the detectability of each effect at its typical size; `sizes` (c,) are those of the trials."""
    traces: dict[str, float] = {}
    for trial, size in zip(attempts, sizes, strict=True):
        if not trial.spare:
            traces[trial.effect] = max(float(size) / trial.portion**2, traces.get(trial.effect, 0.0))
    return traces


def _is_due(effect: Effect, problem: Problem, selected: Sequence[str]) -> bool:
    """Return whether an effect may be tested: one that never occurs alone requires another one to be present."""
    return effect.beside in ("", *selected) or problem.excitation.gives(CATALOGUE[effect.beside])


def _own(effect: str) -> list[str]:
    return [parameter.name for parameter in CATALOGUE[effect].parameters]


def _linear(
    white: Floats, off: Floats, names: Sequence[str], steps: Sequence[float], selected: Sequence[str]
) -> Linear:
    """Return the products of all columns, from those of the errors, free parameters and trials, and of effects off."""
    ends = 1 + len(names)
    columns = np.concatenate([white[:, :ends], off, white[:, ends:]], axis=1)
    return Linear(columns.T @ columns, tuple(names), np.array(steps), tuple(selected))


def _together(best: Score, scores: Sequence[Score]) -> Score:
    """Return the best score of a localised effect with all of its scoring parameters at once."""
    if not best.trial.local:
        return best
    values = dict(best.trial.values)
    for score in scores:
        if score.trial.effect == best.trial.effect:
            for name, value in score.trial.values.items():
                known = definition(name)
                if known.switches and value != known.neutral:
                    share = float(np.clip(score.share, -MOST_AT_ONCE, MOST_AT_ONCE))
                    values[name] = float(np.clip(value * share, known.lower, known.upper))
    return Score(replace(best.trial, values=values), best.drop, 1.0)


def changes_of(errors: Errors) -> Errors:
    """Replace the errors of each candidate except the first by their difference from the first one's.

    They are large, so this is done in place.
    """
    for every in errors.of.values():
        every[:, 1:] -= every[:, :1]
    return errors


def _localised(
    problem: Problem, attempts: Sequence[Trial], changes: Sequence[Errors], free: int, noise: Noise, rows: Floats
) -> tuple[list[Trial], list[Errors]]:
    """Replace trials that act always or everywhere by those with the best start time, or the best place.

    Returns the trials and their changes.
    """
    found = _locals(problem, attempts, changes, free, noise, rows)
    kept, columns, masks = [], [*range(free + 1)], {}
    for number, trial in enumerate(attempts):
        local = found.get(trial.effect)
        if local is not None:
            if local.drop <= 0.0:
                continue
            where = {CATALOGUE[trial.effect].parameter_of(kind): value for kind, value in local.values.items()}
            trial, masks[len(columns)] = replace(trial, values={**trial.values, **where}), local.inside
        kept.append(trial)
        columns.append(number + free + 1)
    return kept, problem.masked(chosen(changes, columns), masks)


def _locals(
    problem: Problem, attempts: Sequence[Trial], changes: Sequence[Errors], free: int, noise: Noise, rows: Floats
) -> dict[str, Local]:
    """Return the time or place where each local effect explains most, by name; no start times of several recordings."""
    own = [number for number, trial in enumerate(attempts) if trial.local]
    white = problem.made_white(chosen(changes, [*range(1 + free), *(1 + free + number for number in own)]), noise)
    rest, basis = left_by(white, free)
    effects = [attempts[number].effect for number in own]
    result = {}
    for effect, local in dict.fromkeys((attempts[number].effect, attempts[number].local) for number in own):
        moves = white[:, [1 + free + number for number, name in enumerate(effects) if name == effect]]
        if local == "place":
            result[effect] = best_place(moves, rest, basis, rows[:, 1:])
        else:
            result[effect] = NOWHERE if problem.several else best_moment(moves, rest, basis, rows[:, 0])
    return result


def chosen(errors: Sequence[Errors], columns: Sequence[int]) -> list[Errors]:
    """Return the errors of some candidates."""
    return [
        replace(one, of={name: np.take(every, columns, axis=1) for name, every in one.of.items()}) for one in errors
    ]


def _reaches(attempts: Sequence[Trial], free: int) -> Floats:
    """Return the allowed multiple of each change: unlimited for free parameters, LARGEST_SHARE for trials."""
    return np.array([np.inf] * free + [LARGEST_SHARE / trial.portion for trial in attempts])


def noise_of_all(problem: Problem, changes: Sequence[Errors], noise: Noise, reaches: Floats) -> Noise:
    """Estimate the noise of the residuals after fitting all changes (c) together, to first order.

    `noise` is the estimate so far. Each change may be applied up to about `reaches` (c,) times.
    """
    white = problem.made_white(changes, noise)
    products = white.T @ white
    normal, pulls = products[1:, 1:], products[1:, 0]
    free = np.isinf(reaches)
    prior = np.where(free, 1e-9 * np.diag(normal) + 1e-12, reaches**-2.0)
    shares = np.asarray(-np.linalg.solve(normal + np.diag(prior), pulls), np.float64)
    return problem.found([_explained(one, shares) for one in changes])


def _explained(changes: Errors, shares: Floats) -> Errors:
    """Return the errors (n, 1) after subtracting each candidate's share, except for the first."""
    weights = np.append(1.0, shares)[:, None]
    return replace(changes, of={name: every @ weights for name, every in changes.of.items()})


def _score(trial: Trial, size: float, pull: float) -> Score:
    if size < NOTHING:
        return Score(trial, 0.0, 0.0)
    share = -pull / size
    if trial.threshold:
        share = min(share, MOST_OF_A_LIMIT)
    if trial.threshold or one_sided(trial):
        share = max(share, 0.0)
    return Score(trial, float(-(2.0 * share * pull + share**2 * size)), float(share))


def one_sided(trial: Trial) -> bool:
    """Return whether the effect can have only one sign; a present one may also become smaller."""
    if trial.origin:
        return False
    switches = [
        definition(name)
        for name, value in trial.values.items()
        if definition(name).switches and value != definition(name).neutral
    ]
    return all(parameter.lower == parameter.neutral for parameter in switches)


def start_of(score: Score) -> dict[str, float]:
    """Return the start values of a trial's fit: its own, scaled by the share from the score test."""
    result = dict(score.trial.values)
    for name, value in score.trial.values.items():
        known = definition(name)
        if known.switches and not score.trial.threshold and value != score.trial.origin.get(name, known.neutral):
            most = LARGEST_SHARE / score.trial.portion
            share = float(np.clip(score.share, -most, most))
            origin = score.trial.origin.get(name, 0.0)
            result[name] = float(np.clip(origin + (value - origin) * share, known.lower, known.upper))
    return result

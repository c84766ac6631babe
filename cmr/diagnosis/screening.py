"""Try every effect of the catalogue at once: how much of the prediction errors would it explain (score test)?

The noise is taken from what is left when all effects together, and the parameters in use, have explained what they can
(to first order): noise found beside a wrong model would swallow what the model gets wrong.
"""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from cmr.diagnosis.candidates import Trial, lanes_of, step_of, trials
from cmr.diagnosis.fitting import inward
from cmr.diagnosis.inflation import NOTHING, Beside, Inflation, inflation_of, left_by
from cmr.diagnosis.localising import NOWHERE, Local, best_moment, best_place
from cmr.diagnosis.noise import Noise
from cmr.diagnosis.prediction import Errors
from cmr.diagnosis.study import Study
from cmr.model.catalogue import definition
from cmr.recordings.signal import Floats

LARGEST_SHARE = 3.0  # of a trial's size that the noise's model may use
MOST_AT_ONCE = 1.5  # of a trial's size with which a fit of several parameters begins
MOST_OF_A_LIMIT = 1.3  # of a trial's size that a limit's score may use


@dataclass(frozen=True)
class Score:
    """What a trial would explain: the drop of the sum of squared white errors, at this share of the trial's size."""

    trial: Trial
    drop: float
    share: float


@dataclass(frozen=True)
class Screening:
    """The noise, the best score of each effect, best first, and the inflation of scores.

    `traces` tells by effect how much of its typical size would show: the sum of squared white errors that it makes.
    """

    noise: Noise
    scores: tuple[Score, ...]
    inflation: Inflation
    traces: Mapping[str, float]


def screen(
    study: Study, values: Mapping[str, float], names: Sequence[str], without: Collection[str], noise: Noise | None
) -> Screening:
    """Score all effects but those `without`, beside the free parameters `names` at `values`."""
    attempts = trials(study.scene, [effect for effect in study.effects if effect.name not in without])
    steps = [inward(name, values[name], step_of(name, values[name], study.scene)) for name in names]
    sets = [dict(values)]
    sets += [{**values, name: values[name] + step} for name, step in zip(names, steps, strict=True)]
    sets += [{**values, **trial.values} for trial in attempts]
    errors = study.errors(lanes_of(sets))
    rows = study.rows(errors)
    changes = [_changes(one) for one in errors]
    if noise is None:
        plain = Noise.plain(study.predictors, changes)
        noise = noise_of_all(study, changes, plain, len(names))
    attempts, changes = _localised(study, attempts, changes, len(names), noise, rows)
    noise = noise_of_all(study, changes, noise, len(names))
    beside = Beside.of(study.made_white(changes, noise), len(names), study.of_wheels)
    sizes = beside.sizes
    scores = [_score(trial, size, pull) for trial, size, pull in zip(attempts, sizes, beside.pulls, strict=True)]
    best: dict[str, Score] = {}
    for score in sorted(scores, key=lambda score: -score.drop):
        best.setdefault(score.trial.effect, score)
    best = {name: _together(score, scores) for name, score in best.items()}
    traces: dict[str, float] = {}
    usual = [number for number, trial in enumerate(attempts) if not trial.spare]
    for number in usual:
        effect = attempts[number].effect
        traces[effect] = max(float(sizes[number]), traces.get(effect, 0.0))
    inflation = inflation_of([attempts[n].effect for n in usual], beside.only(np.array(usual, np.int64)))
    return Screening(noise, tuple(best.values()), inflation, traces)


def _together(best: Score, scores: Sequence[Score]) -> Score:
    """Return the best score of an effect of a time or place with all its parameters at once, as far as each scores."""
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


def _changes(errors: Errors) -> Errors:
    """Return what each candidate but the first changes of the first one's errors, in the place of its own.

    They are large, and so are written over.
    """
    for every in errors.of.values():
        every[:, 1:] -= every[:, :1]
    return errors


def _localised(
    study: Study, attempts: Sequence[Trial], changes: Sequence[Errors], free: int, noise: Noise, rows: Floats
) -> tuple[list[Trial], list[Errors]]:
    """Replace trials that act always or everywhere by those that act from the best moment on, or at the best place.

    Returns the trials and their changes.
    """
    found = _locals(study, attempts, changes, free, noise, rows)
    kept, columns, masks = [], [*range(free + 1)], {}
    for number, trial in enumerate(attempts):
        local = found.get(trial.effect)
        if local is not None:
            if local.drop <= 0.0:
                continue
            where = {f"{trial.effect}_{quantity}": value for quantity, value in local.values.items()}
            trial, masks[len(columns)] = replace(trial, values={**trial.values, **where}), local.inside
        kept.append(trial)
        columns.append(number + free + 1)
    return kept, study.masked(chosen(changes, columns), masks)


def _locals(
    study: Study, attempts: Sequence[Trial], changes: Sequence[Errors], free: int, noise: Noise, rows: Floats
) -> dict[str, Local]:
    """Return where each local effect explains most, by name; a moment is not looked for in several recordings."""
    own = [number for number, trial in enumerate(attempts) if trial.local]
    white = study.made_white(chosen(changes, [*range(1 + free), *(1 + free + number for number in own)]), noise)
    rest, basis = left_by(white, free)
    effects = [attempts[number].effect for number in own]
    result = {}
    for effect, local in dict.fromkeys((attempts[number].effect, attempts[number].local) for number in own):
        moves = white[:, [1 + free + number for number, name in enumerate(effects) if name == effect]]
        if local == "place":
            result[effect] = best_place(moves, rest, basis, rows[:, 1:])
        else:
            result[effect] = NOWHERE if study.several else best_moment(moves, rest, basis, rows[:, 0])
    return result


def chosen(errors: Sequence[Errors], columns: Sequence[int]) -> list[Errors]:
    """Return the errors of some candidates."""
    return [
        Errors({name: np.take(every, columns, axis=1) for name, every in one.of.items()}, one.motion) for one in errors
    ]


def noise_of_all(study: Study, changes: Sequence[Errors], noise: Noise, free: int) -> Noise:
    """Return the noise that is left when the first `free` moves, and all trials, have explained what they can.

    `noise` is what is known of it so far.
    """
    white = study.made_white(changes, noise)
    products = white.T @ white
    normal, pulls = products[1:, 1:], products[1:, 0]
    prior = np.full(len(normal), LARGEST_SHARE**-2)
    prior[:free] = 1e-9 * np.diag(normal)[:free] + 1e-12
    shares = np.asarray(-np.linalg.solve(normal + np.diag(prior), pulls), np.float64)
    return study.found([_explained(one, shares) for one in changes])


def _explained(changes: Errors, shares: Floats) -> Errors:
    """Return the errors (n, 1) left when each candidate but the first has explained its share."""
    weights = np.append(1.0, shares)[:, None]
    return Errors({name: every @ weights for name, every in changes.of.items()}, changes.motion)


def _score(trial: Trial, size: float, pull: float) -> Score:
    if size < NOTHING:
        return Score(trial, 0.0, 0.0)
    share = -pull / size
    if trial.threshold:
        share = min(share, MOST_OF_A_LIMIT)
    if trial.threshold or _one_sided(trial):
        share = max(share, 0.0)
    return Score(trial, float(-(2.0 * share * pull + share**2 * size)), float(share))


def _one_sided(trial: Trial) -> bool:
    """Tell whether the effect has one sign only."""
    switches = [
        definition(name)
        for name, value in trial.values.items()
        if definition(name).switches and value != definition(name).neutral
    ]
    return all(parameter.lower == parameter.neutral for parameter in switches)

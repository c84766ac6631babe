"""Extend the model by a generic term if no effect of the catalogue explains the remaining structure.

A parameter file may hold any parameter of the model, each neutral by default (interfaces, section 3), so generic terms
are parameters of the model like all others: cmr.model.effects.generic, which the extended file names among its effects
and cmr-sim runs. They are not effects of the catalogue: they are never named, here or in diagnosis.json.

A sparse regression chooses the products: the one that predicts left-out folds best, then the next beside it, and each
is removed when the others make it redundant (stepwise regression with cross-validation; T. Hastie, R. Tibshirani and J.
Friedman, The Elements of Statistical Learning, 2nd ed., 2009, sections 3.3 and 7.10). The coefficients are then fitted
together with the model's other parameters, and the term is accepted only if free runs improve on blocks of time that it
was not fitted to.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from cmr.estimation.gain import Gain, measure
from cmr.estimation.gauss_newton import Fit
from cmr.estimation.problem import Problem
from cmr.model.catalogue import GENERIC_TERMS, definition
from cmr.model.effects.generic import BODY
from cmr.model.parameters import ParameterDefinition
from cmr.recordings.signal import Floats

MOST_PRODUCTS = 4  # of a generic term
LEAST = 20.0  # drop of the sum of squared white errors on left-out folds that a product must bring,
LEAST_SHARE = 0.05  # and share of the term's final total drop
LARGEST_LOSS = 0.99  # no signal's free runs may get worse by more,
LEAST_GAIN = 1.05  # and some signal's must get better by as much


@dataclass(frozen=True)
class Extension:
    """A generic term accepted: its products by the names of their coefficients, and the fit with it.

    `held_out` is the log-likelihood that it adds on folds left out, `gain` that of free runs on blocks left out.
    """

    names: tuple[str, ...]
    fit: Fit
    held_out: float
    gain: Gain


def extension(problem: Problem, fit: Fit) -> Extension | None:
    """Return a generic term beside a fit that makes the model predict left-out data better, if there is one."""
    names = _products(*problem.one_step_of(fit))
    if not names:
        return None
    started = {**fit.values, **dict.fromkeys(names, 0.0)}
    extended = problem.fit(started, (*fit.names, *names), fit.noise, renew=0)
    return _accepted(problem, fit, extended, names)


def _products(problem: Problem, fit: Fit) -> tuple[str, ...]:
    """Select the coefficients whose products predict left-out one-step errors beside a fit; return their names."""
    candidates = _candidates(problem)
    values = {**fit.values, **dict.fromkeys(candidates, 0.0)}
    rest, slopes = problem.linear(values, (*fit.names, *candidates), fit.noise)
    chosen = _chosen(_Folds.of(problem.folds, rest, slopes), len(fit.names), len(candidates))
    return tuple(candidates[index - len(fit.names)] for index in chosen)


def _accepted(problem: Problem, before: Fit, after: Fit, names: tuple[str, ...]) -> Extension | None:
    """Return the extension if data that it was not fitted to improve, in one step ahead and in free runs."""
    every = range(len(after.names))
    own = [index for index, name in enumerate(after.names) if name not in names]
    left_out = [
        _Folds.of(problem.folds, fit.rest, fit.slopes).left_out(s) for fit, s in ((before, own), (after, every))
    ]
    held_out = 0.5 * (left_out[0] - left_out[1])
    if held_out < 0.5 * LEAST:
        return None
    segments = [predictor.segment for predictor in problem.predictors]
    gain = measure(problem, before, after, {}, segments, []).gain
    return Extension(names, after, held_out, gain) if improves(gain) else None


def formula(values: Mapping[str, float]) -> str:
    """Describe a term in words: its coefficients and their factors."""
    *others, last = (_product(definition(name), value) for name, value in values.items())
    return f"{', '.join(others)} and {last}" if others else last


def _product(known: ParameterDefinition, value: float) -> str:
    unit = "" if known.unit == "-" else f" {known.unit}"
    return f"{value:.3g}{unit} times {known.meaning.removeprefix('coefficient of ')}"


def improves(gain: Gain) -> bool:
    """Return whether free runs improve on left-out data: at least one signal clearly, and none gets worse.

    For the path, the interval must confirm it.
    """
    sure = gain.interval[0] > 1.0
    clear = [ratio for name, ratio in gain.signals.items() if ratio > LEAST_GAIN and (sure or name != "pose")]
    return bool(clear) and min(gain.signals.values()) > LARGEST_LOSS


def _candidates(problem: Problem) -> tuple[str, ...]:
    """Return the names of all coefficients; those of the motors only where wheel speeds are predicted."""
    given = any(len(predictor.segment.observations.given) for predictor in problem.predictors)
    effects = (BODY,) if given else GENERIC_TERMS.values()
    return tuple(parameter.name for effect in effects for parameter in effect.parameters)


@dataclass(frozen=True)
class _Folds:
    """Normal equations of a linear fit by folds: `normal` (folds, p, p), `right` (folds, p), `squares` (folds,)."""

    normal: Floats
    right: Floats
    squares: Floats

    @classmethod
    def of(cls, folds: np.typing.NDArray[np.int64], rest: Floats, slopes: Floats) -> "_Folds":
        """Return the equations of white errors (n,) with these slopes (n, p)."""
        inside = [folds == fold for fold in np.unique(folds)]
        return cls(
            np.stack([slopes[rows].T @ slopes[rows] for rows in inside]),
            np.stack([slopes[rows].T @ rest[rows] for rows in inside]),
            np.array([rest[rows] @ rest[rows] for rows in inside]),
        )

    def left_out(self, chosen: Sequence[int]) -> float:
        """Return the sum of squares of all folds, each predicted by a fit of the chosen parameters to the others."""
        normal, right = self.normal[np.ix_(range(len(self.squares)), chosen, chosen)], self.right[:, chosen]
        total = 0.0
        for fold, square in enumerate(self.squares):
            own, pull = normal[fold], right[fold]
            step = -np.linalg.lstsq(normal.sum(axis=0) - own, right.sum(axis=0) - pull, rcond=1e-10)[0]
            total += float(square + 2.0 * step @ pull + step @ own @ step)
        return total


def _chosen(folds: _Folds, free: int, candidates: int) -> list[int]:
    """Return the numbers of the parameters whose products predict left-out folds, beside the first `free` ones."""
    own = list(range(free))
    before = folds.left_out(own)
    chosen: list[int] = []
    least = before
    while len(chosen) < MOST_PRODUCTS:
        others = [index for index in range(free, free + candidates) if index not in chosen]
        squares = {index: folds.left_out([*own, *chosen, index]) for index in others}
        best = min(squares, key=lambda index: squares[index])
        if least - squares[best] < max(LEAST, LEAST_SHARE * (before - squares[best])):
            break
        chosen.append(best)
        least = squares[best]
    for index in list(chosen):
        without = folds.left_out([*own, *(other for other in chosen if other != index)])
        if without - least < max(LEAST, LEAST_SHARE * (before - least)):
            chosen.remove(index)
            least = without
    return chosen

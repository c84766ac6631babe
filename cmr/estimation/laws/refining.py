"""Fit laws together with a model's parameters and the noise, to first order, and relinearise.

With the errors e, the slopes E of the model's parameters and the traces G of the laws, all in the units of the signals,
and a whitening filter W of the noise,

    minimise  sum rho(W (e + E d - G c))    over steps d (p,) and coefficients c (k,)

where rho is Huber's loss. The noise is then estimated again from e + E d - G c, without what the laws explain.
`quality` is -2 log likelihood up to a constant: the sum of rho plus 2 ln of the noise's sizes.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import combinations

import numpy as np

from cmr.estimation.gauss_newton import moved
from cmr.estimation.laws.candidates import Candidate
from cmr.estimation.laws.linearised import Linearised, mixed
from cmr.estimation.laws.rest import Rest, jerks, signals_of, times_of
from cmr.estimation.laws.scan import penalty, scan
from cmr.estimation.noise import Noise
from cmr.estimation.prediction import Errors
from cmr.estimation.problem import LARGE, Problem
from cmr.recordings.signal import Floats, Mask

RENEWED = 2  # re-estimations of the noise
STEPS = 3  # towards the minimum of Huber's loss
RIDGE = 1e-10  # of a column's square: keeps collinear columns solvable
ROUNDS = 16  # of a search for inner constants, at most
WIDEST, NARROWEST = 4.0, 0.015  # of its steps, first and last, as shares of the reach of each constant,
NARROWER = 0.25  # factor by which they shrink if none is better
SHARES_OF_STEP = (1.0, 0.5, 0.25)  # tested in either direction,
STRETCH, FURTHEST = 2.0, 64.0  # or a factor, for a constant without a reach; and its largest total change


@dataclass(frozen=True, eq=False)
class Refined:
    """A model fitted with laws: its `values`, the laws with their `coefficients`, and the remaining noise.

    `model` is the linearisation, `white` (n,) are its whitened errors, `columns` (n, p + k) the white slopes of
    parameters and traces of laws, `mask` (n,) selects the fitted errors. `sizes` (n,) are those of the noise.
    """

    model: Linearised
    values: Mapping[str, float]
    laws: tuple[Candidate, ...]
    coefficients: tuple[tuple[float, ...], ...]
    noise: Noise
    white: Floats
    columns: Floats
    mask: Mask
    sizes: Floats

    def quality(self, rows: Mask | None = None) -> float:
        """Return -2 log likelihood, up to a constant, over the fitted rows or over others."""
        counted = self.mask if rows is None else rows
        return float(np.sum(loss(self.white[counted]) + 2.0 * np.log(self.sizes[counted])))

    @cached_property
    def rest(self) -> Rest:
        """The residuals of the model with its laws, orthogonal to the traces of laws and parameters."""
        return self._left(self.columns, np.clip(self.white, -LARGE, LARGE))

    def of_law(self, number: int) -> slice:
        """Return the columns with the traces of one law."""
        first = len(self.model.names) + sum(len(one) for one in self.coefficients[:number])
        return slice(first, first + len(self.coefficients[number]))

    def rest_without(self, number: int) -> Rest:
        """Return the residuals without one law, with everything else, including the noise, unchanged."""
        own = self.of_law(number)
        white = np.clip(self.white, -LARGE, LARGE) - self.columns[:, own] @ np.array(self.coefficients[number])
        return self._left(np.delete(self.columns, own, axis=1), white)

    def _left(self, columns: Floats, white: Floats) -> Rest:
        """Return white errors (n,) after projecting out these columns (n, k)."""
        mask = self.mask.astype(np.float64)
        basis = np.linalg.qr(columns * mask[:, None])[0]
        white = white * mask
        white -= basis @ (basis.T @ white)
        return Rest(white, basis, mask, signals_of(self.model), times_of(self.model), self.noise)


def loss(white: Floats) -> Floats:
    """Return Huber's loss of white errors, twice as usual: their squares where they are small."""
    size = np.abs(white)
    return np.where(size > LARGE, LARGE * (2.0 * size - LARGE), size * size)


def refined(
    model: Linearised,
    laws: Sequence[Candidate],
    counted: Mask | None = None,
    fixed: Sequence[Sequence[float]] | None = None,
) -> Refined | None:
    """Fit laws with a model's parameters to the errors that are `counted` (n,), by default all.

    With `fixed` coefficients only the noise is estimated. Returns None if the data do not determine the parameters.
    """
    stacked = _stacked(model, laws)
    step = np.zeros(next(iter(stacked[0].of.values())).shape[1] - 1)
    renewed = RENEWED if fixed is None else 0
    if fixed is not None:
        step[len(model.names) :] = [one for own in fixed for one in own]
    mask = np.ones(model.problem.batch.rows, np.bool_) if counted is None else counted
    noise = model.noise if fixed is None else model.problem.found(_combined(stacked, step))
    columns = errors = np.empty(0)
    for number in range(renewed + 1):
        white = model.problem.made_white(stacked, noise)
        calm = ~jerks(model, noise)
        columns, errors = white[:, 1:] * calm[:, None], white[:, 0] * calm
        step = step if fixed is not None else _fitted(columns, errors, mask, step)
        if not np.all(np.isfinite(step)):
            return None
        noise = model.problem.found(_combined(stacked, step)) if number < renewed else noise
    return Refined(
        model,
        moved(model.values, model.names, step[: len(model.names)]),
        tuple(laws),
        _by_law(laws, step[len(model.names) :]),
        noise,
        errors + columns @ step,
        columns,
        mask,
        _sizes(model, noise),
    )


def _by_law(laws: Sequence[Candidate], coefficients: Floats) -> tuple[tuple[float, ...], ...]:
    ends = np.cumsum([len(law.formulas) for law in laws])
    return tuple(tuple(part.tolist()) for part in np.split(coefficients, ends[:-1])) if laws else ()


def refined_twice(
    problem: Problem, names: Sequence[str], first: Refined, counted: Mask | None = None
) -> Refined | None:
    """Fit the laws of a model again, relinearised about the values found with them."""
    return refined(Linearised.about(problem, first.values, names), first.laws, counted)


def with_best_constants(model: Linearised, law: Candidate, rest: Rest) -> Candidate:
    """Optimise the inner constants of a law for the residuals, by pattern search.

    Steps change one or two constants in either direction, from their whole reach down to a small share of it, so even a
    poor initial constant reaches the optimum.
    """
    best = _gained(model, rest, [law], law)[1] if law.constants else 0.0
    width, first = WIDEST, law
    with model.only_tried():
        for _ in range(ROUNDS if law.constants else 0):
            better, gain = _gained(model, rest, [one for one in around(law, width) if _within(one, first)], law)
            if gain > best:
                law, best = better, gain
            else:
                width *= NARROWER
            if width < NARROWEST:
                break
    return law


def _within(law: Candidate, first: Candidate) -> bool:
    """Return whether all constants are within the allowed distance of their initial values, and radii are positive."""
    if law.constants.get("radius", 1.0) <= 0.0:
        return False
    pairs = [(value, first.constants[name]) for name, value in law.constants.items() if name not in law.reach]
    return all(1.0 / FURTHEST < value / before < FURTHEST for value, before in pairs)


def _gained(model: Linearised, rest: Rest, laws: Sequence[Candidate], first: Candidate) -> tuple[Candidate, float]:
    """Return the best of several laws of one size, and its gain; `first` if none has any effect."""
    found = scan(model, rest, laws) if laws else []
    return (found[0].candidate, found[0].gain) if found else (first, -math.inf)


def around(law: Candidate, width: float) -> list[Candidate]:
    """Return laws with neighbouring constants, at steps of `width` times the reach of each."""
    names = [*law.constants]
    single = [{name: sign * share * width} for name in names for sign in (-1.0, 1.0) for share in SHARES_OF_STEP]
    pairs = [{a: i * width, b: j * width} for a, b in combinations(names, 2) for i in (-1.0, 1.0) for j in (-1.0, 1.0)]
    return [_moved_by(law, steps) for steps in (*single, *pairs)]


def _moved_by(law: Candidate, steps: Mapping[str, float]) -> Candidate:
    """Return a law with constants moved by these steps, in units of their reach, or as powers of a factor."""
    moved_to = dict(law.constants)
    for name, step in steps.items():
        reach = law.reach.get(name)
        moved_to[name] = moved_to[name] + reach * step if reach is not None else moved_to[name] * STRETCH**step
    return law.with_constants(moved_to)


def _fitted(columns: Floats, errors: Floats, mask: Mask, start: Floats) -> Floats:
    """Return the step (m,) that minimises Huber's loss of white errors (n,)."""
    step = start.copy()
    inside = columns[mask]
    normal = inside.T @ inside
    scale = np.sqrt(np.maximum(np.diag(normal), 1e-300))
    scaled = normal / np.outer(scale, scale) + RIDGE * np.eye(len(scale))
    for _ in range(STEPS if len(step) else 0):
        left = np.clip(errors + columns @ step, -LARGE, LARGE)[mask]
        step = step - np.linalg.solve(scaled, (inside.T @ left) / scale) / scale
    return step


def _stacked(model: Linearised, laws: Sequence[Candidate]) -> list[Errors]:
    """Return errors, slopes and the traces of laws, with the opposite sign, in each segment, side by side."""
    result = []
    raw = [model.raw([law]) for law in laws]
    for number, (error, slope) in enumerate(zip(model.errors, model.slopes, strict=True)):
        of = {}
        for name, own in error.of.items():
            of_laws = [-mixed(law, one[number].of[name]) for law, one in zip(laws, raw, strict=True)]
            of[name] = np.concatenate([own, slope.of[name], *of_laws], axis=1)
        result.append(replace(error, of=of))
    return result


def _combined(stacked: Sequence[Errors], step: Floats) -> list[Errors]:
    """Return the errors (n, 1) after a step."""
    weights = np.append(1.0, step)[:, None]
    return [replace(one, of={name: of @ weights for name, of in one.of.items()}) for one in stacked]


def _sizes(model: Linearised, noise: Noise) -> Floats:
    """Return the sizes of the noise of all white errors, (n,)."""
    return np.concatenate(
        [noise.of[name].sizes[number] for number, one in enumerate(model.problem.predictors) for name in one.times]
    )


def score_of(before: Refined, after: Refined, inflation: float = 1.0) -> float:
    """Return the improvement by additional laws, minus the expected chance gain of a search of this size."""
    samples = int(np.count_nonzero(after.mask))
    more = sum(penalty(law, samples) for law in after.laws) - sum(penalty(law, samples) for law in before.laws)
    return (before.quality() - after.quality()) / inflation - more

"""Lack-of-fit test of a law: are its coefficients constant along its own variables?

The range of each variable is divided into bins with equal numbers of samples. In each bin the law gets a factor of its
own. If the formula is right, the reduction of the sum of squares by these factors, beyond a common factor, is
chi-squared (lack of fit; N. R. Draper, H. Smith, Applied Regression Analysis, 3rd ed., 1998, section 2.1).
"""

import math

import numpy as np

from cmr.estimation.laws.candidates import Candidate
from cmr.estimation.laws.linearised import SIDES, is_of_wheels
from cmr.estimation.laws.refining import Refined
from cmr.estimation.laws.scan import LEAST_OWN, NOTHING
from cmr.model.laws.grammar import parse
from cmr.recordings.signal import Floats

BINS = 6  # of a variable, each with equally many moments
ALIKE = 0.02  # of the largest: directions that the model's parameters or other factors nearly reproduce do not count
SURELY = 5.0  # standard deviations above the mean of chi-squared that indicate a misfit


def misfit_of(fit: Refined) -> float:
    """Return how much more factors along the laws' variables explain than chance; negative if no more."""
    beyond = [_beyond(fit, number, name) for number, law in enumerate(fit.laws) for name in variables_of_law(law)]
    return max(beyond, default=-math.inf)


def variables_of_law(law: Candidate) -> tuple[str, ...]:
    """Return the variables of a law's formulas, in the order of the alphabet."""
    return tuple(sorted({name for text in law.formulas for name in parse(text, tuple(law.constants)).variables}))


def _beyond(fit: Refined, number: int, variable: str) -> float:
    """Return the gain of factors along one variable of a law, minus the largest gain by chance."""
    rest = fit.rest
    traces = _traces(fit, number, variable) * rest.mask[:, None]
    free = traces - rest.basis @ (rest.basis.T @ traces)
    own = np.sum(free**2, axis=0) > LEAST_OWN * np.maximum(np.sum(traces**2, axis=0), NOTHING)
    if not np.any(own):
        return -math.inf
    kept = free[:, own]
    u, sizes, _ = np.linalg.svd(kept / np.linalg.norm(kept, axis=0), full_matrices=False)
    u = u[:, sizes > ALIKE * sizes[0]]
    freedom = int(u.shape[1])
    return float(np.sum((u.T @ rest.white) ** 2)) - freedom - SURELY * math.sqrt(2.0 * freedom)


def _traces(fit: Refined, number: int, variable: str) -> Floats:
    """Return the white traces (n, BINS) of a law's contribution in each bin of a variable."""
    model, law = fit.model, fit.laws[number]
    segments = range(len(model.problem.predictors))
    sides = (0, 1) if is_of_wheels(law.place) else (-1,)
    values = [[model.course(k, side, (variable,), law.constants) for side in sides] for k in segments]
    edges = np.quantile(np.concatenate([of for own in values for of in own]), np.linspace(0.0, 1.0, BINS + 1)[1:-1])
    forces = []
    for k in segments:
        adds = [_added(fit, number, k, side) for side in sides]
        inside = [np.searchsorted(edges, of) for of in values[k]]
        forces.append([add * (at == bin_) for bin_ in range(BINS) for add, at in zip(adds, inside, strict=True)])
    traces = model.white_traces_of(law.place, forces, fit.noise)
    share = SIDES[law.side] if is_of_wheels(law.place) else np.ones(1)
    return np.asarray(traces.reshape(len(traces), BINS, len(share)) @ share)


def _added(fit: Refined, number: int, segment: int, side: int) -> Floats:
    """Return a law's contribution at its place along a segment."""
    law, coefficients = fit.laws[number], fit.coefficients[number]
    parts = [fit.model.course(segment, side, factors, law.constants) for factors in law.all_factors]
    return np.asarray(sum(c * part for c, part in zip(coefficients, parts, strict=True)), np.float64)

"""Data for the plot of a law: the residual at the law's place against the law's own variable.

The variable is divided into bins. In each bin, a force at the law's place is fitted to the white errors of the model
without and with the law, so both are in the unit of the place, whichever sensors measured them.
"""

import math
from collections.abc import Sequence

import numpy as np

from cmr.estimation.laws.candidates import Candidate
from cmr.estimation.laws.linearised import SIDES, Linearised, is_of_wheels
from cmr.estimation.laws.refining import Refined
from cmr.estimation.laws.result import Course, Curve
from cmr.estimation.problem import LARGE
from cmr.model.laws.law import Law
from cmr.model.laws.words import VARIABLES
from cmr.recordings.signal import Floats, Mask

BINS = 13  # of a law's variable, in the report's figure
EDGE = 0.01  # quantile of the variable beyond which a bin is open
FEWEST = 50  # sum of squared white errors required of a bin's trace
RIDGE = 1e-6  # of the variance: keeps nearly identical bins solvable


def curve_of(fit: Refined, number: int, law: Law, tried: Refined | None, rows: Mask | None) -> Curve:
    """Return the curve of one law of a fit, on the fitted data and on the test data.

    The test data are another fit with the same coefficients, other rows of the same errors, or None.
    """
    candidate = fit.laws[number]
    variable = next((name for formula in law.parsed for name in formula.variables), "t")
    edges = _edges(fit.model, candidate, variable)
    held_out = None
    if tried is not None:
        held_out = _course(tried, number, variable, edges, tried.mask)
    elif rows is not None:
        held_out = _course(fit, number, variable, edges, rows)
    return Curve(
        law=law.name,
        variable=variable,
        unit=VARIABLES[variable].unit,
        place_unit=law.at.unit,
        training=_course(fit, number, variable, edges, fit.mask),
        held_out=held_out,
    )


def _sides(candidate: Candidate) -> Sequence[int]:
    return (0, 1) if is_of_wheels(candidate.place) else (-1,)


def _along(model: Linearised, candidate: Candidate, factors: Sequence[str]) -> list[list[Floats]]:
    """Return a product of factors in each segment, on each side."""
    segments = range(len(model.problem.predictors))
    return [[model.course(k, side, factors, candidate.constants) for side in _sides(candidate)] for k in segments]


def _edges(model: Linearised, candidate: Candidate, variable: str) -> Floats:
    values = np.concatenate([of for own in _along(model, candidate, (variable,)) for of in own])
    low, high = np.quantile(values, (EDGE, 1.0 - EDGE))
    return np.linspace(low, max(high, low + 1e-9), BINS + 1)


def _course(fit: Refined, number: int, variable: str, edges: Floats, rows: Mask) -> Course:
    model, candidate = fit.model, fit.laws[number]
    sign = SIDES[candidate.side] if is_of_wheels(candidate.place) else np.ones(1)
    values = _along(model, candidate, (variable,))
    where = [[np.clip(np.searchsorted(edges, of) - 1, 0, BINS - 1) for of in own] for own in values]
    forces = [[(of == k).astype(np.float64) for k in range(BINS) for of in own] for own in where]
    columns = model.white_traces_of(candidate.place, forces, fit.noise)
    columns = columns.reshape(len(columns), BINS, len(sign)) @ sign
    columns = columns[rows]
    left = np.clip(fit.white, -LARGE, LARGE)[rows]
    lacking = left - fit.columns[rows][:, fit.of_law(number)] @ np.array(fit.coefficients[number])
    after, std = _fitted(columns, left)
    before, _ = _fitted(columns, lacking)
    said = _said(fit, number)
    counts = np.array([sum(int(np.sum(of == k)) for own in where for of in own) for k in range(BINS)])
    law = np.array([_mean(said, where, k) for k in range(BINS)])
    return Course(at=0.5 * (edges[1:] + edges[:-1]), count=counts, before=before, after=after, std=std, law=law)


def _fitted(columns: Floats, left: Floats) -> tuple[Floats, Floats]:
    """Return the least-squares forces in the bins and their standard deviations; NaN in empty bins."""
    normal = columns.T @ columns
    shown = np.diag(normal) > FEWEST
    forces, std = np.full(BINS, math.nan), np.full(BINS, math.nan)
    if np.any(shown):
        inner = normal[np.ix_(shown, shown)]
        inverse = np.linalg.inv(inner + RIDGE * np.diag(np.diag(inner)))
        forces[shown] = inverse @ (columns[:, shown].T @ left)
        std[shown] = np.sqrt(np.diag(inverse))
    return forces, std


def _said(fit: Refined, number: int) -> list[list[Floats]]:
    """Return the values of a law at its place, in each segment and on each side."""
    candidate = fit.laws[number]
    parts = [_along(fit.model, candidate, factors) for factors in candidate.all_factors]
    coefficients = fit.coefficients[number]
    return [
        [
            np.asarray(sum(c * part[k][side] for c, part in zip(coefficients, parts, strict=True)), np.float64)
            for side in range(len(parts[0][k]))
        ]
        for k in range(len(parts[0]))
    ]


def _mean(said: list[list[Floats]], where: "list[list[np.typing.NDArray[np.int64]]]", k: int) -> float:
    pairs = (pair for own, places in zip(said, where, strict=True) for pair in zip(own, places, strict=True))
    inside = np.concatenate([of[at == k] for of, at in pairs])
    return float(np.mean(inside)) if len(inside) else math.nan

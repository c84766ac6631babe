"""Refine the position of a place, because slopes hardly depend on a border that is seldom crossed.

Where a path crosses a disc once, larger discs farther off explain it as well: the minimum lies in a long, narrow,
curved valley. A population of walkers, whose steps are differences of each other's positions, finds its minimum and
length (differential evolution Markov chain; ter Braak, Statistics and Computing 16, 2006).
"""

from collections.abc import Mapping, Sequence
from itertools import product

import numpy as np

from cmr.estimation.gauss_newton import Fit, moved
from cmr.estimation.noise import Noise
from cmr.estimation.problem import Problem
from cmr.model.catalogue import definition
from cmr.model.effect import Effect
from cmr.recordings.signal import Floats

REACHES = (0.2, 0.1, 0.04)  # m; distances at which places around the best one are tested, decreasing
SIDES = (-1.0, -0.5, 0.0, 0.5, 1.0)  # shares of the reach by which the centre is moved, either way
RADII = (-0.6, 0.0, 0.6)  # shares of the reach by which the radius is changed
SMALLEST = 0.05  # m; no place has a smaller radius
WALKERS, STEPS, SETTLING = 16, 60, 25  # walkers, which fill one batch of the compiled model; steps; burn-in
ASIDE, SHARE_ASIDE = 0.03, 0.05  # initial spread of walkers: m for places, share for other parameters
JITTER = 1e-3  # of that, added to each step
JUMPS = 10  # every n-th step has the full length of a difference, to jump between valleys
WARMTH = 2.0  # temperature, since the noise is not exactly as assumed


def placed(problem: Problem, effect: Effect, values: Mapping[str, float], noise: Noise) -> Mapping[str, float]:
    """Return the start values of a fit with an effect: with its best place, if it has one."""
    if effect.locality != "place":
        return values
    best = dict(values)
    x, y, radius = (effect.parameter_of(kind) for kind in ("x", "y", "radius"))
    for reach in REACHES:
        tested = [best]
        for east, north, larger in product(SIDES, SIDES, RADII):
            place = {x: best[x] + east * reach, y: best[y] + north * reach}
            tested.append({**best, **place, radius: max(best[radius] + larger * reach, SMALLEST)})
        squares = problem.squares(tested, noise)
        best = tested[int(np.argmin(squares))]
    return best


def explored(problem: Problem, fit: Fit, names: Sequence[str]) -> tuple[Fit, dict[str, float]]:
    """Return the best fit near a fit, and the standard deviations of parameters `names` around it, from the walkers."""
    chance = np.random.default_rng(0)
    aside = np.array([ASIDE if definition(n).unit == "m" else SHARE_ASIDE * abs(fit.values[n]) for n in names])
    at = np.zeros((WALKERS, len(names)))
    at[1:] = aside * chance.normal(size=(WALKERS - 1, len(names)))
    squares = _squares(problem, fit, names, at)
    visited, heights = [at.copy()], [squares]
    for step in range(STEPS):
        tested = at + _strides(at, step, chance) + JITTER * aside * chance.normal(size=at.shape)
        there = _squares(problem, fit, names, tested)
        goes = np.log(chance.uniform(size=WALKERS)) < (squares - there) / (2.0 * WARMTH)
        at, squares = np.where(goes[:, None], tested, at), np.where(goes, there, squares)
        visited.append(at.copy())
        heights.append(squares)
    lowest = np.concatenate(visited)[int(np.argmin(np.concatenate(heights)))]
    best = problem.refitted(fit, [moved(fit.values, names, lowest)])[0]
    best = best if best.squares < fit.squares else fit
    found = np.array([best.values[name] - fit.values[name] for name in names])
    away = np.sqrt(np.mean((np.concatenate(visited[SETTLING:]) - found) ** 2, axis=0))
    return best, dict(zip(names, map(float, away), strict=True))


def _squares(problem: Problem, fit: Fit, names: Sequence[str], at: Floats) -> Floats:
    return problem.squares([moved(fit.values, names, step) for step in at], fit.noise)


def _strides(at: Floats, step: int, chance: np.random.Generator) -> Floats:
    """Return for each walker the difference of two others, scaled as is optimal for a quadratic."""
    pairs = np.array([chance.choice(np.delete(np.arange(len(at)), own), 2, replace=False) for own in range(len(at))])
    length = 1.0 if step % JUMPS == JUMPS - 1 else 2.38 / np.sqrt(2.0 * at.shape[1])
    return np.asarray(length * (at[pairs[:, 0]] - at[pairs[:, 1]]))

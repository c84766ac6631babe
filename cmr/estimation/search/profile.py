"""Profile the likelihood around a fit: search for better values farther away, and measure its roughness.

With stick-slip, a slightly different friction lets a wheel start a little earlier, or not at all, so the sum of squares
has steps. Slopes miss them; a scan does not. The uncertainty due to the steps is added to the standard deviations.
"""

import numpy as np

from cmr.estimation.candidates import is_rough
from cmr.estimation.gauss_newton import Fit, moved
from cmr.estimation.problem import Problem
from cmr.estimation.search.placement import explored
from cmr.model.catalogue import definition
from cmr.model.effect import Effect
from cmr.recordings.signal import Floats

POINTS, FEWEST_POINTS = 16, 6  # of a scan, in one batch of the compiled model; of valid ones among them
FARTHEST = 0.12  # of the value,
FARTHEST_OF = {"m": 0.25, "s": 1.0, "rad": 0.4}  # of places, times and angles
FEWEST_STDS = 4.0  # or so many standard deviations, if that is more
BEYOND = 1e4  # values this many times above the lower quarter of a scan count as invalid
ROUGH = 10.0  # scatter of the sum of squares about a parabola that counts as rough
LOWER = 1.0  # drop below the fit's sum of squares that is worth following
STARTS = 2  # number of new fits if the sum is rough
MOMENTS, MOMENT_STEP, MOMENTS_APART = 128, 0.125, 0.6  # of the scan over start times; s between them; s
LIKELY = 4.0  # above the least: within 95 % limits
NEAR = 0.25  # of the scan's reach: least distance between starts


def made_sure(problem: Problem, fit: Fit, effect: Effect) -> tuple[Fit, dict[str, float]]:
    """Return the best fit near a fit, and the additional standard deviations of an effect's parameters."""
    names, extra_stds = [parameter.name for parameter in effect.parameters], {}
    if effect.locality == "place":
        return explored(problem, fit, names)
    for name in names if is_rough(effect) else ():
        left_open = 0.0
        if definition(name).kind == "time":
            fit, left_open = _at_the_best_moment(problem, fit, name)
        offsets, squares = scan(problem, fit, name)
        _, scatter = parabola(offsets, squares)
        if scatter > ROUGH or np.min(squares) < fit.squares - LOWER:
            better = min(problem.refitted(fit, _starts(fit, name, offsets, squares)), key=_squares)
            fit = min(fit, better, key=_squares)
            offsets, squares = scan(problem, fit, name)
        extra_stds[name] = max(parabola(offsets, squares)[0], left_open)
    return fit, extra_stds


def _at_the_best_moment(problem: Problem, fit: Fit, name: str) -> tuple[Fit, float]:
    """Return the best fit near a fit with an effect that begins earlier or later, and the remaining uncertainty [s].

    Only a few steps around the true time determine it, so slopes elsewhere do not lead there. While a robot rests or
    drives steadily, start times may be indistinguishable.
    """
    offsets = np.linspace(-0.5, 0.5, MOMENTS + 1) * MOMENTS * MOMENT_STEP
    moments = [moved(fit.values, [name], offsets[index : index + 1]) for index in range(len(offsets))]
    squares = problem.squares(moments, fit.noise)
    found = problem.refitted(fit, [moments[index] for index in _apart(offsets, squares, MOMENTS_APART)])
    best = min(found, key=_squares)
    best = best if best.squares < fit.squares - LOWER else fit
    alike = np.array([one[name] for one in moments])[squares < np.min(squares) + LIKELY]
    return best, float(np.sqrt(np.mean((alike - best.values[name]) ** 2)))


def _squares(fit: Fit) -> float:
    return fit.squares


def scan(problem: Problem, fit: Fit, name: str) -> tuple[Floats, Floats]:
    """Return offsets of a parameter from the fit's value, and the sums of squares there, (POINTS,) each.

    The other parameters follow along the valley.
    """
    value, std = fit.values[name], fit.std(name)
    known = definition(name)
    farthest = FARTHEST * abs(value) if known.switches else FARTHEST_OF.get(known.unit, FARTHEST)
    reach = max(farthest, FEWEST_STDS * std)
    offsets = np.linspace(-reach, reach, POINTS)
    return offsets, problem.squares([along(fit, name, offset) for offset in offsets], fit.noise)


def along(fit: Fit, name: str, offset: float) -> dict[str, float]:
    """Return the values when one parameter is moved and the others follow, to first order."""
    covariance = fit.covariance
    index = fit.names.index(name)
    with np.errstate(invalid="ignore"):  # undetermined parameters have no direction to follow: the models are invalid
        return moved(fit.values, fit.names, covariance[:, index] / covariance[index, index] * offset)


def parabola(offsets: Floats, squares: Floats) -> tuple[float, float]:
    """Return the standard deviation of the minimum of a parabola through the sums of squares, and their scatter."""
    unit = float(np.max(np.abs(offsets)))
    lowest = np.min(squares)
    if not np.isfinite(lowest):  # the model is invalid along the whole scan
        return unit, np.inf
    higher = squares - lowest
    holds = higher <= BEYOND * np.quantile(higher, 0.25)
    if np.count_nonzero(holds) < FEWEST_POINTS:
        return unit, np.inf
    x, squares = offsets[holds] / unit, squares[holds]
    design = np.stack([np.ones(len(x)), x, x**2], axis=1)
    weights, *_ = np.linalg.lstsq(design, squares, rcond=None)
    scatter = float(np.sqrt(np.sum((squares - design @ weights) ** 2) / (len(x) - 3)))
    if weights[2] <= 0.0:
        return unit, scatter
    covariance = scatter**2 * np.linalg.inv(design.T @ design)
    slope = np.array([0.0, -0.5 / weights[2], 0.5 * weights[1] / weights[2] ** 2])
    return float(unit * np.sqrt(slope @ covariance @ slope)), scatter


def _starts(fit: Fit, name: str, offsets: Floats, squares: Floats) -> list[dict[str, float]]:
    """Return the best values of a scan that lie apart from each other."""
    return [along(fit, name, float(offsets[index])) for index in _apart(offsets, squares, NEAR * float(offsets[-1]))]


def _apart(offsets: Floats, squares: Floats, distance: float) -> list[int]:
    """Return the indices of the STARTS best points of a scan that lie farther apart than this."""
    chosen: list[int] = []
    for index in np.argsort(squares):
        if all(abs(offsets[index] - offsets[other]) > distance for other in chosen):
            chosen.append(int(index))
    return chosen[:STARTS]

"""Commands that come late each by another time, or not at all: seen in the spread of what follows a change.

Each command that changes the duty leaves a trace in the wheels' prediction errors if it takes effect late; its size is
the delay. The delays of all commands are unknowns with a common mean and spread, and what remains is white noise: a
linear model with random effects (Laird and Ware, Biometrics 38, 1982), whose likelihood needs one banded matrix.
A fixed delay has no spread; uniform jitter has a spread of its mean over root three; a lost command comes one
period late.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from cmr.estimation.gauss_newton import Fit
from cmr.estimation.noise import Noise
from cmr.estimation.prediction import Errors, Predictor
from cmr.estimation.problem import Problem
from cmr.recordings.signal import Floats

REACH = 0.5  # s after which a command's delay has left no trace
LEAST_CHANGE = 1e-3  # duty
SIZES = np.geomspace(2e-3, 0.2, 25)  # s of jitter that are tested
LOSSES = np.geomspace(2e-3, 0.4, 25)  # probabilities of a loss that are tested
FINE = 1e-3  # share of the value to which the best one is found
SIDES = ("psi_left", "psi_right")
TOLD = 40.0  # squared white errors that a lost command makes from which it is told by itself
FEWEST_LOST = 3
AGES = 200  # at which the age of the command in force is reckoned
MOST_OVERTAKEN = 100.0  # times the seeming delay: no jitter is larger
JITTER, LOSS = "command_jitter", "command_loss"


@dataclass(frozen=True)
class Spread:
    """An effect of chance on the commands: its parameter's value and std, and by how much it drops -2 log-likelihood.

    `delays` [s] are those of each segment's commands, as far as they show; `drop_at` tells the drop at another value.
    `weights` (n,) tell how much each command counts.
    """

    value: float
    std: float
    drop: float
    delays: tuple[Floats, ...]
    drop_at: Callable[[float], float]
    weights: Floats


@dataclass(frozen=True)
class _Traces:
    """What delays leave: normal matrix, upper banded (bands, n), right side (n,), first command of each segment."""

    banded: Floats
    right: Floats
    splits: tuple[int, ...]

    def likelihood(self, mean: float, variance: float) -> float:
        """Return twice the log-likelihood of delays of this mean [s] and variance, over that of none."""
        total = _times(self.banded, np.full(len(self.right), mean))
        fixed = float(2.0 * self.right @ np.full(len(self.right), mean) - mean * total.sum())
        if variance <= 0.0:
            return fixed
        factor, solved = self._solved(self.right - total, variance)
        gained = float((self.right - total) @ solved)
        return fixed + gained - 2.0 * float(np.sum(np.log(factor[-1]))) - len(self.right) * float(np.log(variance))

    def delays(self, mean: float, variance: float) -> Floats:
        """Return the most likely delay [s] of each command."""
        return mean + self._solved(self.right - _times(self.banded, np.full(len(self.right), mean)), variance)[1]

    def _solved(self, right: Floats, variance: float) -> tuple[Floats, Floats]:
        from scipy.linalg import cho_solve_banded, cholesky_banded

        damped = self.banded.copy()
        damped[-1] += 1.0 / variance
        factor = cholesky_banded(damped)
        return factor, cho_solve_banded((factor, False), right)


def spread_of(name: str, problem: Problem, fit: Fit) -> Spread | None:
    """Return what JITTER about the mean delay, or LOSS, would explain beside a fit; None where it cannot be told."""
    segments = [predictor for predictor in problem.predictors if len(predictor.segment.observations.commands.time) > 1]
    if len(segments) != len(problem.predictors) or not any(SIDES[0] in predictor.times for predictor in segments):
        return None
    traces = _traces(problem, fit, problem.errors(fit.values))
    if name == JITTER:
        return _spread(traces, SIZES, lambda size: (0.0, size**2 / 12.0))
    period = period_of(problem)
    return _spread(traces, LOSSES, lambda share: loss_of(share, period))


def _spread(traces: _Traces, sizes: Floats, law: Callable[[float], tuple[float, float]]) -> Spread:
    def drop_at(value: float) -> float:
        return traces.likelihood(*law(value))

    value, drop, std = _peak(drop_at, sizes)
    delays = traces.delays(*law(value))
    weights = _times(traces.banded, np.ones(len(traces.right)))
    return Spread(value, std, drop, tuple(np.split(delays, traces.splits[1:-1])), drop_at, weights)


def period_of(problem: Problem) -> float:
    """Return the usual time [s] from one command to the next."""
    return float(np.median(np.concatenate([np.diff(p.segment.observations.commands.time) for p in problem.predictors])))


def share_lost(problem: Problem, spread: Spread) -> tuple[float, float]:
    """Return the share of commands that came one period late, and its standard deviation; (0, 0) if hardly any did.

    Commands count that change enough to tell each by itself. Their delays are drawn towards the mean of all, by as much
    as each is unsure; that is undone.
    """
    period = period_of(problem)
    mean, variance = loss_of(spread.value, period)
    told = spread.weights * period**2 > TOLD
    drawn = spread.weights / (spread.weights + 1.0 / variance)
    delays = mean + (np.concatenate(spread.delays) - mean)[told] / drawn[told]
    number, lost = len(delays), int(np.count_nonzero(delays > 0.5 * period))
    if lost < FEWEST_LOST:
        return 0.0, 0.0
    share = lost / number
    return share, float(np.sqrt(share * (1.0 - share) / number))


def loss_of(share: float, period: float) -> tuple[float, float]:
    """Return mean [s] and variance of the delays when a share of commands comes one `period` [s] late."""
    return share * period, share * (1.0 - share) * period**2


def largest_delay(mean: float, period: float) -> float:
    """Return the largest of evenly spread delays [s] by which commands, one each `period` [s], seem `mean` [s] late.

    Half of the largest, as long as it is shorter than the period; then newer commands overtake older ones.
    """
    from scipy.optimize import brentq

    def missing(largest: float) -> float:
        return _seeming_delay(largest, period) - mean

    return float(brentq(missing, mean, MOST_OVERTAKEN * mean)) if missing(2.0 * mean) < 0.0 else 2.0 * mean


def _seeming_delay(largest: float, period: float) -> float:
    """Return by how much the command in force is older, in the mean, than if none were late: all newer ones are."""
    age = (np.arange(AGES) + 0.5) / AGES * period  # of the newest command; others are whole periods older
    late, older = np.clip(1.0 - age / largest, 0.0, 1.0), 0.0
    while np.any(late > 0.0):
        older += period * float(np.mean(late))
        age = age + period
        late = late * np.clip(1.0 - age / largest, 0.0, 1.0)
    return older


def without_jitter(problem: Problem, spread: Spread, mean: float) -> Problem:
    """Return the problem with commands that take effect when they seem to have; `mean` [s] is their mean delay."""
    return _taken(problem, [np.maximum(mean + delays, 0.0) for delays in spread.delays])


def without_loss(problem: Problem, spread: Spread) -> Problem:
    """Return the problem with the commands that seem lost coming with the next one."""
    period = period_of(problem)
    return _taken(problem, [np.where(delays > 0.5 * period, period, 0.0) for delays in spread.delays])


def _taken(problem: Problem, delays: Sequence[Floats]) -> Problem:
    predictors = []
    for predictor, late in zip(problem.predictors, delays, strict=True):
        time = predictor.segment.observations.commands.time + late
        # A command that comes after a newer one is overtaken.
        predictors.append(Predictor(predictor.segment.with_commands_at(np.minimum.accumulate(time[::-1])[::-1])))
    return Problem(predictors, problem.gains, problem.excitation)


def _traces(problem: Problem, fit: Fit, errors: Sequence[Errors]) -> _Traces:
    from scipy.sparse import csr_matrix

    blocks, splits = [], [0]
    for number, (predictor, error) in enumerate(zip(problem.predictors, errors, strict=True)):
        white = fit.noise.white(number, predictor, error)
        commands = predictor.segment.observations.commands
        packets, changes = commands.time, np.diff(commands.duty, axis=0, prepend=commands.duty[:1])
        normal = csr_matrix((len(packets), len(packets)))
        right = np.zeros(len(packets))
        for side, name in enumerate(SIDES):
            response = _response(fit, problem, fit.noise, name, number, predictor)
            design = _design(packets, -changes[:, side], predictor.times[name], response)
            normal = normal + design.T @ design
            right += design.T @ white[name][:, 0]
        blocks.append((normal, right))
        splits.append(splits[-1] + len(packets))
    bands = max(_bandwidth(normal) for normal, _ in blocks)
    banded = np.concatenate([_banded(normal, bands) for normal, _ in blocks], axis=1)
    return _Traces(banded, np.concatenate([right for _, right in blocks]), tuple(splits))


def _response(
    fit: Fit, problem: Problem, noise: Noise, name: str, number: int, predictor: Predictor
) -> tuple[float, Floats, Floats]:
    """Return the period [s] of a wheel's readings, and what one second of one more duty does to its next white errors.

    The third is the size of the errors, shape (n,), by which the second is still to be divided.
    """
    period = float(np.median(np.diff(predictor.segment.observations.wheel_time)))
    count = int(REACH / period)
    rate = fit.values["k1"] * fit.values["k2_over_k3"]
    kept = np.exp(-rate * period)
    # An impulse of duty at time 0: a jump of the speed. The observer, which knows nothing of it, follows the angle.
    speed, angle, raw = fit.values["k2_over_k3"], 0.0, np.zeros(count)
    for index in range(1, count):
        angle += speed * (1.0 - kept) / rate
        speed *= kept
        raw[index] = angle
        speed -= problem.gains.psi * angle
        angle -= problem.gains.angle * angle
    past, spans = noise.of[name].past, noise.of[name].spans(name)
    borders = np.concatenate([[0], np.cumsum(spans)])
    weights = np.concatenate([[1.0], -np.repeat(past, np.diff(borders))])
    return period, np.convolve(raw, weights)[:count], noise.of[name].sizes[number]


def _design(packets: Floats, changes: Floats, times: Floats, response: tuple[float, Floats, Floats]) -> Any:
    """Return what a second of delay of each command leaves in each white error: sparse, shape (errors, commands)."""
    from scipy.sparse import csr_matrix

    period, trace, sizes = response
    count = len(trace)
    matters = np.flatnonzero(np.abs(changes) > LEAST_CHANGE)
    first = np.searchsorted(times, packets[matters])
    rows = first[:, None] + np.arange(count)[None]
    inside = rows < len(times)
    rows = np.minimum(rows, len(times) - 1)
    lag = times[rows] - packets[matters][:, None]
    inside &= lag < REACH - period
    values = np.interp(lag, np.arange(count) * period, trace) * changes[matters][:, None] / sizes[rows]
    columns = np.broadcast_to(matters[:, None], rows.shape)
    return csr_matrix((values[inside], (rows[inside], columns[inside])), shape=(len(times), len(packets)))


def _bandwidth(normal: Any) -> int:
    matrix = normal.tocoo()
    return int(np.max(matrix.col - matrix.row, initial=0))


def _banded(normal: Any, bands: int) -> Floats:
    """Return a symmetric sparse matrix in the upper banded form of LAPACK."""
    size = normal.shape[0]
    result = np.zeros((bands + 1, size))
    for offset in range(bands + 1):
        result[bands - offset, offset:] = normal.diagonal(offset)
    return result


def _times(banded: Floats, vector: Floats) -> Floats:
    """Return the product of a symmetric matrix in upper banded form with a vector."""
    bands = len(banded) - 1
    result = banded[-1] * vector
    for offset in range(1, bands + 1):
        row = banded[bands - offset, offset:]
        result[:-offset] += row * vector[offset:]
        result[offset:] += row * vector[:-offset]
    return np.asarray(result)


def _peak(function: Callable[[float], float], sizes: Floats) -> tuple[float, float, float]:
    """Return where a likelihood is largest, how large, and the standard deviation that its curvature tells."""
    from scipy.optimize import minimize_scalar

    values = [function(float(size)) for size in sizes]
    best = int(np.argmax(values))
    low, high = np.log(sizes[max(best - 1, 0)]), np.log(sizes[min(best + 1, len(sizes) - 1)])
    found = minimize_scalar(
        lambda x: -function(float(np.exp(x))), bounds=(low, high), method="bounded", options={"xatol": FINE}
    )
    value, step = float(np.exp(found.x)), 0.03
    curvature = (2.0 * -found.fun - function(value * (1 + step)) - function(value * (1 - step))) / (step * value) ** 2
    return value, float(-found.fun), float(np.sqrt(2.0 / curvature)) if curvature > 0.0 else float("inf")

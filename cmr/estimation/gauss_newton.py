"""Fit a model by damped Gauss-Newton, as a generator of evaluation requests.

A fit is a generator: it requests the white errors of several sets of values, and continues once it receives them. So
several fits can run side by side, with their requests evaluated in one batch.
"""

from collections.abc import Collection, Generator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np

from cmr.estimation.candidates import Excitation, step_of
from cmr.estimation.noise import Noise
from cmr.model.catalogue import definition
from cmr.recordings.signal import Floats, Mask

T = TypeVar("T")
Asking = Generator[Sequence[Mapping[str, float]], Floats, T]  # sets of values; their white errors (n, C); the result
Linear = tuple[Floats, Floats]  # white errors (n,) and their slopes (n, p)
MOST_STEPS = 7  # of a fit
SETTLED = 0.1  # of the sum of squares: steps with a smaller predicted reduction are not taken
# Least share of the predicted reduction that must be achieved; and by the best of many shorter steps.
KEPT, LEAST_KEPT = 0.5, 0.05
WORTH_A_DETOUR = 5.0  # of the sum of squares: if a smaller predicted reduction fails, the sum is merely rough
DAMPINGS, SHARES = (1e-9, 1e-3, 3e-2, 0.5), (1.0, 0.6, 0.25, 0.06)  # of the steps tested at once
LONG_STRIDE = 6.0  # times the usual stride of the slopes, after a step without improvement


@dataclass(frozen=True)
class Fit:
    """A model fitted: values of all parameters by name, of which `names` (p) are free.

    `rest` (n,) are the white prediction errors, `slopes` (n, p) their derivatives.
    """

    values: Mapping[str, float]
    names: tuple[str, ...]
    rest: Floats
    slopes: Floats
    noise: Noise

    @property
    def squares(self) -> float:
        """Sum of the squared white errors; infinite if the model is invalid."""
        return float(np.nan_to_num(self.rest @ self.rest, nan=np.inf))

    @property
    def covariance(self) -> Floats:
        """Covariance (p, p) of the free parameters."""
        return np.asarray(np.linalg.pinv(self.slopes.T @ self.slopes, hermitian=True))

    def std(self, name: str) -> float:
        """Return the standard deviation of a free parameter, in its unit."""
        index = self.names.index(name)
        return float(np.sqrt(self.covariance[index, index]))

    def std_beside(self, name: str, held: Collection[str]) -> float:
        """Return the standard deviation of a free parameter while those of `held` are fixed."""
        names = [one for one in self.names if one == name or one not in held]
        return replace(self, names=tuple(names), slopes=self.slopes[:, [self.names.index(n) for n in names]]).std(name)

    def values_without(self, left_out: Mask) -> Mapping[str, float]:
        """Return the values fitted without some white errors, mask (n,), to first order."""
        slopes, rest = self.slopes[~left_out], self.rest[~left_out]
        step = np.asarray(-np.linalg.lstsq(slopes.T @ slopes, slopes.T @ rest, rcond=1e-10)[0], np.float64)
        return moved(self.values, self.names, step)


def fitted(start: Mapping[str, float], names: tuple[str, ...], noise: Noise, excitation: Excitation) -> Asking[Fit]:
    """Fit the free parameters `names`; if a step falls short of its predicted reduction, the best of many shorter ones
    is taken.

    Dry friction makes the sum of squares rough. If all steps fail, slopes over a longer distance are tried, if they
    predict a large reduction.
    """
    values, stride = dict(start), 1.0
    here = yield from linear(values, names, excitation)
    usual: Linear | None = here  # over the usual distance, if known
    for _ in range(MOST_STEPS):
        rest, slopes = here
        step = newton_steps(slopes, rest, DAMPINGS[:1], room(values, names))[0]
        promised = float(rest @ rest) - float(np.sum((rest + slopes @ step) ** 2))
        if promised < SETTLED:
            break
        whole = moved(values, names, step)
        there = yield from linear(whole, names, excitation, stride)
        if float(rest @ rest) - float(there[0] @ there[0]) > KEPT * promised:
            values, here = whole, there
            usual = here if stride == 1.0 else None
            continue
        shorter, drop = yield from _best_step(values, names, rest, slopes)
        if drop >= SETTLED:
            values, usual = shorter, None
        better = drop >= LEAST_KEPT * promised
        if promised < WORTH_A_DETOUR or not (better or stride == 1.0):
            break
        stride = stride if better else LONG_STRIDE
        here = yield from linear(values, names, excitation, stride)
        usual = here if stride == 1.0 else usual
    rest, slopes = usual or (yield from linear(values, names, excitation))
    return Fit(values, names, rest, slopes, noise)


def _best_step(
    values: Mapping[str, float], names: Sequence[str], rest: Floats, slopes: Floats
) -> Asking[tuple[dict[str, float], float]]:
    """Return the best values of many shortened and damped steps, and their reduction of the sum of squares."""
    steps = [share * step for step in newton_steps(slopes, rest, DAMPINGS, room(values, names)) for share in SHARES]
    tested = [moved(values, names, step) for step in steps]
    white = yield tested
    squares = sums_of_squares(white)
    best = int(np.argmin(squares))
    return tested[best], float(rest @ rest) - float(squares[best])


def linear(
    values: Mapping[str, float], names: Sequence[str], excitation: Excitation, stride: float | Floats = 1.0
) -> Asking[Linear]:
    """Return white errors (n,) at some values, and their slopes (n, p) by the parameters `names`.

    Slopes are finite differences over `stride` times the usual step, a number or one per parameter (p,). Those by
    parameters in seconds are central ones: if speeds have a kink, as at a command, errors bend at the true latency.
    If the model is valid on one side only, that side counts.
    """
    moves = moves_of(values, names, excitation, stride)
    both = two_sided(values, names, moves)
    backward = one_by_one(values, [names[index] for index in both], -moves[both])
    white = yield [values, *one_by_one(values, names, moves), *backward]
    rest = white[:, 0].copy()
    if not np.isfinite(rest).all():  # the step that led here is rejected
        return rest, np.full((len(rest), len(names)), np.nan)
    with np.errstate(invalid="ignore"):
        slopes = (white[:, 1 : 1 + len(names)] - rest[:, None]) / moves
        behind = (rest[:, None] - white[:, 1 + len(names) :]) / moves[both]
    for index, column in zip(both, behind.T, strict=True):
        if np.isfinite(column).all():
            ahead = slopes[:, index]
            slopes[:, index] = 0.5 * (ahead + column) if np.isfinite(ahead).all() else column
    lost = np.flatnonzero(~np.isfinite(slopes).all(axis=0))
    if len(lost):  # the model is invalid there; it may be valid on the other side
        white = yield [values, *one_by_one(values, [names[index] for index in lost.tolist()], -moves[lost])]
        with np.errstate(invalid="ignore"):
            behind = (white[:, :1] - white[:, 1:]) / moves[lost]
        slopes[:, lost] = np.where(np.isfinite(behind), behind, 0.0)
    return rest, slopes


def two_sided(values: Mapping[str, float], names: Sequence[str], moves: Floats) -> list[int]:
    """Return the numbers of the parameters in seconds that may be moved both ways by `moves` (p,)."""
    known = [definition(name) for name in names]
    return [
        index
        for index, (one, move) in enumerate(zip(known, np.abs(moves).tolist(), strict=True))
        if one.unit == "s"
        and one.switches
        and one.lower <= values[one.name] - move
        and values[one.name] + move <= one.upper
    ]


def sums_of_squares(white: Floats) -> Floats:
    """Return the sum of squared white errors (n, C) of each candidate; infinite if it is invalid."""
    return np.asarray(np.nan_to_num(np.einsum("nc,nc->c", white, white), nan=np.inf))


def moves_of(
    values: Mapping[str, float], names: Sequence[str], excitation: Excitation, stride: float | Floats = 1.0
) -> Floats:
    """Return the finite-difference steps of parameters (p,), times `stride`."""
    steps = np.array([step_of(name, values[name], excitation) for name in names]) * stride
    return np.array([inward(name, values[name], step) for name, step in zip(names, steps, strict=True)])


def one_by_one(values: Mapping[str, float], names: Sequence[str], moves: Floats) -> list[dict[str, float]]:
    """Return the values with one parameter moved in each."""
    return [{**values, name: values[name] + move} for name, move in zip(names, moves, strict=True)]


def newton_steps(slopes: Floats, rest: Floats, dampings: Sequence[float], room: Floats) -> list[Floats]:
    """Return Gauss-Newton steps with these dampings (Levenberg and Marquardt) that stay within `room` (p, 2)."""
    normal, right = slopes.T @ slopes, slopes.T @ rest
    scale = np.sqrt(np.maximum(np.diag(normal), 1e-300))
    scaled = normal / np.outer(scale, scale)
    return [
        _step_within(scaled + damping * np.eye(len(scale)), right / scale, room * scale[:, None]) / scale
        for damping in dampings
    ]


def _step_within(normal: Floats, right: Floats, room: Floats) -> Floats:
    """Return the step (p,) to the minimum of a quadratic model; parameters stop at their bounds, and the others are
    solved accordingly.
    """
    step = -np.linalg.solve(normal, right)
    stopped = np.zeros(len(step), np.bool_)
    while np.any(beyond := ~stopped & ((step < room[:, 0]) | (step > room[:, 1]))):
        stopped |= beyond
        step[stopped] = np.clip(step, *room.T)[stopped]
        free = ~stopped
        pull = right[free] + normal[np.ix_(free, stopped)] @ step[stopped]
        step[free] = -np.linalg.solve(normal[np.ix_(free, free)], pull)
    return np.asarray(step)


def room(values: Mapping[str, float], names: Sequence[str]) -> Floats:
    """Return the largest moves of each parameter down and up within its bounds, shape (p, 2)."""
    known = [definition(name) for name in names]
    return np.array([(one.lower - values[one.name], one.upper - values[one.name]) for one in known])


def inward(name: str, value: float, step: float) -> float:
    """Return the step, with its sign reversed if it would leave the parameter's bounds."""
    return -step if value + step > definition(name).upper else step


def moved(values: Mapping[str, float], names: Sequence[str], step: Floats) -> dict[str, float]:
    """Return the values with a step added to those named, kept within their bounds."""
    result = dict(values)
    for name, change in zip(names, step, strict=True):
        known = definition(name)
        result[name] = float(np.clip(values[name] + change, known.lower, known.upper))
    return result

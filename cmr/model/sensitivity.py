"""Derivatives of a simulated drive by its parameters: one drive with additional lanes."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from cmr.model.catalogue import definition
from cmr.model.motion import Floats, RobotState, Trajectory, drive
from cmr.model.parameters import RobotParameters

RELATIVE_STEP = 1e-4  # of the value or of the typical size, whichever is larger


class Sensitivities(NamedTuple):
    """A drive, arrays (R,), and its derivatives by some parameters, arrays (R, parameters)."""

    motion: Trajectory
    derivatives: Trajectory


def sensitivities(
    left: Floats,
    right: Floats,
    dt: Floats,
    parameters: RobotParameters,
    start: RobotState,
    names: Sequence[str],
    at: ArrayLike | None = None,
    *,
    time: float = 0.0,
    seed: int = 0,
) -> Sensitivities:
    """Drive once and return the motion with its derivatives by the parameters `names`, the paper's or of effects.

    Other arguments as in `drive`. Derivatives are central differences; at a bound, such as an effect that is off and
    cannot be negative, one-sided ones of second order. Raises KeyError for an unknown name, ValueError for an infinite
    parameter, such as an inactive limit.
    """
    values = {**{name: _neutral(name) for name in names}, **parameters.values}
    lanes = {name: np.full(1 + 2 * len(names), value, dtype=float) for name, value in values.items()}
    weights = []
    for k, name in enumerate(names):
        offsets, weight = _stencil(name, float(values[name]))
        lanes[name][1 + 2 * k : 3 + 2 * k] += offsets
        weights.append(weight)
    moved = drive(left, right, dt, RobotParameters.of(lanes), start, at, time=time, seed=seed)
    motion = Trajectory(*(array[:, 0] for array in moved))
    return Sensitivities(motion, Trajectory(*(_derivatives(array, weights) for array in moved)))


def _stencil(name: str, value: float) -> tuple[tuple[float, float], tuple[float, float, float]]:
    """Return two offsets, and the weights of the value and of both offsets for the derivative."""
    known = definition(name)
    if not np.isfinite(value):
        raise ValueError(f"{name} is infinite: give it a value to find out what changing it would do")
    step = RELATIVE_STEP * max(abs(value), abs(known.typical or 0.0))
    if value - step < known.lower:
        return (step, 2.0 * step), (-1.5 / step, 2.0 / step, -0.5 / step)
    if value + step > known.upper:
        return (-step, -2.0 * step), (1.5 / step, -2.0 / step, 0.5 / step)
    return (step, -step), (0.0, 0.5 / step, -0.5 / step)


def _derivatives(array: Floats, weights: Sequence[tuple[float, float, float]]) -> Floats:
    columns = [
        here * array[:, 0] + first * array[:, 1 + 2 * k] + second * array[:, 2 + 2 * k]
        for k, (here, first, second) in enumerate(weights)
    ]
    return np.stack(columns, axis=1) if columns else np.empty((len(array), 0))


def _neutral(name: str) -> float:
    neutral = definition(name).neutral
    return 0.0 if neutral is None else neutral

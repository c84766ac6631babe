"""Evaluate formulas for arrays of their variables."""

from collections.abc import Callable, Mapping
from functools import partial

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cmr.model.compiled import compiled
from cmr.model.laws.tree import Part
from cmr.model.laws.words import LARGEST_EXPONENT, VARIABLES

Floats = NDArray[np.float64]


def evaluate(part: Part, variables: Mapping[str, ArrayLike]) -> Floats:
    """Evaluate a part of a formula.

    `variables` are arrays, or numbers, that broadcast: its variables and constants, by name; for `low_pass` also `dt`
    [s], the step along the first axis. Raises KeyError for a missing one.
    """
    if part.kind == "number":
        return np.asarray(part.number, np.float64)
    if part.kind == "name":
        return np.asarray(variables[part.name], np.float64)
    inner = [evaluate(one, variables) for one in part.parts]
    if part.kind == "**":
        return np.asarray(inner[0] ** int(part.number))
    if part.kind == "sign":
        small = VARIABLES[part.parts[0].name].small
        return np.asarray(inner[0] / np.sqrt(inner[0] * inner[0] + small * small))
    if part.kind == "disc":
        x, y, radius = inner
        off_x, off_y = np.asarray(variables["x"]) - x, np.asarray(variables["y"]) - y
        return np.asarray(off_x * off_x + off_y * off_y < radius * radius, np.float64)
    if part.kind == "low_pass":
        return _low_pass(inner[0], inner[1], np.asarray(variables["dt"], np.float64))
    return np.asarray(ELEMENTARY[part.kind](*inner), np.float64)


def _clip(value: Floats, limit: Floats) -> Floats:
    return np.minimum(np.maximum(value, -limit), limit)


def _low_pass(value: Floats, seconds: Floats, dt: Floats) -> Floats:
    """Filter a signal by a first-order low pass starting at 0."""
    value, kept = np.broadcast_arrays(value, np.exp(-dt / seconds))
    result = np.zeros(value.shape)
    rows = (len(value), -1)
    follow(np.ascontiguousarray(value.reshape(rows)), np.ascontiguousarray(kept.reshape(rows)), result.reshape(rows))
    return result


@compiled("void(f8[:, ::1], f8[:, ::1], f8[:, ::1])")
def follow(values, kept, result):  # type: ignore[no-untyped-def]
    """Filter each column; `kept` is the decay of the difference per step."""
    for row in range(1, len(values)):
        for column in range(values.shape[1]):
            value = values[row, column]
            result[row, column] = value + (result[row - 1, column] - value) * kept[row, column]


ELEMENTARY: dict[str, Callable[..., Floats]] = {
    "+": np.add,
    "-": np.subtract,
    "*": np.multiply,
    "/": np.divide,
    "negative": np.negative,
    "abs": np.abs,
    "tanh": np.tanh,
    "sin": np.sin,
    "cos": np.cos,
    "exp": lambda value: np.exp(np.minimum(value, LARGEST_EXPONENT)),
    "clip": _clip,
    "dead_zone": lambda value, limit: value - _clip(value, limit),
    "step": partial(np.greater, dtype=np.bool_),
}

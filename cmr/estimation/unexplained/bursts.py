"""Bursts: times at which the errors of a signal far exceed its noise, due to events the model does not know.

Random or rare events need not correlate with any regressor; they are visible only in the spread of the errors.
"""

from dataclasses import dataclass

import numpy as np

from cmr.estimation.prediction import SIGNALS
from cmr.estimation.unexplained.scores import Remainder

SPAN = 0.5  # s over which squared errors are summed
LOUD = 8.0  # standard deviations of the sum over a span of noise
FEWEST_SAMPLES = 5  # in a span


@dataclass(frozen=True)
class Bursts:
    """The bursts of a signal: their number, and their excess of squares, out of its `whole` sum."""

    signal: str
    number: int
    excess: float
    whole: float


def bursts(rest: Remainder) -> list[Bursts]:
    """Return the bursts of each signal, those with the largest excess first."""
    found = [_bursts(name, rest) for name in SIGNALS if np.any(rest.signal == SIGNALS.index(name))]
    return sorted(found, key=lambda one: -one.excess)


def _bursts(name: str, rest: Remainder) -> Bursts:
    inside = rest.signal == SIGNALS.index(name)
    squares = rest.loud[inside] ** 2
    _, span = np.unique(rest.blocks(SPAN)[inside], return_inverse=True)
    count, power = np.bincount(span), np.bincount(span, squares)
    loud = (count >= FEWEST_SAMPLES) & (power - count > LOUD * np.sqrt(2.0 * count))
    return Bursts(name, int(np.count_nonzero(loud)), float((power - count)[loud].sum()), float(squares.sum()))

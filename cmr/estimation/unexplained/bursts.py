"""Moments at which a signal errs far more than its noise does: something happens that the model does not know.

What happens at random, or only now and then, need not go with anything; it shows in the spread of the errors alone.
"""

from dataclasses import dataclass

import numpy as np

from cmr.estimation.prediction import SIGNALS
from cmr.estimation.unexplained.scores import Remainder

SPAN = 0.5  # s
LOUD = 8.0  # standard deviations of what a span of noise adds up to
FEWEST_SAMPLES = 5  # in a span


@dataclass(frozen=True)
class Bursts:
    """Spans of a signal that are too loud: how many, and their squares beyond what is usual, of its `whole` sum."""

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

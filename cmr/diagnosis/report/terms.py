"""Labels and units of signals and regressors."""

import math
from typing import NamedTuple

import numpy as np

from cmr.diagnosis.words import regressor_name, signal_name
from cmr.recordings.signal import Floats


class Term(NamedTuple):
    """The name of a quantity, its unit, and its period (0: not periodic)."""

    words: str
    unit: str
    period: float = 0.0

    @property
    def label(self) -> str:
        """The name with its unit in brackets, as an axis label."""
        return f"{self.words} [{self.unit}]" if self.unit else self.words


# Symbols for quantities.
SYMBOLS = {
    "psi_left": "\u03c8",
    "psi_right": "\u03c8",
    "speed": "v",
    "yaw_rate": "\u03c9",
    "heading": "\u03b8",
}
TURN = 2.0 * math.pi
UNITS = {
    "time": "s",
    "command_left": "duty",
    "command_right": "duty",
    "command_change": "duty",
    "speed": "m/s",
    "yaw_rate": "rad/s",
    "speed_times_yaw_rate": "m/s\u00b2",
    "acceleration": "m/s\u00b2",
    "yaw_acceleration": "rad/s\u00b2",
    "x": "m",
    "y": "m",
    "heading": "rad",
    "wheel_angle_left": "rad",
    "wheel_angle_right": "rad",
    "energy": "s at full load",
}
PERIODIC = ("heading", "wheel_angle_left", "wheel_angle_right")


def signal_words(name: str) -> str:
    """Return what a signal is called; from its identifier if unknown."""
    return _with_symbol(signal_name(name), name)


def regressor(name: str) -> Term:
    """Return the term of a regressor; from its identifier if unknown."""
    return Term(_with_symbol(regressor_name(name), name), UNITS.get(name, ""), TURN if name in PERIODIC else 0.0)


def place(name: str) -> int:
    """Return the position of a regressor in the order above, others last."""
    return list(UNITS).index(name) if name in UNITS else len(UNITS)


def as_shown(name: str, values: Floats) -> Floats:
    """Return a regressor's values as they are plotted: angles within half a turn of zero."""
    period = regressor(name).period
    return np.asarray((values + period / 2.0) % period - period / 2.0 if period else values)


def _with_symbol(words: str, name: str) -> str:
    return f"{words} {SYMBOLS[name]}" if name in SYMBOLS else words

"""What signals and regressors of residuals are called, and their units."""

import math
from typing import NamedTuple

import numpy as np

from cmr.recordings.signal import Floats


class Term(NamedTuple):
    """What a quantity is called, its unit, and after how much of it all begins anew (0: never)."""

    words: str
    unit: str
    period: float = 0.0

    @property
    def label(self) -> str:
        """The name with its unit in brackets, as an axis bears it."""
        return f"{self.words} [{self.unit}]" if self.unit else self.words


SIGNALS = {
    "psi_left": "left wheel speed \u03c8",
    "psi_right": "right wheel speed \u03c8",
    "yaw_rate": "yaw rate \u03c9",
    "forward": "forward position",
    "sideways": "sideways position",
    "heading": "heading \u03b8",
}
TURN = 2.0 * math.pi
REGRESSORS = {
    "time": Term("time", "s"),
    "command_left": Term("left command", "duty"),
    "command_right": Term("right command", "duty"),
    "command_change": Term("change of command", "duty"),
    "speed": Term("speed v", "m/s"),
    "yaw_rate": Term("yaw rate \u03c9", "rad/s"),
    "speed_times_yaw_rate": Term("v times \u03c9", "m/s\u00b2"),
    "acceleration": Term("acceleration", "m/s\u00b2"),
    "yaw_acceleration": Term("yaw acceleration", "rad/s\u00b2"),
    "x": Term("place, x", "m"),
    "y": Term("place, y", "m"),
    "heading": Term("heading \u03b8", "rad", TURN),
    "wheel_angle_left": Term("left wheel angle", "rad", TURN),
    "wheel_angle_right": Term("right wheel angle", "rad", TURN),
    "energy": Term("energy spent", "s at full load"),
}


def signal_words(name: str) -> str:
    """Return what a signal is called; its own name in words where it is not known."""
    return SIGNALS.get(name, _in_words(name))


def regressor(name: str) -> Term:
    """Return the term of a regressor; its own name in words where it is not known."""
    return REGRESSORS.get(name, Term(_in_words(name), ""))


def place(name: str) -> int:
    """Return where a regressor stands among all: in the order above, others last."""
    return list(REGRESSORS).index(name) if name in REGRESSORS else len(REGRESSORS)


def as_shown(name: str, values: Floats) -> Floats:
    """Return a regressor's values as they are plotted: angles within half a turn of zero."""
    period = regressor(name).period
    return np.asarray((values + period / 2.0) % period - period / 2.0 if period else values)


def _in_words(name: str) -> str:
    return name.replace("_", " ")

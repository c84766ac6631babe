"""The true states of a drive as formulas read them: wheels in two columns (left, right), all else in one."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from cmr.recordings.signal import Floats


@dataclass(frozen=True)
class States:
    """What happens in a drive at equal steps `dt` [s].

    `motion` are the plant's columns, `duties` those that were commanded, shape (n, 2), `robot` the paper's parameters.
    """

    motion: Mapping[str, Any]
    duties: Floats
    robot: Mapping[str, float]
    dt: float

    def _both(self, name: str) -> Floats:
        return np.column_stack([self.motion[f"{name}_left"], self.motion[f"{name}_right"]])

    def _one(self, name: str) -> Floats:
        return np.asarray(self.motion[name], np.float64)[:, np.newaxis]

    @cached_property
    def psi(self) -> Floats:
        """Wheel speeds [rad/s], (n, 2)."""
        return self._both("psi")

    @cached_property
    def phi(self) -> Floats:
        """Angles that the wheels have turned [rad], (n, 2)."""
        return self._both("phi")

    @cached_property
    def domega(self) -> Floats:
        """Accelerations of the wheels [rad/s^2], (n, 2)."""
        return self._both("domega")

    @property
    def u(self) -> Floats:
        """Duties, (n, 2)."""
        return self.duties

    @cached_property
    def effort(self) -> Floats:
        """u - K1 psi, (n, 2)."""
        return np.asarray(self.duties - self.robot["k1"] * self.psi, np.float64)

    @cached_property
    def load(self) -> Floats:
        """Current drawn, (n, 1): sum of max(0, u (u - 0.8 K1 psi))."""
        own = np.maximum(0.0, self.duties * (self.duties - 0.8 * self.robot["k1"] * self.psi))
        return np.asarray(own.sum(axis=1, keepdims=True), np.float64)

    @cached_property
    def v(self) -> Floats:
        """Forward speed by the wheels [m/s], (n, 1)."""
        return np.asarray(self.robot["wheel_radius"] * self.psi.mean(axis=1, keepdims=True), np.float64)

    @cached_property
    def difference(self) -> Floats:
        """Speed of the right wheels over the ground less that of the left ones [m/s], (n, 1)."""
        return self.robot["wheel_radius"] * (self.psi[:, 1:] - self.psi[:, :1])

    @cached_property
    def w(self) -> Floats:
        """Yaw rate by the wheels [rad/s], (n, 1)."""
        return self.difference / self.robot["base_width"]

    @cached_property
    def x(self) -> Floats:
        """Place [m], (n, 1)."""
        return self._one("x")

    @cached_property
    def y(self) -> Floats:
        """Place [m], (n, 1)."""
        return self._one("y")

    @cached_property
    def theta(self) -> Floats:
        """Heading [rad], (n, 1)."""
        return self._one("theta")

    @cached_property
    def t(self) -> Floats:
        """Time since the start [s], (n, 1)."""
        return np.asarray(self.dt * np.arange(len(self.duties))[:, np.newaxis], np.float64)

    @property
    def ahead_of_origin(self) -> Floats:
        """How far ahead of the world's origin the robot is, along its heading [m], (n, 1)."""
        return self.x * np.cos(self.theta) + self.y * np.sin(self.theta)

    def other(self, columns: Floats) -> Floats:
        """Return what the wheel of the other side has, (n, 2)."""
        return columns[:, ::-1]

    def low_pass(self, values: Floats, seconds: float) -> Floats:
        """Return values behind a filter of first order with this time constant [s] that begins at 0."""
        from scipy.signal import lfilter

        kept = math.exp(-self.dt / seconds)
        return np.asarray(lfilter([1.0 - kept], [1.0, -kept], values, axis=0))

    def variables(self) -> dict[str, Floats]:
        """Return all variables that formulas of cmr.model.laws read, by name; also `dt`."""
        turning = np.abs(self.w[:, 0]) > 0.02
        sign = np.where(turning, np.sign(self.w[:, 0]), 0.0)
        last = np.maximum.accumulate(np.where(sign != 0.0, np.arange(len(sign)), 0))
        direction = sign[last]
        reversed_at = np.maximum.accumulate(
            np.where(np.concatenate([[False], direction[1:] != direction[:-1]]), np.arange(len(sign)), 0)
        )
        way = np.concatenate([[0.0], np.cumsum(np.abs(self.v[1:, 0])) * self.dt])
        return {
            **{name: getattr(self, name) for name in ("psi", "domega", "u", "effort", "load", "v", "w")},
            **{name: getattr(self, name) for name in ("x", "y", "theta", "t")},
            **{f"other_{name}": self.other(getattr(self, name)) for name in ("psi", "domega", "u")},
            "s": self.robot["k1"] * self.psi,
            "dv": self.robot["wheel_radius"] * self.domega.mean(axis=1, keepdims=True),
            "dw": self.robot["wheel_radius"] * np.diff(self.domega, axis=1) / self.robot["base_width"],
            "charge": np.cumsum(self.load, axis=0) * self.dt,
            "since_turn": (self.dt * (np.arange(len(sign)) - reversed_at))[:, np.newaxis],
            "way_since_turn": (way - way[reversed_at])[:, np.newaxis],
            "dt": np.full((len(sign), 1), self.dt),
        }

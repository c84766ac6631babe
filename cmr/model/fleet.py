"""Many simulated robots, each with parameters of its own, advanced by one call."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from cmr.model import paper
from cmr.model.body import wrap
from cmr.model.motion import RobotState, parts_of
from cmr.model.motor import wheel_acceleration
from cmr.model.parameters import RobotParameters

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]
POSE_AND_SPEED = 5  # x, y, theta, psi_left, psi_right


class Fleet:
    """N robots that move in steps of `dt` [s]; each is known by its index, in the order in which it was added.

    An `index` below is one number or an array of them; values are then numbers or arrays that broadcast with it.
    """

    def __init__(self, dt: float) -> None:
        self.dt = dt
        self._state: Floats = np.empty((POSE_AND_SPEED, 0))
        self._duty: Floats = np.empty((2, 0))
        self._parameters: Floats = np.empty((4, 0))
        self._coefficients: Floats = np.empty((paper.COEFFICIENTS, 0))
        self._parts = 1
        self._changed = False

    def __len__(self) -> int:
        return int(self._state.shape[1])

    def add(self, state: RobotState, parameters: RobotParameters) -> Indices:
        """Add one robot for each entry of state and parameters, and return their indices; they begin without duty."""
        shape = np.broadcast_shapes(*(np.shape(value) for value in (*state, *parameters)))
        added = np.arange(len(self), len(self) + int(np.prod(shape)))
        for name in ("_state", "_duty", "_parameters", "_coefficients"):
            rows: Floats = getattr(self, name)
            setattr(self, name, np.hstack([rows, np.zeros((len(rows), len(added)))]))
        self.place(added, state)
        self.set_parameters(added, parameters)
        return added

    def place(self, index: Any, state: RobotState) -> None:
        """Put robots into another state; what they are commanded stays."""
        for row, values in zip(self._state, state[:POSE_AND_SPEED], strict=True):
            row[index] = values
        self._changed = True

    def set_parameters(self, index: Any, parameters: RobotParameters) -> None:
        """Let robots move by other parameters from now on; their states stay."""
        for row, values in zip(self._parameters, parameters, strict=True):
            row[index] = values
        self._changed = True

    def command(self, index: Any, left: Any, right: Any) -> None:
        """Drive robots with these duties, in [-1, 1], from now on."""
        self._duty[0, index] = left
        self._duty[1, index] = right

    def advance(self, steps: int = 1) -> None:
        """Let time pass for all robots."""
        if self._changed:
            self._prepare()
        for _ in range(steps * self._parts):
            paper.advance(*self._state, *self._duty, *self._coefficients)

    def states(self, index: Any = slice(None)) -> RobotState:
        """Return the states as arrays; headings lie in (-pi, pi]."""
        x, y, theta, psi_left, psi_right = self._state[:, index]
        parameters = RobotParameters(*self._parameters[:, index])
        duty_left, duty_right = self._duty[:, index]
        return RobotState(
            x,
            y,
            wrap(theta),
            psi_left,
            psi_right,
            wheel_acceleration(psi_left, duty_left, parameters),
            wheel_acceleration(psi_right, duty_right, parameters),
        )

    def _prepare(self) -> None:
        """Compute what depends on parameters alone, after they or a state were set."""
        radius, _, k1, base = self._parameters
        fastest = np.maximum(np.abs(self._state[3:]).max(axis=0), 1.0 / k1)
        self._parts = int(parts_of(self.dt, radius, base, fastest))
        paper.fill_coefficients(self._parameters, self.dt / self._parts, self._coefficients)
        self._changed = False

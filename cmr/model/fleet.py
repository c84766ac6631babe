"""Many simulated robots, each with parameters of its own, advanced by one call."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cmr.model import paper
from cmr.model.motion import LARGEST_HALF_TURN, RobotState, half_turn
from cmr.model.parameters import DEFINITIONS, RobotParameters

if TYPE_CHECKING:
    from cmr.model.extended.group import ExtendedGroup

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]
POSE_AND_SPEED = 5  # x, y, theta, psi_left, psi_right
ROOM = 16  # initial capacity in robots; doubled when full

Index: TypeAlias = int | Sequence[int] | NDArray[np.int64] | slice  # of robots in a fleet


class Fleet:
    """N robots that move in steps of `dt` [s]; each has an index, in order of addition.

    An `index` below is one number or an array of them; values are then numbers or arrays that broadcast with it. Robots
    without effects move by the paper's model, the others by the extended one. `seed` determines random numbers.
    """

    def __init__(self, dt: float, seed: int = 0) -> None:
        self.dt = dt
        self._seed = seed
        self._count = 0
        self._state: Floats = np.empty((POSE_AND_SPEED, ROOM))
        self._duty: Floats = np.empty((2, ROOM))
        self._parameters: Floats = np.empty((len(DEFINITIONS), ROOM))
        self._coefficients: Floats = np.empty((paper.COEFFICIENTS, ROOM))
        self._effects: dict[str, Floats] = {}
        self._extended: ExtendedGroup | None = None
        self._placed = np.empty(ROOM, dtype=bool)
        self._changed = False
        self._commanded = False
        self._steps = 0
        self._rows: tuple[Floats, ...] = ()

    def __len__(self) -> int:
        return self._count

    def add(self, state: RobotState, parameters: RobotParameters) -> Indices:
        """Add one robot per entry of state and parameters, with zero duty; return their indices.

        Raises KeyError for an effect's parameter that the catalogue does not have.
        """
        shape = np.broadcast_shapes(*(np.shape(value) for value in (*state, *parameters.values.values())))
        added = np.arange(self._count, self._count + int(np.prod(shape)))
        self._make_room(self._count + len(added))
        self._count += len(added)
        self._duty[:, added] = 0.0
        self.place(added, RobotState(*(_one_each(value, shape) for value in state)))
        self.set_parameters(
            added, RobotParameters.of({name: _one_each(value, shape) for name, value in parameters.values.items()})
        )
        return added

    def place(self, index: Index, state: RobotState) -> None:
        """Set the state of robots; their commands stay, and their time restarts."""
        for row, values in zip(self._state, state[:POSE_AND_SPEED], strict=True):
            row[index] = values
        self._placed[index] = True
        self._changed = True

    def set_parameters(self, index: Index, parameters: RobotParameters) -> None:
        """Change the parameters of robots; their states stay.

        Raises KeyError for an effect's parameter that the catalogue does not have.
        """
        for name in parameters.effects:
            if name not in self._effects:
                self._effects[name] = np.full(len(self._placed), _neutral(name))
        for row, numbers in zip(self._parameters, parameters, strict=True):
            row[index] = numbers
        for name, numbers_of_all in self._effects.items():
            numbers_of_all[index] = parameters.effects.get(name, _neutral(name))
        self._changed = True

    def command(self, index: Index, left: ArrayLike, right: ArrayLike) -> None:
        """Set the duties of robots, in [-1, 1]."""
        self._duty[0, index] = left
        self._duty[1, index] = right
        self._commanded = True

    def advance(self, steps: int = 1) -> None:
        """Simulate all robots."""
        if self._changed:
            self._prepare()
        if self._extended and self._commanded:
            self._extended.command(self._duty)
        self._commanded = False
        for _ in range(steps):
            if self._rows:
                paper.advance(*self._rows)
            if self._extended:
                self._extended.advance(self._steps)
            self._steps += 1

    def states(self, index: Index | None = None) -> RobotState:
        """Return the states as arrays, of all robots without an index; headings lie in (-pi, pi]."""
        states = np.empty((len(RobotState._fields), self._count))
        paper.read(self._state, self._duty, self._parameters, states)
        if self._extended:
            self._extended.write(states[:POSE_AND_SPEED], domega=states[POSE_AND_SPEED:])
            paper.wrap(states[2])
        return RobotState(*(states if index is None else states[:, index]))

    def bodies(self) -> Floats:
        """Return x, y, theta [unwrapped], psi_left and psi_right of all robots, (5, n); changes in place must be passed
        to `take_back`.
        """
        if self._changed:
            self._prepare()
        if self._extended:
            self._extended.write(self._state)
        return self._state[:, : self._count]

    def take_back(self, changed: NDArray[np.bool_]) -> None:
        """Apply changes to `bodies` of the robots with `changed` (n,) true; their memory stays."""
        if self._extended:
            self._extended.read(self._state, changed)

    def parameter(self, name: str) -> Floats:
        """Return one of the paper's parameters of all robots, (n,); a view that shows later changes."""
        return self._parameters[list(DEFINITIONS).index(name), : self._count]

    def _make_room(self, count: int) -> None:
        room = len(self._placed)
        if count <= room:
            return
        more = max(2 * room, count) - room
        self._state, self._duty, self._parameters, self._coefficients = (
            np.hstack([rows, np.zeros((len(rows), more))])
            for rows in (self._state, self._duty, self._parameters, self._coefficients)
        )
        self._placed = np.append(self._placed, np.zeros(more, dtype=bool))
        self._effects = {name: np.append(v, np.full(more, _neutral(name))) for name, v in self._effects.items()}

    def _prepare(self) -> None:
        """Assign robots to models, and precompute what depends only on parameters."""
        n = self._count
        before, self._extended = self._extended, None
        if before:
            before.write(self._state, ~self._placed)
        values = {name: numbers[:n] for name, numbers in self._effects.items()}
        extended = _turning_too_fast(self.dt, self._parameters[:, :n], self._state[3:, :n])
        if values:
            # Composing it takes time that the paper's model does not need.
            from cmr.model.extended.model import model_of

            extended |= model_of(values).on(values, (n,))
        robots = np.flatnonzero(extended)
        if len(robots):
            from cmr.model.extended.group import ExtendedGroup

            values |= zip(DEFINITIONS, self._parameters[:, :n], strict=True)
            self._extended = ExtendedGroup(self.dt, self._seed, robots, values, self._state[:, :n])
            if before:
                self._extended.remember(before, ~self._placed, self._duty)
        paper.fill_coefficients(self._parameters[:, :n], self.dt, self._coefficients[:, :n])
        rows = (*self._state, *self._duty, *self._coefficients)
        self._rows = () if len(robots) == n else tuple(row[:n] for row in rows)
        self._placed[:] = False
        self._changed, self._commanded = False, True


def _turning_too_fast(dt: float, parameters: Floats, speeds: Floats) -> NDArray[np.bool_]:
    """Return which robots turn too far in a step for the short series of the paper's kernel."""
    radius, _, k1, base = parameters
    fastest = np.maximum(np.abs(speeds).max(axis=0), 1.0 / k1)
    return np.asarray(half_turn(dt, radius, base, fastest) > LARGEST_HALF_TURN)


def _neutral(name: str) -> float:
    from cmr.model.catalogue import definition  # the paper's model needs no catalogue

    return float(definition(name).neutral or 0.0)


def _one_each(value: ArrayLike, shape: tuple[int, ...]) -> Floats:
    return np.broadcast_to(np.asarray(value, dtype=float), shape).ravel()

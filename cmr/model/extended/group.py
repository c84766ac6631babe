"""The robots of a fleet with effects, simulated by the extended model."""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from cmr.model.extended import stepping
from cmr.model.extended.compose import LANES
from cmr.model.extended.model import START, model_of
from cmr.model.extended.statements import memories

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]
MOST_PACKETS = 1000  # commands in transit to one robot, at most
KEPT = ("time", "angle_left", "angle_right")  # kept, besides memory, when the group changes


class ExtendedGroup:
    """Some robots of a fleet, by index; parameter `values` by name and `state` are those of the whole fleet."""

    def __init__(self, dt: float, seed: int, robots: Indices, values: Mapping[str, Floats], state: Floats) -> None:
        self._model = model_of(values)
        self._dt, self._seed, self._robots = dt, seed, robots
        self._slots = np.arange(len(robots))
        chosen = {name: numbers[robots] for name, numbers in values.items() if name in self._model.definitions}
        self._blocks = self._model.robots(chosen, state[:, robots], 0.0)
        stepping.prepare(self._blocks.arguments.rows, self._blocks.stride, dt)
        # One packet per step covers the longest delay if the ring is long enough.
        self._ring = self._model.packets_under_way(chosen, np.full(MOST_PACKETS, dt))
        self._packets = np.empty(self._ring * 3 * LANES * len(self._blocks.rows))
        self._number = 0
        self._duty = np.zeros((2, len(self._blocks.rows) * LANES))
        self._luck = np.zeros(self._duty.shape[1], dtype=np.int64)
        self._luck[: len(robots)] = robots
        # Cached: with a single robot the lookup takes as long as a step.
        rows, stride = self._blocks.arguments.rows, self._blocks.stride
        self._sending = (self._model.equations.packet, rows, stride, self._duty, self._luck)
        self._step, self._stepped = self._model.step, (*self._blocks.arguments, LANES)
        # Consecutive robots are read as a slice, which is cheaper than indexing.
        first, last = int(robots[0]), int(robots[-1])
        self._columns: slice | NDArray[np.int64] = slice(first, last + 1) if last - first + 1 == len(robots) else robots

    def remember(self, before: "ExtendedGroup", stays: NDArray[np.bool_], duty: Floats) -> None:
        """Take over the memory of robots that stay in the group, by index in `stays`.

        Commands in transit are dropped: those in force, `duty` (2, robots of the fleet), hold until new ones arrive.
        """
        _, here, there = np.intersect1d(self._robots, before._robots, assume_unique=True, return_indices=True)
        chosen = stays[self._robots[here]]
        here, there = here[chosen], there[chosen]
        for name in (*memories(self._model.effects), *KEPT):
            self._blocks.put(name, before._blocks.get(name, there), here)
        for side, name in enumerate(("left_before", "right_before")):
            self._blocks.put(name, duty[side, self._robots[here]], here)

    def command(self, duty: Floats) -> None:
        """Set the duties (2, robots of the fleet)."""
        self._duty[:, : len(self._slots)] = duty[:, self._columns]
        for name, values in zip(("command_left", "command_right"), self._duty, strict=True):
            self._blocks.rows[:, self._model.row[name]] = values.reshape(-1, LANES)

    def advance(self, count: int) -> None:
        """Simulate the fleet's step number `count`."""
        if self._ring:
            packets = self._packets, self._ring, self._number
            stepping.send(*self._sending, self._seed, count, *packets, self._dt)
            self._number += 1
        self._step(*self._stepped)

    def write(self, state: Floats, chosen: NDArray[np.bool_] | None = None, domega: Floats | None = None) -> None:
        """Write x, y, theta and both psi into the fleet's state (5, robots), for `chosen` ones by index; and domega."""
        names = START if domega is None else (*START, "domega_left", "domega_right")
        slots = None if chosen is None else self._slots[chosen[self._robots]]
        for row, name in zip((*state, *(() if domega is None else domega)), names, strict=True):
            if slots is None:
                row[self._columns] = self._blocks.all(name)[: len(self._slots)]
            else:
                row[self._robots[slots]] = self._blocks.get(name, slots)

    def read(self, state: Floats, chosen: NDArray[np.bool_]) -> None:
        """Take x, y, theta and both psi from the fleet's state (5, robots), of `chosen` ones by index."""
        slots = self._slots[chosen[self._robots]]
        for row, name in zip(state, START, strict=True):
            self._blocks.put(name, row[self._robots[slots]], slots)

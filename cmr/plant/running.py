"""One robot advanced from event to event, in steps of a millisecond at most."""

import math
from collections.abc import Sequence

import numpy as np

from cmr.plant.compiling import compiled, compiled_once, loaded
from cmr.plant.motors import current, load, supply, switched, wanted_duties
from cmr.plant.parameters import Floats, PlantParameters, as_records
from cmr.plant.physics import advance, disturbed_by
from cmr.plant.state import Body, Robot, Side, at_rest

STEP = 0.001  # s
MOST_STEPS = 1000  # at once
BLOCK = 4096  # rows of random numbers drawn at once
SIDE, BODY = len(Side._fields), len(Body._fields)
PLACES = {  # of the robot's state, in one array
    **{f"{name}_left": place for place, name in enumerate(Side._fields)},
    **{f"{name}_right": SIDE + place for place, name in enumerate(Side._fields)},
    **{name: 2 * SIDE + place for place, name in enumerate(Body._fields)},
}


@compiled
def side_in(carried: Floats, number: int) -> Side:
    """Return the left side (0) or the right one (1) of the robot's state, ordered as PLACES."""
    c = carried[SIDE * number : SIDE * (number + 1)]
    return Side(c[0], c[1], c[2], c[3], c[4], c[5], c[6], c[7], c[8], c[9], c[10])


@compiled
def body_in(carried: Floats) -> Body:
    """Return the body of the robot's state, ordered as PLACES."""
    c = carried[2 * SIDE :]
    return Body(c[0], c[1], c[2], c[3], c[4], c[5], c[6], c[7], c[8], c[9], c[10])


@compiled_once
def go_on(
    records: Sequence[PlantParameters],
    carried: Floats,
    duties: Floats,
    span: tuple[float, float],
    noise: tuple[float, float, float, float],
    draws: Floats,
) -> None:
    """Advance by the `span` [s] at these duties (left, right); update `carried`, ordered as PLACES.

    `draws` are random numbers, a row for each step: two of a normal and one of a uniform distribution for the left
    side, then as many for the right one.
    """
    p = records[0]
    begin, end = span
    left, right, body = side_in(carried, 0), side_in(carried, 1), body_in(carried)
    noisy = noise[0] > 0.0 or noise[2] > 0.0 or p.traction_loss > 0.0
    wanted = wanted_duties(p, duties[0], duties[1])
    left, right = switched(p, left, wanted[0]), switched(p, right, wanted[1])
    steps = len(draws)
    h = (end - begin) / steps
    for number in range(steps):
        own = draws[number]
        left, right, body = advance(p, left, right, body, wanted, begin + number * h, h)
        if noisy:
            left = disturbed_by(p, left, noise, h, (own[0], own[1], own[2]))
            right = disturbed_by(p, right, noise, h, (own[3], own[4], own[5]))
    for k in range(SIDE):
        carried[k] = left[k]
        carried[SIDE + k] = right[k]
    for k in range(BODY):
        carried[2 * SIDE + k] = body[k]


@compiled_once
def switch(records: Sequence[PlantParameters], carried: Floats, duties: Floats) -> None:
    """Apply duties (left, right) to the motors at once, except for lags; update `carried`."""
    p = records[0]
    wanted = wanted_duties(p, duties[0], duties[1])
    for number in range(2):
        now = switched(p, side_in(carried, number), wanted[number])
        carried[SIDE * number], carried[SIDE * number + 1] = now[0], now[1]


@compiled_once
def electrics_of(records: Sequence[PlantParameters], carried: Floats, t: float) -> tuple[float, float, float]:
    """Return the battery's voltage and the currents of both motors (left, right) at t [s].

    As shares: of the voltage without load, when full, and of the current of a motor stalled at full duty.
    """
    p = records[0]
    left, right, body = side_in(carried, 0), side_in(carried, 1), body_in(carried)
    q = load(p, left.u, right.u, left.psi, right.psi)
    return supply(p, q, body), current(p, 1.0, left, q, body, t), current(p, -1.0, right, q, body, t)


class RunningRobot:
    """The plant at `time` [s since it was at rest at `pose`]; `carried` is ordered as PLACES.

    `noise`: size [rad/s^2] and time [s] of the torque's, size [1] and time [s] of the slip's.
    """

    def __init__(
        self,
        parameters: PlantParameters,
        pose: tuple[float, float, float],
        noise: tuple[float, float, float, float],
        seed: int | Sequence[int],
    ) -> None:
        robot: Robot = at_rest(pose)
        self.time = 0.0
        self.carried = np.array([*robot.left, *robot.right, *robot.body])
        self._records = as_records(parameters)
        self._noise = noise
        self._random = np.random.default_rng(seed)
        self._draws: Floats = np.zeros((0, 6))
        self._drawn = 0
        self._duties = np.zeros(2)
        self._load()
        self._go_on = loaded(go_on)

    def drive(self, left: float, right: float) -> None:
        """Set the duties of the motors from now on."""
        self._duties[:] = left, right
        switch(self._records, self.carried, self._duties)

    def electrics(self) -> tuple[float, float, float]:
        """Return the battery's voltage and both motors' currents, as `electrics_of` does."""
        return electrics_of(self._records, self.carried, self.time)

    def advance(self, time: float) -> None:
        """Advance to `time` [s]; a time in the past changes nothing."""
        while (now := self.time) < time:
            end, steps = time, 1
            if time - now > STEP:
                end = min(time, now + MOST_STEPS * STEP)
                steps = max(1, math.ceil((end - now) / STEP - 1e-6))
            draws = self._next_draws(steps)
            self._go_on(self._records, self.carried, self._duties, (now, end), self._noise, draws)
            self.time = end

    def _load(self) -> None:
        """Compile or load the functions of a step before they are needed."""
        switch(self._records, self.carried.copy(), self._duties)
        electrics_of(self._records, self.carried, 0.0)
        go_on(self._records, self.carried.copy(), self._duties, (0.0, STEP), self._noise, np.zeros((1, 6)))

    def _next_draws(self, steps: int) -> Floats:
        if self._drawn + steps > len(self._draws):
            self._draws, self._drawn = self._random.standard_normal((BLOCK, 6)), 0
            self._draws[:, 2::3] = self._random.random((BLOCK, 2))
        self._drawn += steps
        return self._draws[self._drawn - steps : self._drawn]

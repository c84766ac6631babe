"""What a motor controller makes of a command to one motor: a duty, at once or along a ramp, or a speed that it keeps.

All emulated boards with a velocity loop of their own have this one.
"""

import math
from typing import NamedTuple

LOOP_PERIOD = 0.005  # s between steps of the loop


class Gains(NamedTuple):
    """The loop's gains as shares of the full duty: `p` for an error of the full speed, `i` in 1/s, `d` in s.

    `full_speed` is what the wheel does at full duty (counts/s): the wanted share of it is the duty without any error.
    """

    p: float
    i: float
    d: float
    full_speed: float


class Rates(NamedTuple):
    """How fast a duty (1/s) or a speed (counts/s^2) may grow, and fall; infinity for at once."""

    up: float = math.inf
    down: float = math.inf


AT_ONCE = Rates()


class MotorChannel:
    """One motor and its loop.

    `duty` (-1 to 1) is what the motor gets, `speed` the set point of the loop now (counts/s), None while it keeps none.
    """

    def __init__(self) -> None:
        self.duty = 0.0
        self.speed: float | None = None
        self._goal = 0.0  # a speed while one is kept, else a duty
        self._rates = AT_ONCE
        self._integral = 0.0
        self._error = 0.0

    @property
    def is_busy(self) -> bool:
        """Whether it has to be stepped: a speed is kept, or the duty is on its way."""
        return self.speed is not None or self.duty != self._goal

    @property
    def drives(self) -> bool:
        """Whether the motor turns, or is to."""
        return self.is_busy or self.duty != 0.0

    def drive(self, duty: float, rates: Rates = AT_ONCE) -> None:
        """Give the motor a duty; one beyond -1 to 1 is the full one."""
        self._goal, self._rates, self.speed = _within_one(duty), rates, None
        if rates == AT_ONCE:
            self.duty = self._goal

    def follow(self, speed: float, measured: float, rates: Rates = AT_ONCE) -> None:
        """Keep a speed (counts/s); a ramp begins at the set point, else at the `measured` speed."""
        if self.speed is None:
            self.speed, self._integral, self._error = measured, 0.0, 0.0
        self._goal, self._rates = speed, rates
        if rates == AT_ONCE:
            self.speed = speed

    def step(self, measured: float, seconds: float, gains: Gains) -> None:
        """Go on by a time (s) with a wheel of a `measured` speed (counts/s)."""
        if self.speed is None:
            self.duty = _towards(self.duty, self._goal, self._rates, seconds)
        else:
            self.speed = _towards(self.speed, self._goal, self._rates, seconds)
            self.duty = self._regulated(self.speed, measured, seconds, gains)

    def _regulated(self, speed: float, measured: float, seconds: float, gains: Gains) -> float:
        """Return the duty that the loop gives the motor."""
        if gains.full_speed <= 0.0:
            return 0.0
        error = (speed - measured) / gains.full_speed
        slope = (error - self._error) / seconds if seconds > 0.0 else 0.0
        integral = self._integral + gains.i * error * seconds
        wanted = speed / gains.full_speed + gains.p * error + integral + gains.d * slope
        duty = _within_one(wanted)
        if duty == wanted:  # a motor that can do no more learns nothing
            self._integral = integral
        self._error = error
        return duty


def _within_one(duty: float) -> float:
    return max(-1.0, min(1.0, duty))


def _towards(value: float, goal: float, rates: Rates, seconds: float) -> float:
    """Return a value after some time on its way to a goal; away from 0 it grows, and it falls towards 0."""
    grows = abs(goal) > abs(value) and goal * value >= 0.0
    rate = rates.up if grows else rates.down
    if math.isinf(rate):
        return goal
    step = rate * seconds
    return goal if abs(goal - value) <= step else value + math.copysign(step, goal - value)

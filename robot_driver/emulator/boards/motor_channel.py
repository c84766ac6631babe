"""The channel of a motor controller for one motor: a duty, at once or along a ramp, or a regulated speed.

All emulated boards with a velocity loop use this one.
"""

import math
from typing import NamedTuple

LOOP_PERIOD = 0.005  # s between steps of the loop


class Gains(NamedTuple):
    """The loop's gains as shares of the full duty: `p` for an error of the full speed, `i` in 1/s, `d` in s.

    `full_speed` is the wheel's speed at full duty (counts/s): its share demanded is the feed-forward duty.
    """

    p: float
    i: float
    d: float
    full_speed: float


class Rates(NamedTuple):
    """Limits of the growth and the fall of a duty (1/s) or a speed (counts/s^2); infinity for none."""

    up: float = math.inf
    down: float = math.inf


AT_ONCE = Rates()


class MotorChannel:
    """One motor and its loop.

    `duty` (-1 to 1) is applied to the motor, `speed` is the current set point of the loop (counts/s), None while it is
    off.
    """

    def __init__(self) -> None:
        self.duty = 0.0
        self.speed: float | None = None
        self._goal = 0.0  # a speed while one is regulated, else a duty
        self._rates = AT_ONCE
        self._integral = 0.0
        self._error = 0.0

    @property
    def is_busy(self) -> bool:
        """Whether it must be stepped: a speed is regulated, or the duty is still ramping."""
        return self.speed is not None or self.duty != self._goal

    @property
    def drives(self) -> bool:
        """Whether the motor turns, or is commanded to."""
        return self.is_busy or self.duty != 0.0

    def drive(self, duty: float, rates: Rates = AT_ONCE) -> None:
        """Set a duty; values beyond -1 to 1 are clipped."""
        self._goal, self._rates, self.speed = _within_one(duty), rates, None
        if rates == AT_ONCE:
            self.duty = self._goal

    def follow(self, speed: float, measured: float, rates: Rates = AT_ONCE) -> None:
        """Regulate a speed (counts/s); a ramp begins at the set point, else at the `measured` speed."""
        if self.speed is None:
            self.speed, self._integral, self._error = measured, 0.0, 0.0
        self._goal, self._rates = speed, rates
        if rates == AT_ONCE:
            self.speed = speed

    def step(self, measured: float, seconds: float, gains: Gains) -> None:
        """Advance by a time (s), given the `measured` speed of the wheel (counts/s)."""
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
        if duty == wanted:  # no integration while the duty is saturated
            self._integral = integral
        self._error = error
        return duty


def _within_one(duty: float) -> float:
    return max(-1.0, min(1.0, duty))


def _towards(value: float, goal: float, rates: Rates, seconds: float) -> float:
    """Return a value after some time on its ramp to a goal; the rate of growth applies away from 0, that of fall
    towards 0.
    """
    grows = abs(goal) > abs(value) and goal * value >= 0.0
    rate = rates.up if grows else rates.down
    if math.isinf(rate):
        return goal
    step = rate * seconds
    return goal if abs(goal - value) <= step else value + math.copysign(step, goal - value)

"""Rate limits on motor duties: the duty follows commands by a ramp, for heavy robots."""

import math
from dataclasses import dataclass
from typing import NamedTuple

LONGEST_PAUSE = 0.4  # s; after a longer one the device's own watchdog may have stopped the motors


@dataclass(frozen=True)
class Limits:
    """Limits on the growth and decrease of a duty's magnitude (duty per second).

    Raises ValueError if one is not greater than 0, or if slowing down would be slower than speeding up.
    """

    speeding_up: float = 10.0
    slowing_down: float = 20.0

    def __post_init__(self) -> None:
        if not 0.0 < self.speeding_up <= self.slowing_down < math.inf:
            raise ValueError(
                f"Duty may grow by {self.speeding_up:g} and shrink by {self.slowing_down:g} per second: both must be "
                f"greater than 0, and slowing down at least as fast as speeding up."
            )


def approach(duty: float, wanted: float, seconds: float, limits: Limits) -> float:
    """Return the duty that follows `duty` after `seconds` on the way to `wanted`, through zero where the sign changes.

    Its size grows and shrinks within `limits`.
    """
    if duty * wanted < 0.0:
        until_zero = abs(duty) / limits.slowing_down
        if until_zero >= seconds:
            return math.copysign(abs(duty) - limits.slowing_down * seconds, duty)
        duty, seconds = 0.0, seconds - until_zero
    if abs(wanted) >= abs(duty):
        return math.copysign(min(abs(wanted), abs(duty) + limits.speeding_up * seconds), wanted)
    return math.copysign(max(abs(wanted), abs(duty) - limits.slowing_down * seconds), duty)


class Ramp:
    """The duties of both sides on their way to the command; starts at zero.

    Only duties acknowledged by the device count as reached; lost ones are not built upon. If it may have acknowledged
    others, growth does not count: two steps might be taken at once.
    """

    def __init__(self, limits: Limits, longest_step: float) -> None:
        self._limits = limits
        self._longest_step = longest_step
        self.reset()

    def reset(self) -> None:
        """Reset to zero; the next command is approached from there."""
        self._reached = self._next = STANDSTILL, STANDSTILL

    def towards(self, left: float, right: float, now: float) -> tuple[float, float]:
        """Return the duties (left, right) for the moment `now` (s) on the way to those commanded.

        After a pause they continue as if it had lasted `longest_step` (s), after more than LONGEST_PAUSE from zero.
        """
        self._next = self._step(self._reached[0], left, now), self._step(self._reached[1], right, now)
        return self._next[0].duty, self._next[1].duty

    def acknowledge(self) -> None:
        """Continue from the last duties without their growth: the device has acknowledged them, or others."""
        self._reached = _surely(self._reached[0], self._next[0]), _surely(self._reached[1], self._next[1])

    def confirm(self) -> None:
        """Continue from the last duties: it is now certain that the device has acknowledged these."""
        self._reached = self._next

    def _step(self, reached: "_Reached", wanted: float, now: float) -> "_Reached":
        duty, time = reached if now - reached.time <= LONGEST_PAUSE else (0.0, now)
        seconds = min(max(now - time, 0.0), self._longest_step)
        return _Reached(approach(duty, wanted, seconds, self._limits), now)


class _Reached(NamedTuple):
    """A duty of one side, and when it was sent (s)."""

    duty: float
    time: float


STANDSTILL = _Reached(0.0, math.inf)


def _surely(before: _Reached, after: _Reached) -> _Reached:
    """Return a safe duty when it is unknown which of the two is in force: the smaller."""
    if before.duty * after.duty < 0.0:
        return _Reached(0.0, after.time)
    return after if abs(after.duty) <= abs(before.duty) else before

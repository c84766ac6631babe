"""Safe change of parameters in use: a large change waits until the robot rests, or a person confirms it."""

from collections.abc import Callable
from typing import Generic, TypeVar

from cmr.model.parameters import RobotParameters

LARGEST_CHANGE = 0.3  # relative change of derived quantities allowed while a robot moves
REST = 500_000  # us of standing wheels after which a robot counts as resting
STANDING = 0.2  # rad/s; a slower wheel rests
SPEED, TURN_RATE = 0.3, 1.0  # m/s and rad/s at which duties are compared
T = TypeVar("T")


class Caution(Generic[T]):
    """Applies new parameters, of any type; `measure` returns the quantities that must not change much, None without
    any.

    `now` is in use, `waiting` waits. A robot counts as resting until it moves. To catch many small changes, each is
    also compared with what was in use when the robot last rested.
    """

    def __init__(self, measure: Callable[[T], tuple[float, ...] | None]) -> None:
        self.now: T | None = None
        self.waiting: T | None = None
        self._measure = measure
        self._settled: T | None = None  # what was in use at the last rest, or confirmed since
        self._moves = False
        self._stands_since = 0

    def offer(self, new: T) -> None:
        """Offer the newest parameters, which may be the same as before."""
        if self._moves and any(self._is_large(old, new) for old in (self.now, self._settled) if old is not None):
            self.waiting = new
            return
        self.now, self.waiting = new, None
        if not self._moves or self._settled is None:
            self._settled = new

    def note_motion(self, utime: int, psi_left: float, psi_right: float) -> None:
        """Update with wheel speeds [rad/s] at `utime` [us]; waiting parameters are applied once the wheels stand."""
        if max(abs(psi_left), abs(psi_right)) >= STANDING:
            self._moves, self._stands_since = True, utime
        elif abs(utime - self._stands_since) >= REST:
            self._moves = False
            self.confirm()

    def confirm(self) -> None:
        """Apply waiting parameters; further changes are compared with them."""
        if self.waiting is not None:
            self.now, self.waiting = self.waiting, None
        self._settled = self.now

    def values(self) -> tuple[tuple[float, ...], tuple[float, ...]]:
        """Return the measured quantities of the parameters in use and of the waiting ones; empty without any."""
        both = (self._measure(one) if one is not None else None for one in (self.now, self.waiting))
        now, waiting = (values or () for values in both)
        return now, waiting

    def _is_large(self, old: T, new: T) -> bool:
        before, after = self._measure(old), self._measure(new)
        if before is None or after is None:
            return before is not after
        return any(abs(b - a) > LARGEST_CHANGE * abs(a) for a, b in zip(before, after, strict=True))


def duties_for(model: RobotParameters) -> tuple[float, float]:
    """Return the duty that drives straight at SPEED, and the one that turns at TURN_RATE on the spot."""
    straight = SPEED / model.wheel_radius * model.k1
    return float(straight), float(TURN_RATE * model.base_width / 2.0 / model.wheel_radius * model.k1)


def motion_of(model: RobotParameters) -> tuple[float, float]:
    """Return the motion when both wheels turn by 1 rad, in m, and when they turn against each other, in rad."""
    return float(model.wheel_radius), float(2.0 * model.wheel_radius / model.base_width)

"""Parameters in use where a robot moves by them: a large change waits until it rests, or a person confirms it."""

from collections.abc import Callable
from typing import Generic, TypeVar

from cmr.model.parameters import RobotParameters

LARGEST_CHANGE = 0.3  # share by which what is derived from parameters may change while a robot moves
REST = 500_000  # us for which wheels must stand until a robot rests
STANDING = 0.2  # rad/s; a slower wheel rests
SPEED, TURN_RATE = 0.3, 1.0  # m/s and rad/s, for which duties are compared
T = TypeVar("T")


class Caution(Generic[T]):
    """Takes parameters over, of whichever type; `measure` returns what must not change much, None where nothing is.

    `now` is what is in use, `waiting` what waits. A robot rests until it is seen to move. Changes that are small one by
    one are no small change together: each is compared with what was in use when the robot rested, too.
    """

    def __init__(self, measure: Callable[[T], tuple[float, ...] | None]) -> None:
        self.now: T | None = None
        self.waiting: T | None = None
        self._measure = measure
        self._settled: T | None = None  # what was in use at the last rest, or confirmed since
        self._moves = False
        self._stands_since = 0

    def offer(self, new: T) -> None:
        """Take the newest parameters, which may be the same as before."""
        if self._moves and any(self._is_large(old, new) for old in (self.now, self._settled) if old is not None):
            self.waiting = new
            return
        self.now, self.waiting = new, None
        if not self._moves or self._settled is None:
            self._settled = new

    def note_motion(self, utime: int, psi_left: float, psi_right: float) -> None:
        """Note how fast the wheels turn [rad/s] at `utime` [us]; what waits is taken over once they stand."""
        if max(abs(psi_left), abs(psi_right)) >= STANDING:
            self._moves, self._stands_since = True, utime
        elif abs(utime - self._stands_since) >= REST:
            self._moves = False
            self.confirm()

    def confirm(self) -> None:
        """Take over what waits; further changes are compared with what is in use then."""
        if self.waiting is not None:
            self.now, self.waiting = self.waiting, None
        self._settled = self.now

    def values(self) -> tuple[tuple[float, ...], tuple[float, ...]]:
        """Return what is measured of the parameters in use and of those that wait; nothing where there are none."""
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
    """Return how a robot moves when its wheels turn by 1 rad, in m, and when they do so against each other, in rad."""
    return float(model.wheel_radius), float(2.0 * model.wheel_radius / model.base_width)

"""Convert the raw counts of two encoders to total ticks and wheel velocities."""

import math
from dataclasses import dataclass
from typing import NamedTuple

from robot_driver.controllers.controller import COUNTER_RANGE, signed_step
from robot_driver.gate.guard import Mounting

FASTEST_WHEEL = 200.0  # rad/s; no wheel of such a robot reaches it, whatever its parameters
UNTIMED = 0.1  # s assumed for a step of unknown duration


class CountersReset(Exception):  # noqa: N818 - a power cycle of the device is a normal event
    """Both counters restarted: the device was reset and has lost its settings."""


@dataclass(frozen=True)
class WheelMotion:
    """Position and velocity of the wheels, left first: total ticks, and velocity (rad/s)."""

    ticks: tuple[int, int]
    psi: tuple[float, float]


class WheelEncoders:
    """Adds up the steps of both encoders; `ticks` begin at 0 and never wrap.

    `jumps` counts rejected steps.
    """

    def __init__(self, ticks_per_turn: int) -> None:
        self.ticks = (0, 0)
        self.jumps = 0
        self._ticks_per_turn = ticks_per_turn
        self._before: tuple[tuple[int, int], int] | None = None
        self._jumped = False
        self._may_be_reset = False

    def rebase(self) -> None:
        """Use the next counts as a new origin: the motion since the last ones is unknown."""
        self._before = None

    def doubt(self) -> None:
        """Use the next counts as a new origin if they are nearer to zero than to the last ones.

        For use after a silence in which the device may have been reset without reporting it.
        """
        self._may_be_reset = True

    def update(self, counts: tuple[int, int], nanoseconds: int, fastest: float) -> WheelMotion | None:
        """Take raw counts (ticks modulo 2^32, left first) read at a monotonic time.

        Returns None if there is no velocity to report: at a new origin, when time has not advanced because a device's
        clock was set back, and when the step is rejected because a wheel would have turned faster than `fastest`
        (rad/s). After two such steps in a row, however, the wheels are taken to be faster than assumed, and steps up to
        FASTEST_WHEEL are accepted. Raises CountersReset if the step is rejected but both counts are near zero, which
        become a new origin.
        """
        before, self._before = self._before, (counts, nanoseconds)
        may_be_reset, self._may_be_reset = self._may_be_reset, False
        if before is None:
            return None
        steps = (signed_step(before[0][0], counts[0]), signed_step(before[0][1], counts[1]))
        if may_be_reset and _farther(counts) < _farther(steps):
            return None
        radians_per_tick = 2 * math.pi / self._ticks_per_turn
        if nanoseconds <= before[1]:
            if _farther(steps) * radians_per_tick <= fastest * UNTIMED:
                self._add(steps)
            else:
                self.jumps += 1
            return None
        seconds = (nanoseconds - before[1]) / 1e9
        psi = (steps[0] * radians_per_tick / seconds, steps[1] * radians_per_tick / seconds)
        speed = _farther(steps) * radians_per_tick / seconds
        since_zero = _farther(counts) * radians_per_tick / seconds
        if speed > max(fastest, FASTEST_WHEEL) and since_zero <= FASTEST_WHEEL:
            self._jumped = False
            raise CountersReset
        limit = max(fastest, FASTEST_WHEEL) if self._jumped else fastest
        self._jumped = speed > fastest
        if speed > limit:
            self.jumps += 1
            return None
        self._add(steps)
        return WheelMotion(self.ticks, psi)

    def _add(self, steps: tuple[int, int]) -> None:
        self.ticks = (self.ticks[0] + steps[0], self.ticks[1] + steps[1])


def _farther(counts: tuple[int, int]) -> int:
    """Return the larger distance of the two wheels' counts from zero (ticks)."""
    return max(abs(signed_step(0, count)) for count in counts)


class Wiring(NamedTuple):
    """How motors and encoders are mounted and plugged in.

    `swap`: the first channel is the right side. `invert_*`: motor and encoder of a side are mounted backwards.
    `swap_encoders`: each channel counts the wheel that the other one drives. `invert_*_encoder`: the encoder of a side
    counts against its motor.
    """

    swap: bool = False
    invert_left: bool = False
    invert_right: bool = False
    swap_encoders: bool = False
    invert_left_encoder: bool = False
    invert_right_encoder: bool = False

    @property
    def mounting(self) -> Mounting:
        """The part that the last gate needs: the motors alone."""
        return Mounting(self.swap, self.invert_left, self.invert_right)

    def channels(self, left: float, right: float) -> tuple[float, float]:
        """Return the duties of the channels for these duties of the sides."""
        return self.mounting.channels(left, right)

    def sides(self, first: float, second: float) -> tuple[float, float]:
        """Return values of the controller's channels as (left, right), regardless of direction."""
        return (second, first) if self.swap else (first, second)

    def forward(self, first: float, second: float) -> tuple[float, float]:
        """Return duties of the channels as (left, right), positive forward: the inverse of `channels`."""
        left, right = self.sides(first, second)
        return (-left if self.invert_left else left, -right if self.invert_right else right)

    def forward_counts(self, first: int, second: int) -> tuple[int, int]:
        """Return raw encoder counts of the channels as (left, right), growing forward, modulo 2^32."""
        left, right = (second, first) if self.swap is not self.swap_encoders else (first, second)
        return (
            (-left if self.invert_left is not self.invert_left_encoder else left) % COUNTER_RANGE,
            (-right if self.invert_right is not self.invert_right_encoder else right) % COUNTER_RANGE,
        )

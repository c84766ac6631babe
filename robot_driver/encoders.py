"""From the raw counts of two encoders to total ticks and wheel velocities."""

import math
from dataclasses import dataclass
from typing import NamedTuple

from robot_driver.controllers.controller import COUNTER_RANGE, signed_step
from robot_driver.gate.guard import Mounting

FASTEST_WHEEL = 200.0  # rad/s; no wheel of a robot of this kind gets there, whatever its parameters say
UNTIMED = 0.1  # s that a step may have taken when its time is not known


class CountersReset(Exception):  # noqa: N818 - a device that was switched off and on is an event to live with
    """Both counters have begun again: the device was reset, and has forgotten what it was sent."""


@dataclass(frozen=True)
class WheelMotion:
    """Where the wheels are and how fast they turn, left first: total ticks, and velocity (rad/s)."""

    ticks: tuple[int, int]
    psi: tuple[float, float]


class WheelEncoders:
    """Adds up the steps of both encoders; `ticks` begin at 0 and never wrap.

    `jumps` counts the steps that were not believed.
    """

    def __init__(self, ticks_per_turn: int) -> None:
        self.ticks = (0, 0)
        self.jumps = 0
        self._ticks_per_turn = ticks_per_turn
        self._before: tuple[tuple[int, int], int] | None = None
        self._jumped = False
        self._may_be_reset = False

    def rebase(self) -> None:
        """Take the next counts as a new beginning: what happened since the last ones is not known."""
        self._before = None

    def doubt(self) -> None:
        """Take the next counts as a new beginning if they are nearer to zero than to the last ones.

        For after a silence in which the device may or may not have been reset, and does not report it.
        """
        self._may_be_reset = True

    def update(self, counts: tuple[int, int], nanoseconds: int, fastest: float) -> WheelMotion | None:
        """Take raw counts (ticks modulo 2^32, left first) read at a monotonic time.

        Returns None where there is no velocity to report: at a new beginning, when time has not gone on because a
        device's clock was set back, and when the step is not believed
        because a wheel would have turned faster than `fastest` (rad/s). Two such steps in a row are no jump, though:
        then the wheels are faster than thought, and steps up to FASTEST_WHEEL are believed.
        Raises CountersReset when the step is not believed but both counts are near zero; they are a new beginning.
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
    """Return how far from zero the wheel is that is farther from it (ticks)."""
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
        """What the last gate knows of it: the motors alone."""
        return Mounting(self.swap, self.invert_left, self.invert_right)

    def channels(self, left: float, right: float) -> tuple[float, float]:
        """Return the duties of the channels that drive the sides with these."""
        return self.mounting.channels(left, right)

    def sides(self, first: float, second: float) -> tuple[float, float]:
        """Return values of the controller's channels as (left, right), without regard to direction."""
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

"""Descriptions of the manoeuvres, for robots that are driven by a person or by other software than `cmr-pilot`.

Speeds are those that the robot has reached, and lengths follow from them and from its size; all are round numbers. What
matters is which motions a manoeuvre contains, not exact values.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import NamedTuple

from cmr.geometry.manoeuvres.manoeuvre import TYPICAL
from cmr.model.body import forward, turn

ROUND = (1.0, 1.5, 2.0, 2.5, 3.0, 4.0, 5.0, 6.0, 8.0, 10.0)  # times a power of ten
SLOW = 0.4  # of the fast speed, and of the fast turn
RUN = 3.0  # s of a fast straight run
TIGHTEST = 1.5  # base widths, radius of a circle
STAND = 30.0  # s
DIRECTIONS = 6
PORTION = 0.5  # share of the wheel speed in one kind of motion that a robot can surely reach in another
SMALLEST = 1e-3  # m/s, rad/s, m; lower limit for robots that hardly moved


@dataclass(frozen=True)
class Pace:
    """How fast a robot drives [m/s] and turns [rad/s], and how wide it is [m]."""

    speed: float = float(forward(1.0 / TYPICAL.k1, 1.0 / TYPICAL.k1, TYPICAL))
    turn_rate: float = float(turn(-0.5 / TYPICAL.k1, 0.5 / TYPICAL.k1, TYPICAL))
    width: float = float(TYPICAL.base_width)

    @classmethod
    def seen(cls, speed: float, turn_rate: float, width: float) -> "Pace":
        """Return the pace of a robot with these measured speeds.

        A robot that was never seen to turn is assumed to turn as fast as its wheels allow, and vice versa.
        """
        able = 0.5 * PORTION * width  # m, between speed and rate of turn
        return cls(max(speed, able * turn_rate), max(turn_rate, PORTION * speed / (0.5 * width)), width)

    @property
    def fast(self) -> float:
        """A fast speed [m/s]."""
        return _round_down(self.speed)

    @property
    def slow(self) -> float:
        """A slow speed [m/s]."""
        return _round_down(SLOW * self.speed)

    @property
    def fast_turn(self) -> float:
        """A fast rate of turn [rad/s]."""
        return _round_down(self.turn_rate)

    @property
    def slow_turn(self) -> float:
        """A slow rate of turn [rad/s]."""
        return _round_down(SLOW * self.turn_rate)

    @property
    def radius(self) -> float:
        """The radius of a circle [m] that the robot can drive fast."""
        return _round_up(max(TIGHTEST * self.width, self.fast / self.fast_turn))

    @property
    def run(self) -> float:
        """The length of a straight run [m]."""
        return _round_up(max(RUN * self.fast, 2.0 * self.width))


class Instruction(NamedTuple):
    """A drive in words, how long it takes [s], and how far the robot gets from its start [m]."""

    text: str
    seconds: float
    reach: float


def instruction(name: str, pace: Pace) -> Instruction:
    """Describe a manoeuvre for a robot; `name` is one of those in WORDS.

    Raises KeyError for a name that is not.
    """
    return WORDS[name](pace)


def _straight_runs(pace: Pace) -> Instruction:
    seconds = 2.0 * pace.run * (1.0 / pace.slow + 1.0 / pace.fast)
    speeds = f"once slowly ({pace.slow:g} m/s) and once fast ({pace.fast:g} m/s)"
    return Instruction(f"Drive {pace.run:g} m straight ahead and back again, {speeds}.", seconds, pace.run)


def _spins(pace: Pace) -> Instruction:
    seconds = 2.0 * math.tau / pace.slow_turn + 2.0 * math.tau / pace.fast_turn
    text = (
        "Turn on the spot, two full turns to the left and two to the right: "
        f"the first of each slowly ({pace.slow_turn:g} rad/s), the second fast ({pace.fast_turn:g} rad/s)."
    )
    return Instruction(text, seconds, pace.width)


def _ramps(pace: Pace) -> Instruction:
    text = (
        f"Speed up slowly from rest to {pace.slow:g} m/s within 4 s, slow down through rest to the same speed "
        f"backwards, and back to rest: twice straight on, and twice turning on the spot ({pace.slow_turn:g} rad/s)."
    )
    return Instruction(text, 64.0, 4.0 * pace.slow)


def _multisine(pace: Pace) -> Instruction:
    text = (
        "Change the command all the time for 20 s, sometimes slowly, sometimes several times a second, by different "
        f"amounts: 10 s forth and back (up to {pace.fast:g} m/s), 10 s left and right (up to {pace.fast_turn:g} rad/s)."
    )
    return Instruction(text, 20.0, _round_up(pace.fast))


def _circles(pace: Pace) -> Instruction:
    seconds = 2.0 * math.tau * pace.radius * (1.0 / pace.slow + 1.0 / pace.fast)
    text = (
        f"Drive two circles to the left and two to the right, {pace.radius:g} m radius: "
        f"the first of each slowly ({pace.slow:g} m/s), the second fast ({pace.fast:g} m/s)."
    )
    return Instruction(text, seconds, 2.0 * pace.radius)


def _steps(pace: Pace) -> Instruction:
    text = (
        f"Start, reverse and stop suddenly, a second each: at {pace.fast:g} m/s, at half of that, then turning on the "
        f"spot at {pace.fast_turn:g} rad/s and at half of that. Higher speeds, up to full drive, show more."
    )
    return Instruction(text, 20.0, _round_up(1.5 * pace.fast))


def _one_sided_steps(pace: Pace) -> Instruction:
    text = (
        "Drive the left wheels alone forth and back, 1 s each with sudden starts, four times, so that the robot turns "
        "about its right wheels; then the right wheels alone."
    )
    return Instruction(text, 20.0, _round_up(2.0 * pace.width))


def _rest(pace: Pace) -> Instruction:
    return Instruction(f"Stand still for {STAND:g} s, switched on.", STAND, pace.width)


def _repeat_loop(pace: Pace) -> Instruction:
    text = (
        f"Drive the same figure-eight of two circles ({pace.radius:g} m radius, {pace.fast:g} m/s) again and again for "
        "three minutes, with a rest of 20 s after each minute."
    )
    return Instruction(text, 220.0, 2.0 * pace.radius)


def _star(pace: Pace) -> Instruction:
    turns = 2.0 * math.tau / pace.fast_turn
    text = (
        f"Drive {pace.run:g} m straight ahead from one place and back to it ({pace.fast:g} m/s), in {DIRECTIONS} "
        f"directions that are {360 / DIRECTIONS:g} degrees apart."
    )
    return Instruction(text, 2.0 * DIRECTIONS * pace.run / pace.fast + turns, pace.run)


def _rich_drive(pace: Pace) -> Instruction:
    parts = [part(pace) for part in (_straight_runs, _spins, _circles, _steps)]
    text = " ".join(part.text for part in parts)
    return Instruction(text, sum(part.seconds for part in parts), max(part.reach for part in parts))


WORDS: Mapping[str, Callable[[Pace], Instruction]] = {
    "straight_runs": _straight_runs,
    "spins": _spins,
    "ramps": _ramps,
    "multisine": _multisine,
    "circles": _circles,
    "steps": _steps,
    "one_sided_steps": _one_sided_steps,
    "rest": _rest,
    "repeat_loop": _repeat_loop,
    "star": _star,
    "rich_drive": _rich_drive,
}


def _round_down(value: float) -> float:
    """Return the largest round number that is not above a value."""
    return _round(value, lambda steps, leading: max(step for step in steps if step <= leading))


def _round_up(value: float) -> float:
    """Return the smallest round number that is not below a value."""
    return _round(value, lambda steps, leading: min(step for step in steps if step >= leading))


def _round(value: float, choose: Callable[[tuple[float, ...], float], float]) -> float:
    value = max(value, SMALLEST)
    power = math.floor(math.log10(value))
    leading = min(max(round(value / 10.0**power, 9), 1.0), 10.0)
    return round(choose(ROUND, leading) * 10.0**power, 9)

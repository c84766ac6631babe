"""Dead reckoning by the wheels, in the complex plane."""

import cmath
import itertools
import math
from bisect import bisect_right
from collections.abc import Sequence
from dataclasses import dataclass

from cmr.msg import motor_feedback_t

TURN = 2.0 * math.pi


@dataclass(frozen=True)
class Path:
    """A path by the wheels: times (s), positions (m, x + iy) and headings (rad, unwrapped), starting at 0."""

    times: list[float]
    places: list[complex]
    headings: list[float]

    def at(self, time: float) -> tuple[complex, float]:
        """Return position and heading at a time, clipped to its ends."""
        after = bisect_right(self.times, time)
        if after == 0:
            return self.places[0], self.headings[0]
        if after == len(self.times):
            return self.places[-1], self.headings[-1]
        begin, end = self.times[after - 1], self.times[after]
        share = (time - begin) / (end - begin)
        place = self.places[after - 1] + share * (self.places[after] - self.places[after - 1])
        return place, self.headings[after - 1] + share * (self.headings[after] - self.headings[after - 1])

    @property
    def length(self) -> float:
        """Its length (m)."""
        return sum(abs(b - a) for a, b in itertools.pairwise(self.places))


def path_of(
    feedback: Sequence[motor_feedback_t], start: int, wheel_radius: float, base_width: float, ticks_per_turn: int
) -> Path:
    """Return the path from the counts; times are relative to `start` (us)."""
    per_tick = TURN * wheel_radius / ticks_per_turn
    place, heading = 0j, 0.0
    times, places, headings = [], [place], [heading]
    for number, message in enumerate(feedback):
        times.append((message.utime - start) / 1e6)
        if number:
            before = feedback[number - 1]
            left = per_tick * (message.ticks_left - before.ticks_left)
            right = per_tick * (message.ticks_right - before.ticks_right)
            turned = (right - left) / base_width
            place += 0.5 * (left + right) * cmath.exp(1j * (heading + 0.5 * turned))
            heading += turned
            places.append(place)
            headings.append(heading)
    return Path(times, places, headings)

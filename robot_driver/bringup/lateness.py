"""Estimate the latency of poses from the start and end of each part of the drive, by wheels and by poses.

In each part the robot goes straight ahead or turns on the spot, from rest to rest. Its places z, or its headings, are
compared with the wheels' o at a latency t as z = a o(time - t) + c, with a and c free for each part, so that other
disagreements between poses and wheels cannot look like latency: base width, unequal wheels, tracked point. Only slip
does: the ground speed lags accelerating wheels by some 0.02 s.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

from robot_driver.bringup.fitting import Undetermined, least_squares
from robot_driver.bringup.odometry import Path

AROUND = 0.15  # s of rest before and after a part that are compared, too
STILL, WINDOW = 0.001, 0.05  # m of allowed wheel motion within so many seconds before and after, at rest
ARM = 0.08  # m of wheel motion per rad of rotation, approximately
SHORTEST, FEWEST = 0.5, 12  # s, poses of a part
AHEAD, TURNED = 0.1, 0.5  # m, rad: smaller motions are not informative
COARSE, FINE, STEPS = 0.03, 0.01, 4  # s between tested latencies, and their number in each direction
BIAS = 0.003  # s of undetectable error per part


class Seen(NamedTuple):
    """A pose by its stamp (s): its place (m, x + iy, or its conjugate) and its heading (rad, unwrapped)."""

    time: float
    place: complex
    heading: float


@dataclass(frozen=True)
class Lateness:
    """The latency of poses (s), with its standard deviation."""

    seconds: float
    deviation: float


class _Part(NamedTuple):
    start: float
    end: float
    is_turn: bool


def lateness_of(path: Path, poses: Sequence[Seen], first: float) -> Lateness | None:
    """Estimate the latency, near a `first` estimate (s); None if too few parts of the drive show it."""
    found = [one for part in _parts(path) if (one := _of_part(path, poses, part, first)) is not None]
    if len(found) < 2:
        return None
    weights = [1.0 / (one.deviation**2 + BIAS**2) for one in found]
    pairs = list(zip(found, weights, strict=True))
    mean = sum(weight * one.seconds for one, weight in pairs) / sum(weights)
    scatter = sum(weight * (one.seconds - mean) ** 2 for one, weight in pairs) / (len(found) - 1)
    return Lateness(mean, math.sqrt(max(1.0, scatter) / sum(weights)))


def _parts(path: Path) -> list[_Part]:
    """Return the intervals of motion by the wheels, from rest to rest."""
    parts, start = [], None
    for time in path.times:
        moves = _moved(path, time - WINDOW, time + WINDOW) > STILL
        if moves and start is None:
            start = time
        elif start is not None and not (moves and time < path.times[-1]):
            (before, heading), (after, turned) = path.at(start), path.at(time)
            is_turn = abs(turned - heading) > TURNED
            if time - start > SHORTEST and (is_turn or abs(after - before) > AHEAD):
                parts.append(_Part(start, time, is_turn))
            start = None
    return parts


def _moved(path: Path, start: float, end: float) -> float:
    """Return the approximate distance moved by a wheel (m)."""
    (before, heading), (after, turned) = path.at(start), path.at(end)
    return abs(after - before) + ARM * abs(turned - heading)


def _of_part(path: Path, poses: Sequence[Seen], part: _Part, first: float) -> Lateness | None:
    """Estimate the latency from one part."""
    begin, end = part.start - AROUND + first, part.end + AROUND + first
    within = [pose for pose in poses if begin <= pose.time <= end]
    if len(within) < FEWEST:
        return None

    def left(lateness: float) -> float:
        """Return the residual sum of squares."""
        rows: list[tuple[complex, complex]] = []
        values: list[complex] = []
        for pose in within:
            place, heading = path.at(pose.time - lateness)
            rows.append((heading if part.is_turn else place, 1.0))
            values.append(pose.heading if part.is_turn else pose.place)
        a, c = least_squares(rows, values)
        return sum(abs(row[0] * a + c - value) ** 2 for row, value in zip(rows, values, strict=True))

    try:
        tried = {number: left(first + number * COARSE) for number in range(-STEPS, STEPS + 1)}
        least = first + COARSE * min(tried, key=lambda number: tried[number])
        before, at, after = left(least - FINE), left(least), left(least + FINE)
        least += _lowest(before, at, after)
        before, at, after = left(least - FINE), left(least), left(least + FINE)
    except Undetermined:
        return None
    bend = (before - 2.0 * at + after) / FINE**2
    if bend <= 0.0:
        return None
    deviation = math.sqrt(2.0 * at / (len(within) - 3) / bend)
    return Lateness(least + _lowest(before, at, after), deviation)


def _lowest(before: float, at: float, after: float) -> float:
    """Return the minimum of the parabola through three values, FINE apart (s), near the middle one."""
    bend = before - 2.0 * at + after
    return max(-COARSE, min(0.5 * FINE * (before - after) / bend, COARSE)) if bend > 0.0 else 0.0

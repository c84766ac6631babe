"""Thin long drives: use fewer readings, on a coarser time grid.

For motion that changes within tenths of a second, 50 readings per second are nearly as informative as 100: standard
deviations from two minutes differ by a few percent, at half the computing time. Beyond that, memory sets the limit.
Steps of 0.02 s move the parameters by less than a twentieth of their standard deviations.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cmr.estimation.segments import Segment
from cmr.model.observer.observer import RESTART

ENOUGH = 50_000  # readings, of two minutes at 100 Hz: with more, each sensor is reduced to its rate in USEFUL
# Of half an hour at 100 Hz; some 60 candidates are tested at once, with a few numbers for each reading.
MOST_READINGS = 650_000


LONGER = 2  # steps of the grid merged into one,
SLOW = 25.0  # Hz; also if wheels, or poses without wheels, are read no faster than every second merged step


class PerSensor(NamedTuple):
    """A number per sensor: every n-th reading is used, or readings per second [Hz]."""

    wheels: int
    gyro: int
    poses: int


class Thinning(NamedTuple):
    """How a long drive is thinned: every n-th reading of each sensor is used, and `steps` steps become one."""

    readings: PerSensor
    steps: int = 1


EVERY_READING = PerSensor(1, 1, 1)
ALL = Thinning(EVERY_READING)
USEFUL = PerSensor(50, 50, 25)  # Hz
NUMBERS = PerSensor(2, 1, 3)  # numbers per reading
MANY = 10  # number of segments from which a subset is representative


def thinning_of(segments: Sequence[Segment]) -> Thinning:
    """Return how to thin segments so that the remaining data are just sufficient."""
    observations = [segment.observations for segment in segments]
    seconds = sum(one.seconds for one in observations)
    counts = [
        sum(map(len, times))
        for times in zip(*((one.wheel_time, one.gyro_time, one.pose_time) for one in observations), strict=True)
    ]
    readings = sum(number * count for number, count in zip(NUMBERS, counts, strict=True))
    if readings <= ENOUGH:
        return Thinning(EVERY_READING, LONGER) if (counts[0] or counts[2]) <= SLOW * seconds else ALL
    # A rate that is a little under twice the useful one counts as twice.
    every = [max(1, round(count / seconds / rate)) for count, rate in zip(counts, USEFUL, strict=True)]
    left = sum(number * count / one for number, count, one in zip(NUMBERS, counts, every, strict=True))
    further = max(1, -(-int(left) // MOST_READINGS))
    return Thinning(PerSensor(*(one * further for one in every)), LONGER)


def part_of(segments: Sequence[Segment], seconds: float) -> list[Segment]:
    """Return `seconds` of longer drives: every n-th of many segments, or the beginning of each of a few."""
    whole = sum(segment.observations.seconds for segment in segments)
    if len(segments) * seconds >= MANY * whole:
        return list(segments[:: round(whole / seconds)])
    return [thinned(one, ALL, one.observations.seconds * seconds / whole) for one in segments]


def thinned(segment: Segment, thinning: Thinning, seconds: float = np.inf) -> Segment:
    """Return a segment with every so many-th reading of each sensor; restarts of the path are kept.

    Only its first `seconds` are used. A remainder shorter than a step of the coarser grid is dropped.
    """
    whole = segment.observations
    if thinning == ALL and seconds >= whole.seconds:
        return segment
    wheels, gyro, poses = thinning.readings
    dt = whole.dt * thinning.steps
    steps = int(min(whole.steps // thinning.steps, seconds / dt))
    wheels_used, gyro_used, poses_used = (
        slice(0, int(np.searchsorted(time, steps * dt, side="right")), every)
        for time, every in ((whole.wheel_time, wheels), (whole.gyro_time, gyro), (whole.pose_time, poses))
    )
    given, rolled = (
        one[: steps * thinning.steps].reshape(-1, thinning.steps, 2).mean(axis=1)
        for one in (whole.given, segment.rolled)
    )
    return replace(
        segment,
        observations=replace(
            whole,
            dt=dt,
            steps=steps,
            wheel_time=whole.wheel_time[wheels_used].copy(),
            wheel=np.ascontiguousarray(whole.wheel[wheels_used]),
            wheel_use=np.ascontiguousarray(whole.wheel_use[wheels_used]),
            gyro_time=whole.gyro_time[gyro_used].copy(),
            gyro=whole.gyro[gyro_used].copy(),
            pose_time=whole.pose_time[poses_used].copy(),
            pose=np.ascontiguousarray(whole.pose[poses_used]),
            pose_use=_beginning_again(whole.pose_use, poses_used),
            given=given,
        ),
        wheel_doubt=segment.wheel_doubt[wheels_used],
        rolled=rolled,
    )


def _beginning_again(use: NDArray[np.uint8], used: slice) -> NDArray[np.uint8]:
    """Return the use of those poses that are used: if a dropped pose restarted the path, the next one does."""
    result = use[used].copy()
    begins = np.flatnonzero(use[: used.stop] == RESTART)
    result[np.minimum(-(-begins // used.step), len(result) - 1)] = RESTART
    return result

"""Long drives say more than is needed: of their readings only so many are used.

Of a motion that changes within tenths of a second, 50 readings a second say nearly as much as 100: the parameters
of two minutes are as sure to a few percent, in half the time. Beyond that, memory sets the limit.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from cmr.estimation.segments import Segment
from cmr.model.observer import RESTART

ENOUGH = 50_000  # readings, of two minutes at 100 Hz: of more, no sensor's need come faster than in USEFUL
# Of half an hour at 100 Hz; some 60 candidates are tested at once, with a few numbers for each reading.
MOST_READINGS = 650_000


class PerSensor(NamedTuple):
    """A number for each sensor: one of so many readings is used, or readings a second [Hz]."""

    wheels: int
    gyro: int
    poses: int


ALL = PerSensor(1, 1, 1)
USEFUL = PerSensor(50, 50, 25)  # Hz
NUMBERS = PerSensor(2, 1, 3)  # that each reading tells


def share_used(segments: Sequence[Segment]) -> PerSensor:
    """Return of how many readings of each sensor one is to be used."""
    observations = [segment.observations for segment in segments]
    seconds = sum(one.seconds for one in observations)
    counts = [
        sum(map(len, times))
        for times in zip(*((one.wheel_time, one.gyro_time, one.pose_time) for one in observations), strict=True)
    ]
    readings = sum(number * count for number, count in zip(NUMBERS, counts, strict=True))
    if readings <= ENOUGH:
        return ALL
    # A rate that is a little under twice the useful one counts as twice.
    every = [max(1, round(count / seconds / rate)) for count, rate in zip(counts, USEFUL, strict=True)]
    left = sum(number * count / one for number, count, one in zip(NUMBERS, counts, every, strict=True))
    further = max(1, -(-int(left) // MOST_READINGS))
    return PerSensor(*(one * further for one in every))


def thinned(segment: Segment, every: PerSensor) -> Segment:
    """Return a segment with every so many-th reading of each sensor; where the path begins anew it still does."""
    if every == ALL:
        return segment
    observations = segment.observations
    pose_use = observations.pose_use[:: every.poses].copy()
    begins = np.flatnonzero(observations.pose_use == RESTART)
    pose_use[np.minimum(-(-begins // every.poses), len(pose_use) - 1)] = RESTART
    return replace(
        segment,
        observations=replace(
            observations,
            wheel_time=observations.wheel_time[:: every.wheels].copy(),
            wheel=np.ascontiguousarray(observations.wheel[:: every.wheels]),
            wheel_use=np.ascontiguousarray(observations.wheel_use[:: every.wheels]),
            gyro_time=observations.gyro_time[:: every.gyro].copy(),
            gyro=observations.gyro[:: every.gyro].copy(),
            pose_time=observations.pose_time[:: every.poses].copy(),
            pose=np.ascontiguousarray(observations.pose[:: every.poses]),
            pose_use=pose_use,
        ),
        wheel_doubt=segment.wheel_doubt[:: every.wheels],
    )

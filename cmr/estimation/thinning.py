"""Long drives say more than is needed: only so many of their readings are used that memory suffices."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from cmr.estimation.segments import Segment
from cmr.model.observer import RESTART

# Of half an hour at 100 Hz; some 60 candidates are tested at once, with a few numbers for each reading.
MOST_READINGS = 650_000


def share_used(segments: Sequence[Segment]) -> int:
    """Return of how many readings one is to be used, so that not more than MOST_READINGS are."""
    observations = [segment.observations for segment in segments]
    readings = sum(2 * len(one.wheel_time) + len(one.gyro_time) + 3 * len(one.pose_time) for one in observations)
    return max(1, -(-readings // MOST_READINGS))


def thinned(segment: Segment, every: int) -> Segment:
    """Return a segment with every so many-th reading of each sensor; where the path begins anew it still does."""
    if every == 1:
        return segment
    observations = segment.observations
    pose_use = observations.pose_use[::every].copy()
    begins = np.flatnonzero(observations.pose_use == RESTART)
    pose_use[np.minimum(-(-begins // every), len(pose_use) - 1)] = RESTART
    return replace(
        segment,
        observations=replace(
            observations,
            wheel_time=observations.wheel_time[::every].copy(),
            wheel=np.ascontiguousarray(observations.wheel[::every]),
            wheel_use=np.ascontiguousarray(observations.wheel_use[::every]),
            gyro_time=observations.gyro_time[::every].copy(),
            gyro=observations.gyro[::every].copy(),
            pose_time=observations.pose_time[::every].copy(),
            pose=np.ascontiguousarray(observations.pose[::every]),
            pose_use=pose_use,
        ),
        wheel_doubt=segment.wheel_doubt[::every],
    )

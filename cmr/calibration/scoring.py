"""Score parameters on other recordings than they were fitted to, by the errors of free runs.

Errors over a whole drive are what a user sees, but a single early rotation error affects everything after it. Errors at
the end of short pieces, each started at the measured pose, show the quality of the parameters. The pose of a robot at
rest is the mean of all measurements before it moves.
"""

from typing import NamedTuple

import numpy as np

from cmr.calibration.seen_path import seen_path
from cmr.calibration.segments import path_error, segments_of
from cmr.model.motion import wheel_speeds
from cmr.model.parameters import RobotParameters
from cmr.recordings.recording import Recording
from cmr.recordings.signal import SECONDS, Floats, hold

COMPLETE = 0.95  # share of its length required of a piece: the last pose is seldom exactly at the end


class EndErrors(NamedTuple):
    """Errors at the last pose of each of n pieces: `distance` [m] and `heading` [rad, signed], shape (n,)."""

    distance: Floats
    heading: Floats


def pieces(recording: Recording, seconds: float) -> list[Recording]:
    """Cut a recording into pieces of `seconds`, end to end from its first pose on; a shorter remainder is dropped."""
    if len(recording.poses) == 0:
        return []
    first, last = int(recording.poses.utime[0]), int(recording.poses.utime[-1])
    length = int(seconds / SECONDS)
    starts = range(first, last + 1, length)
    return [recording.between(a, a + length) for a in starts if last - a >= COMPLETE * length]


def end_errors(
    recordings: list[Recording], parameters: RobotParameters, *, by_wheels: bool = False, shortest: float = 0.0
) -> EndErrors:
    """Return the errors at the last pose of each recording, started at its measured pose.

    `by_wheels` follows the measured wheels instead of driving the commands. Recordings whose last pose is no more
    than `shortest` [s] after their beginning are left out, and so are those without a path.
    """
    distance, heading = [], []
    for recording in recordings:
        for segment in segments_of(recording):
            if (segment.utime[-1] - recording.poses.utime[0]) * SECONDS <= shortest:
                continue
            path = seen_path(segment, parameters, by_wheels=by_wheels)
            last = segment.at[-1]
            distance.append(np.hypot(path.x[last] - segment.x[-1], path.y[last] - segment.y[-1]))
            heading.append(path.theta[last] - segment.theta[-1])
    return EndErrors(np.array(distance), np.array(heading))


def path_rmse(recording: Recording, parameters: RobotParameters, *, by_wheels: bool = False) -> float:
    """Return the root mean square distance [m] between measured and simulated path, started at the measured pose."""
    segments = segments_of(recording)
    return path_error(segments, [seen_path(segment, parameters, by_wheels=by_wheels) for segment in segments])


def wheel_speed_errors(recording: Recording, parameters: RobotParameters, side: str) -> Floats:
    """Return simulated minus measured wheel speed [rad/s] of a side ("left", "right"), shape (len(wheels) - 1,).

    The model starts at the first measured speed and then runs freely on the recorded commands.
    """
    wheels = recording.wheels
    duty = recording.duty.between(int(wheels.utime[0]), int(wheels.utime[-1]))
    times = np.union1d(duty.utime, wheels.utime)
    measured = wheels[f"psi_{side}"]
    speeds = wheel_speeds(hold(duty, side, times[:-1]), np.diff(times) * SECONDS, parameters, measured[0])
    return np.asarray((speeds[np.searchsorted(times, wheels.utime)] - measured)[1:])


def root_mean_square(values: Floats) -> float:
    """Return the root of the mean of the squares."""
    return float(np.sqrt(np.mean(np.square(values))))

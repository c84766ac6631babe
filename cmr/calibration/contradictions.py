"""Detect contradictions between wheels and poses, which indicate a wrong wheel radius or tick count."""

import math
from collections.abc import Sequence

import numpy as np

from cmr.calibration.segments import Segment
from cmr.recordings.signal import Floats

SMALLEST_RADIUS_ERROR = 0.02  # relative; a smaller contradiction may be slip
SHORTEST_WAY = 0.3  # m; root of the sum of squared distances per interval
INTERVAL = 0.5  # s; the path between two poses is not an arc over longer intervals, and noise dominates in shorter ones
RADIUS = (
    "The wheels turn {factor:.3f} times as far as the path says. Check wheel_radius ({fitting:.4g} m would fit instead "
    "of {radius:g} m) and the encoder's ticks per turn."
)


def radius_sentence(factor: float, radius: float) -> str:
    """Return a sentence: the wheels turn `factor` times as far as the path requires; `radius` [m] is the given one."""
    return RADIUS.format(factor=factor, fitting=radius / factor, radius=radius)


def wheels_against_poses(segments: Sequence[Segment], radius: float) -> float:
    """Return the ratio of the distances by wheels and by poses; NaN if unknown.

    Distances are per half second: pose noise adds little to them, and heading drift nothing. `radius` [m] is that of
    the wheels.
    """
    by_wheels, by_poses = 0.0, 0.0
    for segment in segments:
        if len(segment.angle_left):
            wheels, poses = _ways(segment)
            by_wheels += radius**2 * float(np.sum(wheels**2))
            by_poses += float(np.sum(poses**2))
    return math.sqrt(by_wheels / by_poses) if by_poses > SHORTEST_WAY**2 else math.nan


def _ways(segment: Segment) -> tuple[Floats, Floats]:
    """Return the wheel rotations [rad] and the distances by the poses [m] in each interval of a segment, (n,)."""
    times = segment.border_times[segment.at]
    borders = np.arange(times[0], times[-1], INTERVAL)
    angle = (segment.angle_left + segment.angle_right) / 2.0
    turned = np.diff(np.interp(borders, segment.border_times, angle))
    x, y, theta = (np.diff(np.interp(borders, times, one)) for one in (segment.x, segment.y, segment.theta))
    # Between two poses the robot went along an arc, not along its chord.
    return turned, np.hypot(x, y) / np.sinc(theta / (2.0 * np.pi))

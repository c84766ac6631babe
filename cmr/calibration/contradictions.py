"""Tell whether wheels and poses contradict each other: then the given wheel radius is wrong, or the ticks are."""

import math
from collections.abc import Sequence

import numpy as np

from cmr.calibration.segments import Segment
from cmr.recordings.signal import Floats

SMALLEST_RADIUS_ERROR = 0.02  # relative; a smaller contradiction of wheels and path may be slip
SHORTEST_WAY = 0.3  # m; root of the sum of squares of the ways of each interval
INTERVAL = 0.5  # s; over more, the path between two poses is no arc, over less their noise counts
RADIUS = (
    "The wheels turn {factor:.3f} times as far as the path says. Check wheel_radius ({fitting:.4g} m would fit instead "
    "of {radius:g} m) and the encoder's ticks per turn."
)


def radius_sentence(factor: float, radius: float) -> str:
    """Say that the wheels turn `factor` times as far as the path says; `radius` [m] is the given one of the wheels."""
    return RADIUS.format(factor=factor, fitting=radius / factor, radius=radius)


def wheels_against_poses(segments: Sequence[Segment], radius: float) -> float:
    """Return how many times as far as by the poses the robot went by its wheels; NaN where that is not known.

    Ways are those of each half second: noise of the poses adds little to them, and a heading that drifts nothing.
    `radius` [m] is that of the wheels.
    """
    by_wheels, by_poses = 0.0, 0.0
    for segment in segments:
        if len(segment.angle_left):
            wheels, poses = _ways(segment)
            by_wheels += radius**2 * float(np.sum(wheels**2))
            by_poses += float(np.sum(poses**2))
    return math.sqrt(by_wheels / by_poses) if by_poses > SHORTEST_WAY**2 else math.nan


def _ways(segment: Segment) -> tuple[Floats, Floats]:
    """Return the turns of the wheels [rad] and the ways by the poses [m] in each interval of a segment, (n,)."""
    times = segment.border_times[segment.at]
    borders = np.arange(times[0], times[-1], INTERVAL)
    angle = (segment.angle_left + segment.angle_right) / 2.0
    turned = np.diff(np.interp(borders, segment.border_times, angle))
    x, y, theta = (np.diff(np.interp(borders, times, one)) for one in (segment.x, segment.y, segment.theta))
    # Between two poses the robot went along an arc, not along its chord.
    return turned, np.hypot(x, y) / np.sinc(theta / (2.0 * np.pi))

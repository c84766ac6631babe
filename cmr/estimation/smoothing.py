"""Smooth measured poses: estimate the pose at a time from all measurements around it."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from cmr.estimation.prediction import FREE
from cmr.model.motion import RobotState, Trajectory, roll
from cmr.model.observer.drives import ends_of
from cmr.model.observer.observer import FOLLOWED, LONGEST_LATENCY, MOTION, RESTART, Observations, observe
from cmr.model.parameters import RobotParameters
from cmr.model.sensors import pose_seen
from cmr.recordings.signal import Floats

SMOOTHED = 0.3  # s before and after a pose that are averaged
AGO = np.arange(LONGEST_LATENCY, 0.0, -0.05)  # s; of poses before a segment's beginning
APART = 3.0 * LONGEST_LATENCY  # s between segments laid end to end
POSE = [MOTION.index(name) for name in ("x", "y", "theta")]

Indices = NDArray[np.int64]
Values = Mapping[str, float]


def smoothed_poses(observations: Sequence[Observations], values: Values) -> list[Floats]:
    """Return a smoothed pose for each measured one, from all within SMOOTHED of it, (P, 3) by segment.

    The motion between them is that of the wheels, or else of a free run, as the pose's sensor sees it with the effects
    that these values contain. Errors of that motion that grow with time cancel between before and after. Headings
    are unwrapped.
    """
    posed = [one for one in observations if len(one.pose)]
    if not posed:
        return [one.pose for one in observations]
    ends = ends_of([len(one.pose) for one in posed])
    moved = _motion(posed, values)
    theta = np.concatenate([np.unwrap(one.pose[:, 2]) for one in posed])
    first, last = (np.concatenate(rows) for rows in zip(*map(_neighbours, posed, ends[:-1].tolist()), strict=True))
    turn = _means((theta - moved[:, 2])[:, None], first, last)[:, 0]
    middle = _means(np.column_stack([np.concatenate([one.pose[:, :2] for one in posed]), moved[:, :2]]), first, last)
    behind = moved[:, :2] - middle[:, 2:]
    cosine, sine = np.cos(turn), np.sin(turn)
    x = middle[:, 0] + cosine * behind[:, 0] - sine * behind[:, 1]
    y = middle[:, 1] + sine * behind[:, 0] + cosine * behind[:, 1]
    smooth = iter(np.split(np.column_stack([x, y, moved[:, 2] + turn]), ends[1:-1]))
    return [next(smooth) if len(one.pose) else one.pose for one in observations]


def _motion(observations: Sequence[Observations], values: Values) -> Floats:
    """Return the poses that the sensor would measure on the wheels' motion, or else on a free run, (P, 3) of all.

    The path of each segment starts at its first pose and drifts from there.
    """
    parameters = RobotParameters.of(values)
    rolling = all(len(one.wheel) > 1 for one in observations)
    paths = _rolled(observations, parameters) if rolling else [_driven(one, values) for one in observations]
    steps = (np.arange(one.steps + 1, dtype=np.float64) * one.dt for one in observations)
    times = [one.wheel_time for one in observations] if rolling else list(steps)
    # Segments are laid end to end, with gaps that keep their times apart.
    lengths = [one.seconds + APART for one in observations]
    place = observations[0].time + np.cumsum([0.0, *lengths[:-1]])
    axis = [at + part for at, time in zip(place, times, strict=True) for part in (time[0] - AGO, time)]
    rows = [
        part for one, path in zip(observations, paths, strict=True) for part in (_past(one, path, parameters), path)
    ]
    poses = [len(one.pose) for one in observations]
    first, last = (np.repeat(place + [time[end] for time in times], poses) for end in (0, -1))
    began = np.repeat([one.time for one in observations], poses)
    moved = np.repeat(place, poses) - began
    path = np.concatenate(rows)
    seen = pose_seen(
        np.concatenate(axis),
        Trajectory(*path.T, *[np.full(len(path), np.nan)] * 4),
        parameters,
        began + np.concatenate([one.pose_time for one in observations]),
        lambda moment: np.clip(moment + moved, first - LONGEST_LATENCY, last),
    )
    return np.column_stack(seen)


def _rolled(observations: Sequence[Observations], parameters: RobotParameters) -> list[Floats]:
    """Return the path of the wheels of each segment, (n, 3): x, y, theta, from its first pose on."""
    ends = ends_of([len(one.wheel) for one in observations])
    left, right = np.concatenate([one.wheel for one in observations]).T
    x, y, theta = roll(left, right, parameters, RobotState.at_rest(*observations[0].pose[0]))[:3]
    if len(observations) == 1:
        return [np.column_stack([x, y, theta])]
    # Rolled in one go, each begins where the one before ended.
    begin, number = ends[:-1], np.repeat(np.arange(len(observations)), np.diff(ends))
    to_x, to_y, to_theta = np.array([one.pose[0] for one in observations]).T
    turn = (to_theta - theta[begin])[number]
    cosine, sine, x, y = np.cos(turn), np.sin(turn), x - x[begin][number], y - y[begin][number]
    moved = [to_x[number] + cosine * x - sine * y, to_y[number] + sine * x + cosine * y, theta + turn]
    return np.split(np.column_stack(moved), begin[1:])


def _driven(observations: Observations, values: Values) -> Floats:
    """Return the path of a free run, (n, 3): x, y, theta, from the first pose on."""
    unbroken = replace(observations, pose_use=np.full_like(observations.pose_use, FOLLOWED))
    return observe(unbroken, dict(values), FREE).motion[:, POSE]


def _past(observations: Observations, path: Floats, parameters: RobotParameters) -> Floats:
    """Extrapolate a path (n, 3) backwards with the first wheel speeds: the poses AGO [s] before, shape (AGO, 3).

    The first poses of a delayed sensor show the robot before the recording begins.
    """
    x, y, theta = path[0]
    left, right = (parameters.wheel_radius * psi for psi in observations.start[3:])
    turned = AGO * (right - left) / parameters.base_width
    rolled, along = 0.5 * AGO * (left + right), theta - 0.5 * turned
    return np.column_stack([x - rolled * np.cos(along), y - rolled * np.sin(along), theta - turned])


def _neighbours(observations: Observations, before: int) -> tuple[Indices, Indices]:
    """Return the numbers of the first and the last pose near each, (P,), (P,), `before` of which are those of others.

    None cross a restart of the path.
    """
    time = observations.pose_time
    restarts = np.flatnonzero(observations.pose_use == RESTART)
    part = np.searchsorted(restarts, np.arange(len(time)), side="right")
    borders = np.concatenate([[0], restarts, [len(time)]])
    first = np.maximum(np.searchsorted(time, time - SMOOTHED), borders[part])
    last = np.minimum(np.searchsorted(time, time + SMOOTHED, side="right"), borders[part + 1]) - 1
    return before + first, before + last


def _means(values: Floats, first: Indices, last: Indices) -> Floats:
    """Return the means of the rows from first to last, both included; shape (n, columns)."""
    total = np.concatenate([np.zeros((1, values.shape[1])), np.cumsum(values, axis=0)])
    return np.asarray((total[last + 1] - total[first]) / (last + 1 - first)[:, None])

"""Find impossible poses: outliers, jumps of the tracker, poses held while the robot moved.

The motion from wheels or gyro is first subtracted from the path. The residual of a valid path is slow: slip, drift,
wrong wheel sizes. Outliers stand out of it, jumps are steps in it. The scale of the wheels' motion is estimated from
the same data, so no parameters are needed. Without a motion sensor, the path's own median rates are used.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cmr.recordings.faults.held_poses import held_poses
from cmr.recordings.faults.path import Path
from cmr.recordings.recording import Recording
from cmr.recordings.robust import local_noise, running_median, spread, wrapped
from cmr.recordings.signal import Floats, Mask

OUTLYING = 5.0  # standard deviations at least by which an outlier stands off
BY_CHANCE = 1e-4  # share of recordings in which a normal pose is called an outlier
JUMPING = 7.0  # standard deviations; a jump splits a path, so it must be significant
STEP_HALVES = (1, 4)  # values before and after a step are medians of twice this and one
LEAST_POSITION, LEAST_HEADING = 0.001, 0.002  # m, rad; noise below this is taken to be this
LONGEST_GAP = 1.0  # s; jumps are not searched across a longer gap in the poses
LONGEST_BURST = 3.0  # s; a path with two jumps within this time was wrong in between
COMES_BACK = 0.3  # of the first jump; tolerance for a return
PASSES = 3  # faults hide some of their neighbours, which are checked again without them
FEWEST = 11  # poses; fewer have too few neighbours


@dataclass(frozen=True)
class PathFaults:
    """What is wrong with poses; masks of shape (n,).

    `held` repeat the previous pose although the robot moved, `outliers` deviate from their neighbours, `jumps` are the
    first poses after the tracker jumped. `position_noise` [m] and `heading_noise` [rad] are the standard deviations of
    what is left.
    """

    held: Mask
    outliers: Mask
    jumps: Mask
    position_noise: float = 0.0
    heading_noise: float = 0.0


def path_faults(recording: Recording, pose_lag: float = 0.0, gyro_lag: float = 0.0) -> PathFaults:
    """Find what is wrong with the poses.

    `pose_lag`, `gyro_lag` [s] are how much later they are stamped than the wheels.
    """
    poses = recording.poses
    held = held_poses(recording, pose_lag)
    used, jumps = ~held, np.zeros(len(poses), np.bool_)
    for _ in range(PASSES):
        index = np.flatnonzero(used)
        if len(index) < FEWEST:
            return PathFaults(held, ~used & ~held, jumps)
        path = Path.of(recording, poses.where(used), pose_lag, gyro_lag)
        wrong, before = _faults(path)
        used[index[wrong]] = False
        if not wrong.any():
            break
    left = index[~wrong]
    jumps[left[np.searchsorted(left, index[before], side="right")]] = True
    off, off_heading = path.off[~wrong], path.off_heading[~wrong]
    return PathFaults(held, ~used & ~held, jumps, spread(np.append(off.real, off.imag)), spread(off_heading))


def _faults(path: Path) -> tuple[Mask, NDArray[np.int64]]:
    """Return which poses are wrong, shape (n,), and the indices of those after which the tracker jumps."""
    wrong = outlying(path)
    good = np.flatnonzero(~wrong)
    if len(good) < FEWEST:
        return wrong, np.empty(0, np.int64)
    rest = path.at(good)
    burst, before = bursts_of(rest, jumps_of(rest))
    wrong[good[burst]] = True
    return wrong, good[before]


def outlying(path: Path) -> Mask:
    """Return which poses deviate from their neighbours by more than noise, shape (n,)."""
    size, size_heading = np.abs(path.off), np.abs(wrapped(path.off_heading))
    noise = np.maximum(local_noise(size, 2), LEAST_POSITION)
    noise_heading = np.maximum(local_noise(size_heading, 1), LEAST_HEADING)
    # For normal noise in the plane, the share exp(-z^2 / 2) exceeds z standard deviations.
    outlying = max(OUTLYING, float(np.sqrt(2.0 * np.log(len(size) / BY_CHANCE))))
    allowed = np.hypot(outlying * noise, path.doubt)
    allowed_heading = np.hypot(outlying * noise_heading, path.doubt_heading)
    return np.asarray((size > allowed) | (size_heading > allowed_heading))


def jumps_of(path: Path) -> NDArray[np.int64]:
    """Return the indices of the poses after which the path jumps; it is free of outliers, shape (k,)."""
    excess = np.zeros(len(path.time) - 1)
    for half in STEP_HALVES:
        if len(path.time) > 4 * half + 2:
            excess[half : len(excess) - half] = np.maximum(excess[half : len(excess) - half], _excess(path, half))
    candidates = np.flatnonzero(excess > 1.0)
    if not len(candidates):
        return candidates
    groups = np.split(candidates, np.flatnonzero(np.diff(candidates) > 1) + 1)
    step = np.abs(np.diff(path.place)) / LEAST_POSITION + np.abs(wrapped(np.diff(path.heading))) / LEAST_HEADING
    return np.array([group[np.argmax(step[group])] for group in groups], np.int64)


def _excess(path: Path, half: int) -> Floats:
    """Return the steps of the path between neighbours relative to their limits, shape (n - 1 - 2 half,)."""
    first, last = slice(0, len(path.time) - 1 - 2 * half), slice(1 + 2 * half, None)

    def across(values: NDArray[np.float64]) -> Floats:
        smooth = running_median(values, half, path.run)
        return np.asarray(smooth[last] - smooth[first])

    size = np.hypot(across(path.place.real), across(path.place.imag))
    size_heading = np.abs(wrapped(across(path.heading)))
    noise = np.maximum(local_noise(size, 2), LEAST_POSITION)
    noise_heading = np.maximum(local_noise(size_heading, 1), LEAST_HEADING)
    # Slipping wheels turn further than the robot moves: the motion from them may be wrong by all of it, not more.
    slip, slip_heading = path.slip[last] - path.slip[first], path.slip_heading[last] - path.slip_heading[first]
    doubt, doubt_heading = (values[last] + values[first] for values in (path.doubt, path.doubt_heading))
    share = size / (np.hypot(JUMPING * noise, doubt) + slip)
    share = np.maximum(share, size_heading / (np.hypot(JUMPING * noise_heading, doubt_heading) + slip_heading))
    time = path.time[last] - path.time[first]
    usual = (2 * half + 1) * float(np.median(np.diff(path.time)))
    # All values of both medians are in one run; beyond its ends they would be mirrored.
    first_run, last_run = (np.roll(path.run, by)[part] for by, part in ((half, first), (-half, last)))
    together = (first_run == last_run) & (np.arange(len(time)) >= half) & (np.arange(len(time)) < len(time) - half)
    return np.where((time < usual + LONGEST_GAP) & together, share, 0.0)


def bursts_of(path: Path, before: NDArray[np.int64]) -> tuple[Mask, NDArray[np.int64]]:
    """Return poses between jumps in quick succession, shape (n,), and the remaining jumps.

    A jump that is undone is not a jump. With several, the tracker was lost from the first to the last.
    """
    burst = np.zeros(len(path.time), np.bool_)
    staying: list[int] = []
    jumps = before.tolist()
    while jumps:
        there = jumps.pop(0)
        soon = [
            jump
            for jump in jumps
            if path.time[jump] - path.time[there] <= LONGEST_BURST and path.run[jump] == path.run[there]
        ]
        back = next((jump for jump in soon if _comes_back(path, there, jump)), None)
        if back is not None:
            burst[there + 1 : back + 1] = True
            jumps = [jump for jump in jumps if jump > back]
        elif soon:
            burst[there + 1 : soon[0] + 1] = True
        else:
            staying.append(there)
    return burst, np.array(staying, np.int64)


def _comes_back(path: Path, there: int, back: int) -> bool:
    """Return whether the jump after pose `back` undoes the one after pose `there`."""
    half = max(STEP_HALVES)

    def middle(values: Floats, around: slice) -> float:
        return float(np.median(values[around]))

    first, end = np.searchsorted(path.run, path.run[there] + np.array([0, 1])).tolist()
    before, away = slice(max(there - half, first), there + 1), slice(there + 1, min(there + 1 + half, back + 1))
    after = slice(back + 1, min(back + 2 + half, end))
    x, y, heading = path.place.real, path.place.imag, path.heading
    jump, rest = (
        np.hypot(middle(x, part) - middle(x, before), middle(y, part) - middle(y, before)) for part in (away, after)
    )
    turn, turn_rest = (
        abs(float(wrapped(np.array(middle(heading, part) - middle(heading, before))))) for part in (away, after)
    )
    # A path that was rotated in between continues elsewhere.
    led = float(path.slip[back] - path.slip[there]) * min(turn, 1.0)
    return bool(
        rest <= COMES_BACK * jump + led + JUMPING * LEAST_POSITION
        and turn_rest <= COMES_BACK * turn + JUMPING * LEAST_HEADING
    )

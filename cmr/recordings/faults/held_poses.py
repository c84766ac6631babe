"""Find poses that repeat the previous one while the robot moves, because the tracker has lost it.

A tracker that rounds its output may repeat the same numbers for a slow robot by chance. Such a pose is valid. How often
that happens depends on its rounding and noise.
"""

import numpy as np
from numpy.typing import NDArray

from cmr.recordings.lags import response_to_commands
from cmr.recordings.pieces import Pieces
from cmr.recordings.recording import Recording
from cmr.recordings.robust import TO_DEVIATION, quantile, ratio, wrapped
from cmr.recordings.signal import SECONDS, Floats, Mask, Signal, Times

CREEPING = 0.5  # of the distance between two poses; a robot that moved less may be at the same position
BY_CHANCE = 1e-4  # share of recordings in which a valid repeated pose is called held
COMPARED = 0.5  # s over which the distances by poses and wheels are compared
SECOND_DIFFERENCE = 6.0**0.5  # standard deviation of a second difference of white noise, in those of the noise
ROUNDED = 12.0**-0.5  # standard deviation of rounding errors, as a share of the step
REPEATING = (4.0 * np.pi) ** -0.5  # density of the difference of two values of unit normal noise, at 0


def held_poses(recording: Recording, pose_lag: float = 0.0) -> Mask:
    """Return which poses repeat the previous one although wheels turn, or (without wheel data) are commanded to, (n,).

    `pose_lag` [s] is how much later poses are stamped than the wheels.
    """
    poses = recording.poses
    same = np.append(False, np.all([values[1:] == values[:-1] for values in poses.fields.values()], axis=0))[
        : len(poses)
    ]
    same &= ~recording.pieces.borders(poses.utime)  # a tracker may start each piece where it started the previous one
    if not same.any():
        return same
    # A robot follows its commands sooner or later than on average: it certainly moved if it did so either way.
    response = 0.0 if len(recording.wheels) else response_to_commands(pose_lag)
    held = same
    for lag in {pose_lag - response, pose_lag, pose_lag + response}:
        held = held & _moved_on(recording, ~same, _ways(recording, poses.utime - round(lag / SECONDS)))
    return held


def _moved_on(recording: Recording, new: Mask, ways: tuple[Floats, Floats] | None) -> Mask:
    """Return at which poses the robot has certainly moved since the last `new` one, each of shape (n,)."""
    if ways is None:
        return np.zeros(len(new), np.bool_)
    first = np.maximum.accumulate(np.where(new, np.arange(len(new)), 0))
    wheels = ways[0] + ways[1]
    steps = np.diff(wheels, prepend=wheels[:1])
    usual = steps[new & (steps > 0.0)]
    least = CREEPING * float(np.median(usual)) if len(usual) else 0.0
    by_chance = _chance(recording.poses, recording.pieces, new, ways, first) * len(new) < BY_CHANCE
    return np.asarray((wheels - wheels[first] > least) & by_chance)


def _ways(recording: Recording, utime: Times) -> tuple[Floats, Floats] | None:
    """Return the total distance driven and rotation at each time, in units of the wheels.

    None if they are unknown.
    """
    if len(recording.wheels):
        signal, names = recording.wheels, ("psi_left", "psi_right")
    elif len(recording.commands):
        signal, names = recording.commands, ("left", "right")
    else:
        return None
    dt = np.diff(recording.pieces.seconds(signal.utime), prepend=0.0)
    left, right = (signal[name] for name in names)
    driven, turned = (np.interp(utime, signal.utime, np.cumsum(np.abs(of) * dt)) for of in (right + left, right - left))
    return driven, turned


def _chance(poses: Signal, pieces: Pieces, new: Mask, ways: tuple[Floats, Floats], first: NDArray[np.int64]) -> Floats:
    """Return the probability that each pose, if valid, repeats the one numbered `first` by chance, shape (n,).

    `new` marks the poses that do not repeat the one before; `ways` are the distance driven and the rotation.
    """
    x, y, theta = (poses[name] for name in ("x", "y", "theta"))
    theta = theta[0] + np.append(0.0, np.cumsum(wrapped(np.diff(theta))))
    chance = np.ones(len(poses))
    for parts, way in (((x, y), ways[0]), ((theta,), ways[1])):
        steps = [_rounding(values) for values in parts]
        noises = [_noise(values[new]) for values in parts]
        noise = max(*noises, *(ROUNDED * step for step in steps))
        if not noise > 0.0:
            continue
        moved = _scale(parts, poses.utime, pieces, way) * (way - way[first])
        # Values rounded to the same number may differ by a step in each direction.
        beyond = np.maximum(moved - float(np.linalg.norm(steps)), 0.0) / noise
        for step in steps:
            chance *= min(REPEATING * step / noise, 1.0)
        chance *= np.exp(-0.25 * beyond**2)
    return chance


def _rounding(values: Floats) -> float:
    """Return the step to which values are rounded: the smallest difference of consecutive values."""
    steps = np.abs(np.diff(values))
    return float(np.min(steps[steps > 0.0], initial=np.inf)) if np.any(steps > 0.0) else 0.0


def _noise(values: Floats) -> float:
    """Return the standard deviation of white noise in values of a smooth path."""
    bends = np.abs(np.diff(values, 2))
    return TO_DEVIATION * quantile(bends, 0.5) / SECOND_DIFFERENCE


def _scale(parts: tuple[Floats, ...], utime: Times, pieces: Pieces, way: Floats) -> float:
    """Return the path length, in these parts of the pose together, per unit of the wheels' distance."""
    period = float(np.median(np.diff(utime))) * SECONDS
    width = int(np.clip(round(COMPARED / period), 1, len(utime) - 1))
    number = pieces.number(utime)
    together = number[width:] == number[:-width]
    seen = np.sqrt(sum((values[width:] - values[:-width]) ** 2 for values in parts))
    return ratio(np.where(together, seen, 0.0), np.where(together, way[width:] - way[:-width], 0.0))

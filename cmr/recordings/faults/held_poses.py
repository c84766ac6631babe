"""Find poses that only repeat the one before while the robot moves: the tracker has not seen the robot again.

A tracker that rounds what it says may by chance say the same numbers twice of a robot that moves slowly. Such a pose is
a true one. How often that happens follows from how coarsely it rounds, and how much it scatters.
"""

import numpy as np
from numpy.typing import NDArray

from cmr.recordings.lags import response_to_commands
from cmr.recordings.pieces import Pieces
from cmr.recordings.recording import Recording
from cmr.recordings.robust import TO_DEVIATION, quantile, ratio, wrapped
from cmr.recordings.signal import SECONDS, Floats, Mask, Signal, Times

CREEPING = 0.5  # of the way between two poses; a robot that went less far may stand in the same place
BY_CHANCE = 1e-4  # of recordings in which a true pose repeats the one before and is called held
COMPARED = 0.5  # s over which poses and wheels tell how far the robot went
SECOND_DIFFERENCE = 6.0**0.5  # standard deviation of a second difference of white noise, in those of the noise
ROUNDED = 12.0**-0.5  # standard deviation of what is rounded off, of the size of the step
REPEATING = (4.0 * np.pi) ** -0.5  # density of the difference of two values of unit normal noise, at 0


def held_poses(recording: Recording, pose_lag: float = 0.0) -> Mask:
    """Tell which poses repeat the one before though wheels turn, or are commanded to where none were recorded, (n,).

    `pose_lag` [s] is by how much poses are stamped later than the wheels.
    """
    poses = recording.poses
    same = np.append(False, np.all([values[1:] == values[:-1] for values in poses.fields.values()], axis=0))[
        : len(poses)
    ]
    same &= ~recording.pieces.borders(poses.utime)  # a tracker may begin each piece where it began the one before
    if not same.any():
        return same
    # A robot follows its commands sooner or later than on average: it moved for sure if it did so either way.
    response = 0.0 if len(recording.wheels) else response_to_commands(pose_lag)
    held = same
    for lag in {pose_lag - response, pose_lag, pose_lag + response}:
        held = held & _moved_on(recording, ~same, _ways(recording, poses.utime - round(lag / SECONDS)))
    return held


def _moved_on(recording: Recording, new: Mask, ways: tuple[Floats, Floats] | None) -> Mask:
    """Tell at which poses the robot is surely elsewhere than at the last `new` one, each of shape (n,)."""
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
    """Return how far the robot has driven and turned at each time, both ways counted up, in units of the wheels.

    None where nothing tells it.
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
    """Return how likely each pose, if it is true, repeats the one numbered `first` by chance, shape (n,).

    `new` marks the poses that do not repeat the one before; `ways` are how far the robot has driven and turned.
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
        # What is rounded to the same may be a step apart in each direction.
        beyond = np.maximum(moved - float(np.linalg.norm(steps)), 0.0) / noise
        for step in steps:
            chance *= min(REPEATING * step / noise, 1.0)
        chance *= np.exp(-0.25 * beyond**2)
    return chance


def _rounding(values: Floats) -> float:
    """Return the step to which values are rounded: the smallest difference between two that follow one another."""
    steps = np.abs(np.diff(values))
    return float(np.min(steps[steps > 0.0], initial=np.inf)) if np.any(steps > 0.0) else 0.0


def _noise(values: Floats) -> float:
    """Return the standard deviation of white noise in values of a smooth path."""
    bends = np.abs(np.diff(values, 2))
    return TO_DEVIATION * quantile(bends, 0.5) / SECOND_DIFFERENCE


def _scale(parts: tuple[Floats, ...], utime: Times, pieces: Pieces, way: Floats) -> float:
    """Return how far the path leads, in these parts of the pose together, for each unit of the wheels' way."""
    period = float(np.median(np.diff(utime))) * SECONDS
    width = int(np.clip(round(COMPARED / period), 1, len(utime) - 1))
    number = pieces.number(utime)
    together = number[width:] == number[:-width]
    seen = np.sqrt(sum((values[width:] - values[:-width]) ** 2 for values in parts))
    return ratio(np.where(together, seen, 0.0), np.where(together, way[width:] - way[:-width], 0.0))

"""The distance driven and the rotation from one sensor, in that sensor's own unit."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cmr.recordings.pieces import Pieces
from cmr.recordings.recording import Recording
from cmr.recordings.robust import running_median
from cmr.recordings.signal import SECONDS, Floats, Signal
from cmr.recordings.wheel_angles import wheel_angles

LONGEST_GAP = 1.0  # s; over a longer one the motion is unknown


@dataclass(frozen=True)
class Travel:
    """Distance driven and rotation since the start, in any unit, from one sensor; shape (n,).

    A gyro does not measure `driven`: None. `time` [s] counts from an origin. `run` numbers the stretches between pauses
    and gaps: motion between them is unknown, and counts as zero.
    """

    time: Floats
    driven: Floats | None
    turned: Floats
    run: NDArray[np.int64]


def travel_of(recording: Recording, sensor: str, origin: int) -> Travel:
    """Return the travel from a signal of the recording: "wheels", "commands", "gyro" or "poses".

    `origin` [us] is the origin of its time.
    """
    signal, pieces = recording.signals[sensor], recording.pieces
    make = {"wheels": _by_wheels, "commands": _by_commands, "gyro": _by_gyro, "poses": _by_poses}[sensor]
    time = np.asarray((signal.utime - origin) * SECONDS, np.float64)
    run = _runs(signal, pieces)
    dt = np.where(np.diff(run) == 0, np.diff(time), 0.0)
    driven, turned = make(signal, dt, run)
    return Travel(time, None if driven is None else _summed(driven), _summed(turned), run)


def _runs(signal: Signal, pieces: Pieces) -> NDArray[np.int64]:
    """Number the stretches of a signal without a pause or a long gap, shape (n,)."""
    breaks = pieces.borders(signal.utime)
    breaks[1:] |= np.diff(signal.utime) > LONGEST_GAP / SECONDS
    return np.cumsum(breaks)


def _by_wheels(wheels: Signal, dt: Floats, _run: NDArray[np.int64]) -> tuple[Floats, Floats]:
    left, right = (np.where(dt > 0.0, np.diff(angle), 0.0) for angle in wheel_angles(wheels))
    return left + right, right - left


def _by_commands(commands: Signal, dt: Floats, _run: NDArray[np.int64]) -> tuple[Floats, Floats]:
    """Integrate duties, each of which holds until the next."""
    left, right = commands["left"][:-1], commands["right"][:-1]
    return (left + right) * dt, (right - left) * dt


def _by_gyro(gyro: Signal, dt: Floats, _run: NDArray[np.int64]) -> tuple[None, Floats]:
    rate = gyro["yaw_rate"]
    return None, 0.5 * (rate[1:] + rate[:-1]) * dt


def _by_poses(poses: Signal, dt: Floats, run: NDArray[np.int64]) -> tuple[Floats, Floats]:
    """Integrate along the measured path, forward along the heading."""
    theta = running_median(np.unwrap(poses["theta"]), 2, run)
    x, y = (running_median(poses[name], 2, run) for name in ("x", "y"))
    middle = 0.5 * (theta[1:] + theta[:-1])
    driven = np.diff(x) * np.cos(middle) + np.diff(y) * np.sin(middle)
    together = dt > 0.0
    return np.where(together, driven, 0.0), np.where(together, np.diff(theta), 0.0)


def _summed(steps: Floats) -> Floats:
    return np.append(0.0, np.cumsum(steps))

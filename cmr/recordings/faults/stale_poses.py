"""Find first poses of pieces that were measured before the piece began.

If a table of rows is cut into pieces, the first row of each has the pose that was held there, measured before the piece
began. From that pose to the second the robot appears to move further than possible in the time between. This is visible
in pieces that begin at a steady speed, whatever the latency of the localisation, and also if it is reset to zero there.
"""

from collections.abc import Iterator
from itertools import pairwise

import numpy as np

from cmr.recordings.faults.findings import Finding, counted
from cmr.recordings.recording import Recording
from cmr.recordings.signal import SECONDS, Floats, Signal

LEVER = 0.3  # m of lever arm that converts rotation to distance
LATER = 0.6  # s after the second pose used to measure the robot's speed
FEWEST_POSES = 4  # poses of a piece needed to determine the speed after the second
STEADY = 0.15  # of the faster wheel's speed; largest change over that time
FEWEST_PIECES = 8  # pieces that begin at a steady speed; fewer are not sufficient
SURE = 4.0  # standard deviations by which first poses must be older than second ones
LEAST_AGE = 0.01  # s; a smaller age does no harm
CUT = 0.1  # share trimmed at either end of the ages before averaging
CUT_STD = 1.5  # standard deviation of the trimmed values of normal noise is multiplied by this


def stale_poses(recording: Recording) -> Finding:
    """Find stale first poses of pieces, and exclude them in all pieces."""
    poses = recording.poses
    first = recording.pieces.borders(poses.utime)
    first[:1] = True
    ages = np.array([_ages(path) for path in _steady_beginnings(recording, np.flatnonzero(first))]).reshape(-1, 2)
    age = _common_age(ages[np.isfinite(ages).all(axis=1)])
    found = int(np.count_nonzero(first)) if age > 0.0 else 0
    return Finding(
        "stale_poses",
        found,
        f"The first pose of a piece was measured before the piece began, on average by {age:.2f} s: "
        f"{counted(found, 'pose')} set aside. An import with first_of_piece: left_out leaves them out.",
        {"poses": first} if found else {},
    )


def _steady_beginnings(recording: Recording, starts: np.typing.NDArray[np.int64]) -> Iterator[Signal]:
    """Yield the poses at the beginning of each piece in which the wheels turn at nearly constant speed.

    `starts` are the indices of their first poses.
    """
    poses, wheels = recording.poses, recording.wheels
    for begin, end in pairwise([*starts.tolist(), len(poses)]):
        utime = poses.utime[begin:end]
        count = int(np.searchsorted(utime, utime[1] + LATER / SECONDS, side="right")) if len(utime) > 1 else 0
        if count < FEWEST_POSES:
            continue
        at = slice(*np.searchsorted(wheels.utime, [utime[0], utime[count - 1] + 1]))
        speeds = np.stack([wheels["psi_left"][at], wheels["psi_right"][at]])
        fastest = float(np.abs(speeds).max(initial=0.0))
        if speeds.shape[1] > 1 and fastest > 0.0 and float(np.ptp(speeds, axis=1).max()) < STEADY * fastest:
            fields = {name: poses[name][begin : begin + count] for name in ("x", "y", "theta")}
            yield Signal(utime[:count], fields)


def _ages(path: Signal) -> tuple[float, float]:
    """Return by how much [s] the first and the second pose are older than their stamps say, by those after them."""
    time, theta = path.seconds, np.unwrap(path["theta"])
    place = path["x"] + 1j * path["y"]
    return _age(time, place, theta), _age(time[1:], place[1:], theta[1:])


def _age(time: Floats, place: np.typing.NDArray[np.complex128], theta: Floats) -> float:
    """Return the age [s] of the first pose: on the circle given by the others, at their speed."""
    seconds = float(time[-1] - time[1])
    omega = float(theta[-1] - theta[1]) / seconds
    arc = 1.0 / np.sinc(0.5 * omega * seconds / np.pi)  # per chord
    back = 0.5 * omega * float(time[-1] - time[0])  # from the middle of the others to that of the first interval
    velocity = (place[-1] - place[1]) / seconds * arc * np.exp(-1j * back)
    step, turn = place[1] - place[0], float(theta[1] - theta[0])
    along = (np.conj(velocity) * step).real + LEVER**2 * omega * turn
    squared = abs(velocity) ** 2 + (LEVER * omega) ** 2
    return float(along / squared - (time[1] - time[0])) if squared > 0.0 else np.nan


def _common_age(ages: Floats) -> float:
    """Return the mean excess age [s] of first poses, from ages (k, 2); 0 if not significant.

    Second poses are not stale. If they seem to be, the speed changed before the pieces began, and poses are late.
    """
    if len(ages) < FEWEST_PIECES:
        return 0.0
    cut = int(CUT * len(ages))
    kept = np.sort(ages, axis=0)[cut : len(ages) - cut]
    first, second = kept.mean(axis=0)
    std = float(np.hypot(*kept.std(axis=0))) * CUT_STD / len(kept) ** 0.5
    excess = float(first - max(second, 0.0))
    return float(first) if excess > max(LEAST_AGE, SURE * std) else 0.0

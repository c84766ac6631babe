"""Find headings that the tracker rotated relative to the robot: after a jump, they no longer match its motion.

A tracker that restarts in another frame rotates path and headings alike, so a cut suffices. If the tracked body was
moved on the robot, or recognised wrongly, the headings change relative to the motion. The robot would then appear to be
a different one, so such poses are excluded.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cmr.recordings.faults.findings import Finding, counted
from cmr.recordings.faults.path_faults import PathFaults
from cmr.recordings.recording import Recording
from cmr.recordings.robust import spread, wrapped
from cmr.recordings.signal import SECONDS, Floats, Mask
from cmr.recordings.travel import travel_of

WINDOW = 0.5  # s over which the robot's motion is compared with its heading
TURNED = 0.1  # rad; smaller differences may be due to slip
SURE = 7.0  # standard deviations by which they must differ
SHORTEST_WAY = 0.5  # m of a part's path required to judge it
OUTLYING = 4.0  # standard deviations; windows further off, with wheel slip, are not used
FEWEST = 20  # windows


@dataclass(frozen=True)
class Ways:
    """The motion in windows of time, shape (n,), and the `part` between two jumps that each belongs to.

    `moved` [m, complex: ahead + i to the left of the heading], `driven` by the wheels, in their unit, `turned` [rad].
    """

    part: NDArray[np.int64]
    moved: NDArray[np.complex128]
    driven: Floats
    turned: Floats


def turned_headings(recording: Recording, faults: PathFaults, pose_lag: float) -> Finding:
    """Find poses between jumps whose headings do not match the motion, compared with other parts.

    `pose_lag` [s] is how much later poses are stamped than the wheels.
    """
    part = np.cumsum(faults.jumps, dtype=np.int64)
    wrong = np.zeros(len(part), np.bool_)
    largest = 0.0
    if faults.jumps.any():
        angles = _angles(_ways(recording, part, ~(faults.outliers | faults.held), pose_lag))
        straightest = min(angles, key=lambda one: abs(angles[one][0]), default=0)
        for one, (angle, std) in angles.items():
            off = abs(float(wrapped(np.array(angle - angles[straightest][0]))))
            if off > max(TURNED, SURE * np.hypot(std, angles[straightest][1])):
                wrong |= part == one
                largest = max(largest, off)
    count = int(np.count_nonzero(wrong))
    return Finding(
        "pose_headings_turned",
        count,
        f"After a jump the tracker's headings are turned by {np.degrees(largest):.0f} degrees against the way that "
        f"the robot goes: {counted(count, 'pose')} set aside. See to what is tracked on the robot.",
        {"poses": wrong} if count else {},
    )


def _ways(recording: Recording, part: NDArray[np.int64], used: Mask, pose_lag: float) -> Ways | None:
    """Return the motion from each `used` pose to one a window later, of the same part; None if unknown."""
    poses, part = recording.poses.where(used), part[used]
    wheels, commands = recording.wheels, recording.commands
    if len(poses) < FEWEST or max(len(wheels), len(commands)) < 2:
        return None
    travel = travel_of(recording, "wheels" if len(wheels) > 1 else "commands", int(poses.utime[0]))
    width = max(round(WINDOW / max(float(np.median(np.diff(poses.seconds))), SECONDS)), 1)
    first = np.arange(0, len(poses) - width, width)
    piece = recording.pieces.number(poses.utime)
    first = first[(part[first] == part[first + width]) & (piece[first] == piece[first + width])]
    last = first + width
    place, theta = poses["x"] + 1j * poses["y"], poses["theta"]
    turned = wrapped(theta[last] - theta[first])
    moved = (place[last] - place[first]) * np.exp(-1j * (theta[first] + 0.5 * turned))
    driven = np.interp(poses.seconds - pose_lag, travel.time, np.asarray(travel.driven))
    return Ways(part[first], moved, driven[last] - driven[first], turned)


def _angles(ways: Ways | None) -> dict[int, tuple[float, float]]:
    """Return, by part, the angle [rad] from the heading to the way and its standard deviation.

    The tracked point's lever arm and sideways skid, the same in all parts, are fitted as well, because in bends they
    also move it sideways.
    """
    if ways is None or len(ways.part) < FEWEST:
        return {}
    parts = np.unique(ways.part)
    common = [ways.turned, ways.turned * ways.driven]
    design = np.stack([ways.driven * (ways.part == one) for one in parts] + common, axis=1)
    kept = np.ones(len(ways.part), np.bool_)
    for _ in range(2):
        solution = np.linalg.lstsq(design[kept], ways.moved[kept], rcond=None)[0]
        left = ways.moved - design @ solution
        noise = max(spread(np.append(left.real, left.imag)), 1e-9)
        kept = np.abs(left) <= OUTLYING * noise
    inverse = np.linalg.pinv(design[kept].T @ design[kept])
    return {
        int(one): (float(np.angle(solution[k])), noise * float(np.sqrt(inverse[k, k])) / abs(solution[k]))
        for k, one in enumerate(parts)
        if abs(solution[k]) * float(np.abs(ways.driven[ways.part == one]).sum()) > SHORTEST_WAY
    }

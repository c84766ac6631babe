"""Cut a recording into drives that can be simulated from end to end, on one time line each."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from cmr.model.motion import RobotState, Trajectory, drive
from cmr.model.parameters import RobotParameters
from cmr.recordings.encoders import moved_on, tick_of, within_tick
from cmr.recordings.recording import Recording
from cmr.recordings.signal import SECONDS, Floats, Signal, Times, hold, no_times
from cmr.recordings.wheel_angles import wheel_angles

SIDES = ("left", "right")
LONGEST_POSE_GAP = 1.0  # s; over a longer one the path is unknown and a new segment begins
LONGEST_DRIVE_GAP = 0.25  # s; over a longer one the commands of a moving robot are unknown
FEWEST_POSES = 3  # a segment with fewer is not informative
LEAD = 1.0  # s of rest kept before the robot begins to move: enough to average its start pose
MOVING_DUTY = 1e-3  # smaller commands count as rest
START_SPAN = 0.15  # s around the start over which the wheel speeds are averaged
LEAST_PSI_DOUBT, UNKNOWN_PSI = 0.02, 10.0  # of the speed; rad/s
LEAST_TURN, LEAST_WAY = 0.2, 0.1  # rad, m; smaller differences of poses count as noise
FEWEST_POSES_FOR_START = 50  # with fewer, the measured start pose is used and not fitted


@dataclass(frozen=True)
class Segment:
    """One drive between two gaps of the external pose.

    The drive is made of T spans of constant duty: `dt` [s], `left`, `right` [duty], shape (T,), and of the wheel angles
    `angle_left`, `angle_right` [rad] at their T + 1 borders (empty where no wheels were recorded). At the borders
    `left_at` and `right_at` that side's encoder has just advanced, and its wheel was at `left_edge`, `right_edge`
    [rad]. The M measured poses `x`, `y` [m], `theta` [rad, unwrapped] fall on the borders `at`; `utime` are their
    times. `start` is the state at the first border, as measured; `start_psi_std` [rad/s] is the uncertainty of the
    speeds of its left and right wheels, 0 for a robot at rest.
    """

    dt: Floats
    left: Floats
    right: Floats
    angle_left: Floats
    angle_right: Floats
    left_at: Times
    right_at: Times
    left_edge: Floats
    right_edge: Floats
    at: Times
    utime: Times
    x: Floats
    y: Floats
    theta: Floats
    start: RobotState
    start_psi_std: tuple[float, float] = (0.0, 0.0)

    @property
    def fits_start(self) -> bool:
        """Whether there are enough poses to fit the start pose along with the parameters."""
        return len(self.x) >= FEWEST_POSES_FOR_START

    @cached_property
    def border_times(self) -> Floats:
        """Times of the T + 1 borders [s], from 0."""
        return np.concatenate([[0.0], np.cumsum(self.dt)])

    def beginning(self, seconds: float) -> "Segment":
        """Return the first part of the segment, this long; at least two of its poses."""
        poses = max(int(np.searchsorted(self.border_times[self.at], seconds, side="right")), 2)
        spans = int(self.at[min(poses, len(self.at)) - 1])
        wheels = slice(spans + 1 if len(self.angle_left) else 0)
        return replace(
            self,
            dt=self.dt[:spans],
            left=self.left[:spans],
            right=self.right[:spans],
            angle_left=self.angle_left[wheels],
            angle_right=self.angle_right[wheels],
            left_at=self.left_at[self.left_at <= spans],
            right_at=self.right_at[self.right_at <= spans],
            left_edge=self.left_edge[self.left_at <= spans],
            right_edge=self.right_edge[self.right_at <= spans],
            at=self.at[:poses],
            utime=self.utime[:poses],
            x=self.x[:poses],
            y=self.y[:poses],
            theta=self.theta[:poses],
        )

    def thinned(self, most: int) -> "Segment":
        """Return the segment with at most so many poses, and twice as many edges of each encoder."""
        poses = slice(None, None, max(-(-len(self.at) // most), 1))
        left = slice(None, None, max(-(-len(self.left_at) // (2 * most)), 1))
        right = slice(None, None, max(-(-len(self.right_at) // (2 * most)), 1))
        return replace(
            self,
            left_at=self.left_at[left],
            right_at=self.right_at[right],
            left_edge=self.left_edge[left],
            right_edge=self.right_edge[right],
            at=self.at[poses],
            utime=self.utime[poses],
            x=self.x[poses],
            y=self.y[poses],
            theta=self.theta[poses],
        )

    @property
    def fits_start_psi(self) -> bool:
        """Whether the robot moved when the segment began, so that its wheel speeds are only known roughly."""
        return max(self.start_psi_std) > 0.0

    def simulate(self, parameters: RobotParameters, psi: tuple[ArrayLike, ArrayLike] | None = None) -> Trajectory:
        """Drive the recorded duties with the motor model; return the trajectory at all borders.

        `psi` are wheel speeds at the start [rad/s], possibly arrays of candidates, replacing the measured ones.
        """
        left, right = psi or (self.start.psi_left, self.start.psi_right)
        start = self.start._replace(psi_left=left, psi_right=right)
        return drive(self.left, self.right, self.dt, parameters, start)


def segments_of(recording: Recording, splits: Sequence[int] = ()) -> list[Segment]:
    """Return the segments of a recording; empty without poses.

    A new one begins where the poses, or the commands of a moving robot, have a gap, and at each of the utimes `splits`.
    """
    utime = recording.poses.utime
    breaks = _gaps(utime, LONGEST_POSE_GAP) + _drive_gaps(recording) + [(split, split) for split in splits]
    inside = np.ones(len(utime), dtype=bool)
    for first, last in breaks:
        inside &= (utime <= first) | (utime >= last)
    part = sum((utime >= last).astype(int) for _first, last in breaks) if breaks else np.zeros(len(utime), dtype=int)
    runs = [utime[inside & (part == number)] for number in np.unique(part)]
    segments = [_segment(recording, int(run[0]), int(run[-1])) for run in runs if len(run)]
    return [segment for segment in segments if segment is not None]


def _gaps(utime: Times, longest: float) -> list[tuple[int, int]]:
    """Return the gaps without samples of more than `longest` [s]: utimes before and after."""
    at = np.flatnonzero(np.diff(utime) > longest / SECONDS)
    return [(int(utime[index]), int(utime[index + 1])) for index in at]


def _drive_gaps(recording: Recording) -> list[tuple[int, int]]:
    """Return the gaps in the commands while the robot moved."""
    duty = recording.duty
    if len(recording.wheels) == 0:
        return []
    gaps = _gaps(duty.utime, LONGEST_DRIVE_GAP)
    return [(first, last) for first, last in gaps if _moves(recording, first) or _moves(recording, last)]


def _moves(recording: Recording, utime: int) -> bool:
    wheels = recording.wheels
    at = min(int(np.searchsorted(wheels.utime, utime)), len(wheels) - 1)
    return bool(wheels["psi_left"][at] != 0.0 or wheels["psi_right"][at] != 0.0)


def _segment(recording: Recording, first: int, last: int) -> Segment | None:
    duty = recording.duty
    first = max(first, _onset(recording, first, last) - int(LEAD / SECONDS))
    poses = recording.poses.between(first, last)
    if len(poses) < FEWEST_POSES:
        return None
    inside = [signal.between(int(poses.utime[0]), last).utime for signal in (duty, recording.wheels)]
    times = np.unique(np.concatenate([*inside, poses.utime]))
    angles, edges = [np.empty(0)] * 2, [(no_times(), np.empty(0))] * 2
    if len(recording.wheels):
        turned = wheel_angles(recording.wheels)
        angles = [np.interp(times, recording.wheels.utime, angle) for angle in turned]
        edges = [_edges(recording.wheels, side, angle, times) for side, angle in zip(SIDES, turned, strict=True)]
    theta = np.unwrap(poses["theta"])
    left, right = (hold(duty, side, times[:-1]) for side in SIDES)
    psi = _start_psi(recording, int(times[0]), (float(left[0]), float(right[0])))
    return Segment(
        dt=np.diff(times) * SECONDS,
        left=left,
        right=right,
        angle_left=angles[0],
        angle_right=angles[1],
        left_at=edges[0][0],
        right_at=edges[1][0],
        left_edge=edges[0][1],
        right_edge=edges[1][1],
        at=np.searchsorted(times, poses.utime),
        utime=poses.utime,
        x=np.ascontiguousarray(poses["x"]),
        y=np.ascontiguousarray(poses["y"]),
        theta=theta,
        start=_start(poses, theta, _onset(recording, int(poses.utime[0]), last), (psi[0][0], psi[1][0])),
        start_psi_std=(psi[0][1], psi[1][1]),
    )


def _edges(wheels: Signal, side: str, angle: Floats, times: Times) -> tuple[Times, Floats]:
    """Return at which borders `times` [us] a side's encoder has just advanced, and the wheel angle there [rad].

    `angle` [rad] is what it read at each time of `wheels`. Repeated readings are not informative.
    """
    steps = np.diff(angle, prepend=angle[:1])
    beyond, _width = within_tick(steps, tick_of(angle, wheels[f"ticks_{side}"]))
    use = moved_on(steps) & (wheels.utime >= times[0]) & (wheels.utime <= times[-1])
    return np.searchsorted(times, wheels.utime[use]), (angle + beyond)[use]


def _onset(recording: Recording, first: int, last: int) -> int:
    """Return when the robot begins to be driven, or to roll, within [first, last]; `first` if it never does."""
    moments = [last]
    for signal, left, right, threshold in (
        (recording.duty, "left", "right", MOVING_DUTY),
        (recording.wheels, "psi_left", "psi_right", 0.0),
    ):
        moving = (np.abs(signal[left]) > threshold) | (np.abs(signal[right]) > threshold)
        times = signal.utime[moving & (signal.utime >= first)]
        moments += times[:1].tolist()
    onset = min(moments)
    return onset if onset < last else first


def _start(poses: Signal, theta: Floats, onset: int, psi: tuple[float, float]) -> RobotState:
    """Return the state at the first pose: poses at rest averaged, wheel speeds as given."""
    rest = max(int(np.count_nonzero(poses.utime <= onset)), 1)
    return RobotState(
        float(poses["x"][:rest].mean()),
        float(poses["y"][:rest].mean()),
        float(theta[:rest].mean()),
        *psi,
        0.0,
        0.0,
    )


def _start_psi(recording: Recording, start: int, duties: tuple[float, float]) -> list[tuple[float, float]]:
    """Return the speed [rad/s] of each side's wheels at a time, and how well it is known: 0 for a robot at rest.

    Speeds are averages over the preceding time; while a robot accelerates, the true speed lies within the measurements
    around the time. Without wheels, only the commands show that the robot may have been moving.
    """
    span = int(START_SPAN / SECONDS)
    near = recording.wheels.between(start - span, start + span)
    result = []
    for name, duty in zip(("psi_left", "psi_right"), duties, strict=True):
        if len(near):
            psi = near[name]
            moves = psi[near.utime <= start].any()
            doubt = max(float(np.ptp(psi)) / 2.0, LEAST_PSI_DOUBT * float(np.abs(psi).max())) if moves else 0.0
            result.append((float(psi.mean()) if moves else 0.0, doubt))
        else:
            result.append((0.0, UNKNOWN_PSI if abs(duty) > MOVING_DUTY else 0.0))
    return result


def path_error(segments: list[Segment], trajectories: list[Trajectory]) -> float:
    """Return the root mean square distance [m] between measured and simulated positions."""
    pairs = zip(segments, trajectories, strict=True)
    squares = [(t.x[s.at] - s.x) ** 2 + (t.y[s.at] - s.y) ** 2 for s, t in pairs]
    return float(np.sqrt(np.mean(np.concatenate(squares))))


def heading_range(segments: list[Segment]) -> float:
    """Return the largest range of headings [rad] that a segment spans."""
    return max((float(np.ptp(segment.theta)) for segment in segments), default=0.0)


def turned_angle(theta: Floats) -> float:
    """Return the sum of turns [rad], in both directions; changes below LEAST_TURN count as noise."""
    return _variation(theta, theta * 0.0, LEAST_TURN)


def travelled(x: Floats, y: Floats) -> float:
    """Return the length of the path [m]; steps below LEAST_WAY count as noise."""
    return _variation(x, y, LEAST_WAY)


def _variation(x: Floats, y: Floats, threshold: float) -> float:
    total, last = 0.0, (x[0], y[0])
    for point in zip(x, y, strict=True):
        distance = float(np.hypot(point[0] - last[0], point[1] - last[1]))
        if distance >= threshold:
            total, last = total + distance, point
    return total

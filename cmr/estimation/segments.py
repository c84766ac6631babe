"""Segments of recordings on the observer's time grid: commands, observations, and the uncertainty of each reading."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from cmr.model.commands import Commands
from cmr.model.observer.observer import FOLLOWED, RESTART, Observations
from cmr.recordings.encoders import moved_on, tick_of, within_tick
from cmr.recordings.faults.time_checks import held_up
from cmr.recordings.faults.wheel_checks import motion_of
from cmr.recordings.recording import Recording
from cmr.recordings.signal import SECONDS, Floats, Mask, Signal, Times
from cmr.recordings.wheel_angles import wheel_angles

STEP = 0.01  # s; step of the time grid
LONGEST_SILENCE = 1.0  # s; no prediction across a longer gap in commands or wheels
# s, and multiple of the usual interval, without feedback on duties: the driver may have stopped the motors meanwhile,
# so there is no prediction across the gap.
LONGEST_UNREPORTED, LONGEST_UNREPORTED_PERIODS = 0.05, 5.0
LONGEST_POSE_GAP = 1.0  # s; the path restarts at the next pose
SHORTEST_PIECE = 1.0  # s; a shorter stretch between gaps is left out
# s of standstill used before and after motion: enough to determine the gyro's bias as well as its drift allows.
LONGEST_STAND = 10.0
EARLIER = 2.0  # s; commands of this age may still be in force, or delayed, when a segment begins
LONGEST_REST = 0.1  # s without an edge after which a standing wheel's angle counts as a reading again
# Allowed quantisation noise, as a share of the difference of wheel speeds; s of averaging at most.
NOISY, LONGEST_MEAN = 0.045, 0.05
SIDES = ("left", "right")
ANGLES = ("angle_left", "angle_right")  # fields of wheels in this module
UNIFORM = 12.0**-0.5  # standard deviation of a uniform distribution of width 1


@dataclass(frozen=True)
class Segment:
    """A part of a recording without gaps, as input of the observer.

    `wheel_doubt` [rad], shape (W, 2), is the standard deviation of each reading due to encoder quantisation; `tick`
    [rad] is the tick size, 0 without ticks. `first` [us] is the time of the grid's beginning, `recording` the number of
    the recording to which it belongs, `piece` that of the recording's piece in which it lies. `piece_pose` (x, y,
    theta) [m, m, rad] is the first pose of that piece, which may have come before the commands. `rolled`, shape (steps,
    2), are the wheel speeds [rad/s] from the encoders; empty without them.
    """

    observations: Observations
    wheel_doubt: Floats
    tick: float
    first: int
    recording: int
    rolled: Floats
    piece: int = 0
    piece_pose: tuple[float, float, float] = (np.nan, np.nan, np.nan)

    @property
    def rolling(self) -> "Segment":
        """The segment with the measured wheel speeds as input instead of commands."""
        return replace(self, observations=replace(self.observations, given=self.rolled))

    def with_commands_at(self, time: Floats) -> "Segment":
        """Return the segment with commands that take effect at these times [s], shape (n,), increasing."""
        commands = replace(self.observations.commands, time=time)
        return replace(self, observations=replace(self.observations, commands=commands))


def continued(segments: Sequence[Segment]) -> list[bool]:
    """Return for each segment whether it continues the previous one's recording after a gap."""
    before = [None, *(one.recording for one in segments[:-1])]
    return [one.recording == last for one, last in zip(segments, before, strict=True)]


def segments_of(recording: Recording, splits: Sequence[int], number: int) -> list[Segment]:
    """Return the parts of a recording between gaps; `splits` [us] are poses at which the path begins again.

    At most LONGEST_STAND of a standstill without commands is used at the beginning and end.
    """
    recording = replace(recording, wheels=_with_angles(recording.wheels))
    sources = [s for s in (recording.duty, recording.wheels) if len(s)] or [s for s in (recording.poses,) if len(s)]
    if not sources:
        return []
    first = max(int(signal.utime[0]) for signal in sources)
    last = min(int(signal.utime[-1]) for signal in sources)
    borders = np.array([first, *(time for gap in _breaks(recording, sources) for time in gap), last])
    times = _eventful(recording)
    if len(times):
        stand = round(LONGEST_STAND / SECONDS)
        borders = np.clip(borders, times.min() - stand, times.max() + stand)
    spans = [
        (begin, end) for begin, end in borders.reshape(-1, 2).tolist() if (end - begin) * SECONDS >= SHORTEST_PIECE
    ]
    tick, turned = _tick(recording.wheels), _turned(recording.wheels, [begin for begin, _ in spans])
    return [
        _segment(recording, *span, first, splits, number, tick, angles)
        for span, angles in zip(spans, turned, strict=True)
    ]


def _with_angles(wheels: Signal) -> Signal:
    """Return the wheels' readings with their angles [rad]: the tick size cannot be determined from a part of them.

    During steady driving, coarse speeds reported with the counts are biased.
    """
    angles = wheel_angles(wheels) if len(wheels) else (np.empty(0), np.empty(0))
    return replace(wheels, fields={**wheels.fields, **dict(zip(ANGLES, angles, strict=True))})


def _turned(wheels: Signal, times: Sequence[int]) -> list[tuple[float, float]]:
    """Return the rotation of the left and the right wheel [rad] at some times [us], since the first reading."""
    if len(wheels) == 0:
        return [(0.0, 0.0)] * len(times)
    left, right = (np.interp(times, wheels.utime, wheels[name]) for name in ANGLES)
    return list(zip(left.tolist(), right.tolist(), strict=True))


def _eventful(recording: Recording) -> Times:
    """Return the times [us] between which the wheels move or the motors are driven.

    Driven motors that do not turn are evidence of friction.
    """
    duty = recording.duty
    driven = duty.utime[(duty["left"] != 0.0) | (duty["right"] != 0.0)]
    return np.concatenate([np.array(motion_of(recording) or (), np.int64), driven])


def _breaks(recording: Recording, sources: Sequence[Signal]) -> list[tuple[int, int]]:
    """Return start and end [us] of each gap that cannot be predicted across, in order and disjoint."""
    found = [gap for signal in sources for gap in _gaps(signal.utime, LONGEST_SILENCE)]
    if "status" in recording.duty.fields and len(recording.wheels) > 1:
        usual = float(np.median(np.diff(recording.wheels.utime))) * SECONDS
        found += _gaps(recording.wheels.utime, max(LONGEST_UNREPORTED, LONGEST_UNREPORTED_PERIODS * usual))
    apart: list[tuple[int, int]] = []
    for begin, end in sorted(found):
        if apart and begin <= apart[-1][1]:
            apart[-1] = (apart[-1][0], max(end, apart[-1][1]))
        else:
            apart.append((begin, end))
    return apart


def _gaps(utime: Times, longest: float) -> list[tuple[int, int]]:
    at = np.flatnonzero(np.diff(utime) > longest / SECONDS)
    return [(int(utime[index]), int(utime[index + 1])) for index in at]


def _tick(wheels: Signal) -> float:
    """Return the size [rad] of the encoders' ticks: of the finer encoder, 0 without readings."""
    if len(wheels) == 0:
        return 0.0
    sizes = [tick_of(wheels[f"angle_{side}"], wheels[f"ticks_{side}"]) for side in SIDES]
    return min((size for size in sizes if size > 0.0), default=0.0)


def _segment(
    recording: Recording,
    first: int,
    last: int,
    beginning: int,
    splits: Sequence[int],
    number: int,
    tick: float,
    turned: tuple[float, float],
) -> Segment:
    steps = int((last - first) * SECONDS / STEP)
    end = first + int(steps * STEP / SECONDS)
    wheels, gyro, poses = (s.between(first, end) for s in (recording.wheels, recording.gyro, recording.poses))
    angle, use, doubt = _readings(wheels, tick)
    use[held_up(wheels)] = 0
    pose = _stacked(poses)
    rolled = _rolled_of(recording, first, end, tick, steps) if len(recording.wheels) else np.empty((0, 2))
    observations = Observations(
        dt=STEP,
        steps=steps,
        commands=_commands(recording.duty, first, end),
        start=(*(pose[0].tolist() if len(pose) else (0.0, 0.0, 0.0)), *_start_speeds(wheels, first)),
        wheel_time=_seconds(wheels, first),
        wheel=angle,
        wheel_use=use,
        gyro_time=_seconds(gyro, first),
        gyro=np.ascontiguousarray(gyro["yaw_rate"]),
        pose_time=_seconds(poses, first),
        pose=np.ascontiguousarray(pose),
        pose_use=_pose_use(poses.utime, splits),
        given=np.empty((0, 2)) if len(recording.duty) else rolled,
        time=(first - beginning) * SECONDS,
        kind=recording.command_kind,
        turned=turned,
    )
    piece = int(recording.pieces.number(np.array([first]))[0])
    return Segment(observations, doubt, tick, first, number, rolled, piece, _first_pose(recording, piece))


def _stacked(poses: Signal) -> Floats:
    """Return x, y and theta of all poses, (P, 3) [m, m, rad]."""
    return np.stack([poses[name] for name in ("x", "y", "theta")], axis=1) if len(poses) else np.empty((0, 3))


def _first_pose(recording: Recording, piece: int) -> tuple[float, float, float]:
    """Return the first pose of a piece; NaN if none followed."""
    poses = recording.poses
    index = int(np.searchsorted(poses.utime, recording.pieces.first[piece]))
    if index == len(poses):
        return (np.nan, np.nan, np.nan)
    return (float(poses["x"][index]), float(poses["y"][index]), float(poses["theta"][index]))


def _commands(duty: Signal, first: int, end: int) -> Commands:
    """Return the commands from `first` to `end` [us], and earlier ones that may still be delayed."""
    sent = duty.between(first - int(EARLIER / SECONDS), end)
    return Commands(_seconds(sent, first), np.stack([sent["left"], sent["right"]], axis=1))


def _seconds(signal: Signal, first: int) -> Floats:
    """Return the time of each sample since `first` [us], in seconds."""
    return np.asarray((signal.utime - first) * SECONDS, np.float64)


def _readings(wheels: Signal, tick: float) -> tuple[Floats, np.typing.NDArray[np.uint8], Floats]:
    """Return each reading's angle [rad], whether it is informative, and its doubt [rad], (W, 2).

    An encoder that has just advanced has passed a tick edge since the previous reading. A repeated count carries no new
    information, except for a wheel at rest, which is somewhere within the tick.
    """
    if len(wheels) == 0:
        return np.empty((0, 2)), np.empty((0, 2), np.uint8), np.empty((0, 2))
    angles = np.stack([wheels[name] for name in ANGLES], axis=1)
    steps = np.diff(angles, axis=0, prepend=angles[:1])
    seconds = (wheels.utime - wheels.utime[0]) * SECONDS
    columns = [_side(angle, step, tick, seconds) for angle, step in zip(angles.T, steps.T, strict=True)]
    reading, use, doubt = (np.stack(column, axis=1) for column in zip(*columns, strict=True))
    # The observer's wheels begin at angle 0, and the first reading is used.
    return reading - reading[:1], use, doubt


def _side(angle: Floats, steps: Floats, tick: float, seconds: Floats) -> tuple[Floats, Mask, Floats]:
    moved = moved_on(steps)
    within, width = within_tick(steps, tick)
    rests = ~moved & (_since_last(moved, seconds) >= LONGEST_REST)
    spaced = _every(rests, seconds, LONGEST_REST)
    return angle + within, (moved | spaced).astype(np.uint8), width * UNIFORM


def _since_last(marks: Mask, seconds: Floats) -> Floats:
    """Return the time [s] since the last mark, itself included."""
    last = np.maximum.accumulate(np.where(marks, seconds, seconds[0]))
    return np.asarray(seconds - last, np.float64)


def _every(marks: Mask, seconds: Floats, interval: float) -> Mask:
    """Return the marks, thinned to one per interval [s]."""
    number = np.floor(seconds / interval).astype(np.int64)
    first = np.ones(len(marks), np.bool_)
    first[1:] = number[1:] != number[:-1]
    return marks & first


def _pose_use(utime: Times, splits: Sequence[int]) -> np.typing.NDArray[np.uint8]:
    use = np.full(len(utime), FOLLOWED, np.uint8)
    use[:1] = RESTART
    use[1:][np.diff(utime) > LONGEST_POSE_GAP / SECONDS] = RESTART
    use[np.isin(utime, np.asarray(splits, np.int64))] = RESTART
    return use


def _start_speeds(wheels: Signal, first: int) -> tuple[float, float]:
    """Return the wheel speeds [rad/s] at the beginning: means around it."""
    near = wheels.between(first - int(0.1 / SECONDS), first + int(0.1 / SECONDS))
    if len(near) == 0:
        return 0.0, 0.0
    return float(near["psi_left"].mean()), float(near["psi_right"].mean())


def _rolled_of(recording: Recording, first: int, end: int, tick: float, steps: int) -> Floats:
    """Return the wheel speeds [rad/s], (steps, 2), from `first` to `end` [us].

    Readings shortly before and after the segment are used as well, so that its first and last steps are covered.
    """
    wheels = recording.wheels
    if not len(recording.duty):
        return _rolled(_seconds(wheels, first), np.stack([wheels[name] for name in ANGLES], axis=1), tick, steps)
    beside = round(LONGEST_SILENCE / SECONDS)
    near = wheels.between(first - beside, end + beside)
    return _rolled(_seconds(near, first), _readings(near, tick)[0], tick, steps)


def _rolled(time: Floats, angles: Floats, tick: float, steps: int) -> Floats:
    """Return the mean speed [rad/s] of each wheel, shape (steps, 2), around each step, from `angles` (W, 2) [rad].

    The average is over more than the step if quantisation would make it noisy. Noise in the regressor of a gyro makes
    the gyro's scale too small, by its share of the squared turn rate (regression dilution; W. A. Fuller, Measurement
    Error Models, 1987, section 1.1).
    """

    def at(times: Floats) -> Floats:
        return np.stack([np.interp(times, time, angle) for angle in angles.T], axis=1)

    middle: Floats = (np.arange(steps, dtype=np.float64) + 0.5) * STEP
    from_end: Floats = np.minimum(middle, steps * STEP - middle)
    smooth = (at(middle + 0.5 * LONGEST_MEAN) - at(middle - 0.5 * LONGEST_MEAN)) / LONGEST_MEAN
    turning = float(np.sqrt(np.mean((smooth[:, 1] - smooth[:, 0]) ** 2)))
    noise = 2.0 * UNIFORM * tick  # rad: of the difference of two wheels' angles between two readings
    allowed = NOISY * turning
    span = noise / allowed if noise < allowed * LONGEST_MEAN else LONGEST_MEAN
    half = np.clip(from_end, 0.5 * STEP, max(0.5 * span, 0.5 * STEP))
    return np.asarray((at(middle + half) - at(middle - half)) / (2.0 * half)[:, None], np.float64)

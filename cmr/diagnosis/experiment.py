"""Recordings on the observer's raster: what was sent, what was heard, and how well each reading is known."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from cmr.calibration.segments import wheel_angles
from cmr.calibration.ticks import moved_on, tick_of, within_tick
from cmr.model.observer import FOLLOWED, RESTART, Heard
from cmr.recordings.recording import Recording
from cmr.recordings.signal import SECONDS, Floats, Mask, Signal, Times

STEP = 0.01  # s of the raster
LONGEST_SILENCE = 1.0  # s; over a longer gap of commands, or of wheels, nothing is foretold
LONGEST_POSE_GAP = 1.0  # s; the pose that comes after it is a new beginning
SHORTEST_PIECE = 1.0  # s
LONGEST_REST = 0.1  # s without an edge after which a standing wheel's angle counts as a reading again
SIDES = ("left", "right")
UNIFORM = 12.0**-0.5  # standard deviation of what is spread evenly over 1


@dataclass(frozen=True)
class Piece:
    """A part of a recording without gaps, as the observer takes it.

    `wheel_doubt` [rad], shape (W, 2), is the standard deviation that the encoder's ticks leave of each reading;
    `tick` [rad] their size, 0 where there are none. `packet_time` [s] and `packet_duty`, shapes (n,) and (n, 2), are
    the commands one by one. `first` [us] is the time of the raster's beginning, `recording` the number of the recording
    that it belongs to.
    """

    heard: Heard
    wheel_doubt: Floats
    tick: float
    first: int
    recording: int
    packet_time: Floats
    packet_duty: Floats

    @property
    def rolling(self) -> "Piece":
        """The piece as if the robot had rolled as its wheels did, whatever it was commanded."""
        if len(self.heard.given):
            return self
        borders = np.arange(len(self.heard.left) + 1) * self.heard.dt
        angles = np.stack([np.interp(borders, self.heard.wheel_time, angle) for angle in self.heard.wheel.T], axis=1)
        return replace(self, heard=replace(self.heard, given=np.diff(angles, axis=0) / self.heard.dt))

    def with_packets_at(self, time: Floats) -> "Piece":
        """Return the piece with commands that take effect at these times [s], increasing, (n,), instead of at once."""
        borders = np.asarray(np.arange(len(self.heard.left) + 1) * self.heard.dt, np.float64)
        left, right = (_mean_held(time, duty, borders) for duty in self.packet_duty.T)
        return replace(self, heard=replace(self.heard, left=left, right=right))


def pieces_of(recording: Recording, splits: Sequence[int], number: int) -> list[Piece]:
    """Return the parts of a recording between gaps; `splits` [us] are poses at which the path begins anew."""
    sources = [s for s in (recording.duty, recording.wheels) if len(s)] or [recording.poses]
    first = max(int(signal.utime[0]) for signal in sources)
    last = min(int(signal.utime[-1]) for signal in sources)
    breaks = sorted(gap for signal in sources for gap in _gaps(signal.utime, LONGEST_SILENCE))
    borders = [first, *(time for gap in breaks for time in gap), last]
    spans = zip(borders[::2], borders[1::2], strict=True)
    tick = _tick(recording.wheels)
    return [
        _piece(recording, begin, end, first, splits, number, tick)
        for begin, end in spans
        if (end - begin) * SECONDS >= SHORTEST_PIECE
    ]


def _gaps(utime: Times, longest: float) -> list[tuple[int, int]]:
    at = np.flatnonzero(np.diff(utime) > longest / SECONDS)
    return [(int(utime[index]), int(utime[index + 1])) for index in at]


def _tick(wheels: Signal) -> float:
    """Return the size [rad] of the encoders' ticks: of the finer one, 0 where there are no readings."""
    if len(wheels) == 0:
        return 0.0
    sizes = [tick_of(angle, wheels[f"ticks_{side}"]) for side, angle in zip(SIDES, wheel_angles(wheels), strict=True)]
    return min((size for size in sizes if size > 0.0), default=0.0)


def _piece(
    recording: Recording, first: int, last: int, beginning: int, splits: Sequence[int], number: int, tick: float
) -> Piece:
    steps = int((last - first) * SECONDS / STEP)
    end = first + int(steps * STEP / SECONDS)
    wheels, gyro, poses = (s.between(first, end) for s in (recording.wheels, recording.gyro, recording.poses))
    borders = first + np.round(np.arange(steps + 1) * (STEP / SECONDS)).astype(np.int64)
    duty = [_means(recording.duty, side, borders) for side in ("left", "right")]
    packets = recording.duty.between(first, end)
    angle, use, doubt = _readings(wheels, tick)
    pose = np.stack([poses[name] for name in ("x", "y", "theta")], axis=1) if len(poses) else np.empty((0, 3))
    psi = _start_speeds(wheels, first)
    begins = pose[0] if len(pose) else np.zeros(3)
    return Piece(
        Heard(
            dt=STEP,
            left=duty[0],
            right=duty[1],
            start=(float(begins[0]), float(begins[1]), float(begins[2]), *psi),
            wheel_time=_seconds(wheels, first),
            wheel=angle,
            wheel_use=use,
            gyro_time=_seconds(gyro, first),
            gyro=np.ascontiguousarray(gyro["yaw_rate"]),
            pose_time=_seconds(poses, first),
            pose=np.ascontiguousarray(pose),
            pose_use=_pose_use(poses.utime, splits),
            given=_given(recording.wheels, borders) if len(recording.duty) == 0 else np.empty((0, 2)),
            time=(first - beginning) * SECONDS,
        ),
        doubt,
        tick,
        first,
        number,
        _seconds(packets, first),
        np.stack([packets["left"], packets["right"]], axis=1) if len(packets) else np.empty((0, 2)),
    )


def _seconds(signal: Signal, first: int) -> Floats:
    """Return the time of each sample since `first` [us], in seconds."""
    return np.asarray((signal.utime - first) * SECONDS, np.float64)


def _means(signal: Signal, field: str, borders: Times) -> Floats:
    """Return the mean over each step of what holds until the next is said; 0 before the first."""
    if len(signal) == 0:
        return np.zeros(len(borders) - 1)
    start = int(borders[0])
    return _mean_held(_seconds(signal, start), signal[field], np.asarray((borders - start) * SECONDS, np.float64))


def _mean_held(time: Floats, values: Floats, borders: Floats) -> Floats:
    """Return the mean between borders [s] of values that hold from their time [s] to the next; 0 before the first."""
    if len(time) == 0:
        return np.zeros(len(borders) - 1)
    ends = np.append(time, max(borders[-1], time[-1]) + 1.0)
    integral = np.concatenate([[0.0], np.cumsum(values * np.diff(ends))])
    return np.asarray(np.diff(np.interp(borders, ends, integral)) / np.diff(borders))


def _readings(wheels: Signal, tick: float) -> tuple[Floats, np.typing.NDArray[np.uint8], Floats]:
    """Return each reading's angle [rad], whether it tells something, and its doubt [rad], (W, 2).

    An encoder that has just moved on has passed the edge of a tick since the reading before. One that says again what
    it said tells nothing new, but for a wheel that rests: somewhere within the tick.
    """
    if len(wheels) == 0:
        return np.empty((0, 2)), np.empty((0, 2), np.uint8), np.empty((0, 2))
    angles = np.stack(wheel_angles(wheels), axis=1)
    steps = np.diff(angles, axis=0, prepend=angles[:1])
    seconds = (wheels.utime - wheels.utime[0]) * SECONDS
    columns = [_side(angle, step, tick, seconds) for angle, step in zip(angles.T, steps.T, strict=True)]
    reading, use, doubt = (np.stack(column, axis=1) for column in zip(*columns, strict=True))
    # The observer's wheels begin at angle 0, and it sees the first reading.
    return reading - reading[:1], use, doubt


def _side(angle: Floats, steps: Floats, tick: float, seconds: Floats) -> tuple[Floats, Mask, Floats]:
    moved = moved_on(steps)
    within, width = within_tick(steps, tick)
    rests = ~moved & (_since_last(moved, seconds) >= LONGEST_REST)
    spaced = _every(rests, seconds, LONGEST_REST)
    return angle + within, (moved | spaced).astype(np.uint8), width * UNIFORM


def _since_last(marks: Mask, seconds: Floats) -> Floats:
    """Return how long ago [s] the last mark was, itself included."""
    last = np.maximum.accumulate(np.where(marks, seconds, seconds[0]))
    return np.asarray(seconds - last, np.float64)


def _every(marks: Mask, seconds: Floats, interval: float) -> Mask:
    """Return one mark of all that fall into the same interval [s]."""
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


def _given(wheels: Signal, borders: Times) -> Floats:
    """Return the mean speed [rad/s] of each wheel over each step, from its encoder."""
    angles = np.stack([np.interp(borders, wheels.utime, angle) for angle in wheel_angles(wheels)], axis=1)
    return np.diff(angles, axis=0) / (np.diff(borders) * SECONDS)[:, None]

"""The base width with which a fit begins."""

from dataclasses import replace

import numpy as np
import pytest

from cmr.estimation.initial_guess import LARGEST_DOUBT, guess_base_width
from cmr.estimation.prediction import predictors
from cmr.estimation.segments import segments_of
from cmr.recordings.recording import Recording
from cmr.recordings.signal import Floats, Signal

RADIUS, WIDTH = 0.03, 0.16  # m
FAST = 12.0  # rad/s of each wheel: the robot turns at 4.5 rad/s, more than half a turn in a second
SECONDS = 40.0
SIDES = ("left", "right")
NO_GAP = ((0.0, 0.0),)
GAPS = tuple((begin, begin + 1.2) for begin in (4.0, 9.0, 17.0, 25.0, 33.0))  # s


def at(seconds: Floats, **fields: Floats) -> Signal:
    return Signal(np.round(1e6 * (seconds + 1.0)).astype(np.int64), fields)


def turned(time: Floats) -> Floats:
    """Return how far each wheel turned against the other [rad]: to either side for 5 s at a time."""
    return FAST * 5.0 / np.pi * (1.0 - np.cos(np.pi * time / 5.0))


def spinning(gaps: tuple[tuple[float, float], ...], pose_rate: float) -> Recording:
    """Return a drive on the spot, whose poses are lost in gaps [s]."""
    time = np.arange(0.0, SECONDS, 0.02)
    speed = FAST * np.sin(np.pi * time / 5.0)
    wheels = {f"psi_{side}": sign * speed for side, sign in zip(SIDES, (-1.0, 1.0), strict=True)}
    wheels |= {f"ticks_{side}": np.round(sign * turned(time) / 1e-4) for side, sign in zip(SIDES, (-1, 1), strict=True)}
    wheels |= {f"applied_{side}": np.full(len(time), np.nan) for side in SIDES}
    seen = np.arange(0.0, SECONDS, 1.0 / pose_rate)
    seen = seen[~np.any([(begin < seen) & (seen < end) for begin, end in gaps], axis=0)]
    theta = 2.0 * RADIUS / WIDTH * turned(seen)
    poses = at(seen, x=np.zeros(len(seen)), y=np.zeros(len(seen)), theta=np.arctan2(np.sin(theta), np.cos(theta)))
    gyro = at(time, yaw_rate=2.0 * RADIUS / WIDTH * speed)
    return Recording(
        0, commands=at(time[:0], left=speed[:0], right=speed[:0]), wheels=at(time, **wheels), gyro=gyro, poses=poses
    )


@pytest.mark.parametrize(
    ("gaps", "pose_rate"),
    [(NO_GAP, 10.0), (GAPS, 10.0), (NO_GAP, 2.0), (NO_GAP, 0.8)],
    ids=["poses", "poses with gaps", "two poses a second", "poses that are rare"],
)
def test_a_robot_that_turns_round_between_two_poses_has_a_base_width(
    gaps: tuple[tuple[float, float], ...], pose_rate: float
) -> None:
    segments = segments_of(spinning(gaps, pose_rate), (), 0)
    width = guess_base_width(predictors(segments), RADIUS)
    assert width is not None
    # Headings are straight lines between two poses: at most (pi / 5 * 0.1 s)^2 / 8 of a swing, 0.05 %, is cut off.
    assert width.value == pytest.approx(WIDTH, rel=1e-3)
    assert width.doubt < 0.01


def test_a_shove_on_a_straight_drive_tells_no_base_width() -> None:
    """The wheels turn with a third of it: a single window would fit any base width exactly."""
    drive = spinning(NO_GAP, 0.8)
    wheels, gyro = drive.wheels, drive.gyro
    straight = {name: np.zeros(len(wheels)) for name in ("psi_left", "psi_right", "ticks_left", "ticks_right")}
    shoved = np.where((gyro.seconds > 20.0) & (gyro.seconds < 20.3), 1.0, 0.0)
    straight["ticks_right"] = np.round(0.3 * WIDTH / RADIUS * np.cumsum(shoved) * 0.02 / 1e-4)
    poses = Signal(drive.poses.utime, {name: np.zeros(len(drive.poses)) for name in ("x", "y", "theta")})
    recording = replace(
        drive,
        wheels=Signal(wheels.utime, {**wheels.fields, **straight}),
        gyro=Signal(gyro.utime, {"yaw_rate": shoved}),
        poses=poses,
    )
    width = guess_base_width(predictors(segments_of(recording, (), 0)), RADIUS)
    assert width is None or width.doubt > LARGEST_DOUBT

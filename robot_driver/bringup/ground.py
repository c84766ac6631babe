"""The floor step: drive, and compare poses, gyro and wheels."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from robot_driver.bringup.bench import Bench, CannotTell, Readings, SeenPose
from robot_driver.bringup.floor import Body, drive
from robot_driver.bringup.motor_constants import motor_constants
from robot_driver.bringup.odometry import Path, path_of
from robot_driver.bringup.poses import LENGTH_SHARE, Pose, judged
from robot_driver.bringup.poses_found import PosesFound
from robot_driver.bringup.turning import GyroFound, angle_of
from robot_driver.guided import Guide

Seen = Mapping[int, Sequence[SeenPose]]  # by robot, in order of arrival
WIDTH_SHARE = 0.3  # share by which a measured base width may differ from the effective one
TURNED = math.radians(60.0)  # smallest rotation of a quarter turn


@dataclass(frozen=True)
class Ground:
    """The results of the drive: the effective base width (m), the motors if identifiable, and the poses."""

    base_width: float
    motors: tuple[float, float] | None
    poses: PosesFound | None
    problem: str = ""  # why the poses could not be judged


def find_on_the_ground(bench: Bench, guide: Guide, body: Body, gyro: GyroFound, seen: Seen, robot: int) -> Ground:
    """Drive, and compare. Raises CannotTell."""
    heard = drive(bench, guide, body)
    start = heard.feedback[0].utime
    path = path_of(heard.feedback, start, body.wheel_radius, body.base_width, body.ticks_per_turn)
    share = _share_of_turns(heard, gyro, path, start) if gyro.present else 1.0
    constants = motor_constants(heard.feedback)
    width = body.base_width / share
    path = path_of(heard.feedback, start, body.wheel_radius, width, body.ticks_per_turn)
    poses = {
        number: [
            Pose((utime - start) / 1e6, complex(x, y), theta)
            for utime, x, y, theta in list(some)
            if all(map(math.isfinite, (x, y, theta)))
        ]
        for number, some in seen.items()
    }
    own = poses.pop(robot, [])
    try:
        if not own and not poses:
            raise CannotTell(f"no poses came on POSE_{robot}: start what sends them, and run it again")
        found = judged(path, own, poses)
    except CannotTell as unknown:
        return Ground(width, constants, None, str(unknown))
    _check(found)
    return Ground(width if gyro.present else width / found.turn, constants, found)


def _share_of_turns(heard: Readings, gyro: GyroFound, path: Path, start: int) -> float:
    """Return the ratio of the robot's rotation by gyro to that by wheels. Raises CannotTell."""
    most = max(range(len(path.headings)), key=lambda number: path.headings[number])
    end = path.times[most]
    if path.headings[most] < TURNED:
        raise CannotTell("the robot did not turn left by its wheels")
    readings = [reading for reading in heard.gyro if (reading.utime - start) / 1e6 <= end]
    if len(readings) < 10:
        raise CannotTell("the gyro fell silent during the drive")
    share = angle_of(readings, gyro.bias * (-1.0 if gyro.inverted else 1.0)) / gyro.scale / path.headings[most]
    if share < 0.0:
        raise CannotTell(
            "the robot turned left by its wheels and right by its gyro: either the wheels are swapped, or it was "
            "turned the other way in the step gyro. Run both steps again (cmr bringup motors gyro)"
        )
    if abs(share - 1.0) > WIDTH_SHARE:
        raise CannotTell(
            f"the robot turned {share:.2f} times as far by its gyro as by its wheels. Measure the base width from the "
            "middle of one wheel to that of the other, and run this step again"
        )
    return share


def _check(found: PosesFound) -> None:
    """Raise CannotTell if the distances by poses and wheels differ.

    Rotations cannot be used instead: the effective base width may differ from the measured one by 10 %.
    """
    if found.vertical == "z" and abs(found.length - 1.0) > LENGTH_SHARE:
        raise CannotTell(
            f"the robot went {found.length:.3f} times as far by its poses as by its wheels. If the wheel radius is "
            "right, a turn was miscounted: run the step ticks again (cmr bringup ticks floor). Otherwise measure the "
            "radius, or calibrate the system that the poses come from",
            doubts=("ticks",),
        )

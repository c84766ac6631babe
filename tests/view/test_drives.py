"""cmr-view draws where a robot and its twin went before a calibration and after it."""

import re
from typing import Any

import numpy as np
import pytest

from cmr.bus.messages import make
from cmr.bus.streams import CALIBRATION_STATUS, WORLD_STATE
from cmr.bus.world_state import WorldState
from cmr.msg import calibration_status_t
from cmr.view import words
from cmr.view.drawing import SIZE, TOP, paths_drawing
from cmr.view.drives import Calibrations, Course, Drives, Paths
from cmr.view.robots import REAL, TWIN, Robots
from cmr.view.state import ViewState
from tests.support.small_log import FIELDS

NOW = 1_700_000_000_000_000  # us
SECOND = 1_000_000  # us


def drive(state: ViewState, begin: int, apart: float, way: float = 3.0) -> int:
    """Let robot 0 rest, drive for 10 s, `apart` [m] from its twin, and rest again; return the moment."""
    for k in range(140):
        x = way * min(max(k / 10 - 2.0, 0.0) / 10.0, 1.0)
        psi = np.array([5.0 if 0.0 < x < way else 0.0] * 2)
        columns = (np.zeros(2, int), np.array([REAL, TWIN]), np.array([x, x]), np.array([0.0, apart]), *[np.zeros(2)])
        utime = begin + k * SECOND // 10
        state.handle(utime, WORLD_STATE.name, WorldState(utime, *columns, psi, psi, psi, psi))
        state.advance(utime)
    return utime + SECOND // 10


def calibration_status(utime: int, state: int) -> Any:
    fields = {**FIELDS["CALIBRATION_STATUS"], "state": state}
    return make(CALIBRATION_STATUS.message_type, utime=utime, robot_id=0, **fields)


def test_paths_before_and_after_are_of_the_calibrations_drive_and_the_first_one_after_it() -> None:
    state = ViewState()
    now = drive(state, NOW, 9.0)
    now = drive(state, now, 0.5)
    assert "this drive" in words.drives(state, 0)
    for _ in range(3):
        state.handle(now, "CALIBRATION_STATUS_0", calibration_status(now, calibration_status_t.DONE))
    now = drive(state, now, 0.02)
    drive(state, now, 9.0)
    before, after = state.drives.of(0)
    assert before is not None
    assert after is not None
    assert (before.rmse, after.rmse) == pytest.approx((0.5, 0.02))
    assert (before.real[0, 0], before.real[-1, 0]) == pytest.approx((0.0, 3.0), abs=0.05)
    drawn = words.drives(state, 0)
    assert drawn.count("<polyline") == 4
    assert "50.0 cm apart" in drawn
    assert "2.0 cm apart" in drawn


CALIBRATED = {0: (150, 240, 430), 1: (150, 310, 330)}  # at which steps of `follow`; some while the robot drives on


def follow(drives: Drives, step: int) -> dict[int, Course]:
    """Let two robots drive for 0.2 s, one with long pauses, one with short ones; return what calibrations began."""
    now = NOW + step * SECOND // 5
    psi = [5.0 if step % 100 not in range(60, 60 + rest) else 0.0 for rest in (30, 7)]
    pose = np.array([[0.1 * step, 0.1 * step], [0.0, 1.0], [0.0, 0.0]])
    real = Robots(np.arange(2), np.full(2, REAL), pose, np.array([psi, psi]), np.zeros(2, np.bool_))
    drives.sample(now, real, real._replace(pose=pose + 0.01))
    return {robot_id: drives.calibrated(robot_id) for robot_id, steps in CALIBRATED.items() if step in steps}


def paths_around(drives: Drives, step: int) -> list[list[float]]:
    """Where the robots drove before and after the last calibration that they had until a step. [m along x]"""
    paths = [drives.of(robot_id) for robot_id, steps in CALIBRATED.items() if steps[0] <= step]
    return [[] if path is None else path.real[:, 0].tolist() for pair in paths for path in pair]


def test_whoever_comes_in_between_sees_the_drives_that_were_followed_from_the_beginning() -> None:
    followed, calibrations, expected = Drives(), Calibrations(), []
    for step in range(600):
        for robot_id, course in follow(followed, step).items():
            calibrations.add(NOW + step * SECOND // 5, robot_id, course)
        expected.append(paths_around(followed, step))
    assert all(expected[-1])
    for first in range(0, 600, 13):
        drives = calibrations.drives(NOW + first * SECOND // 5)
        assert paths_around(drives, first) == expected[first]
        for step in range(first + 1, min(first + 100, 600)):
            follow(drives, step)
            assert paths_around(drives, step) == expected[step], (first, step)


def test_a_robot_that_did_not_drive_has_no_paths() -> None:
    state = ViewState()
    drive(state, NOW, 0.5, way=0.4)
    assert state.drives.of(0) == (None, None)
    assert words.drives(state, 0) == words.drives(state, 99) == ""


def test_drawings_of_paths_keep_within_their_squares_and_tell_the_scale() -> None:
    way = np.array([[0.0, 0.0], [4.0, -20.0], [8.0, 1.0]])
    drawn = paths_drawing([("a", Paths(np.arange(3.0), way, way + 1.0)), ("b", None)])
    points = np.array(
        [point.split(",") for curve in re.findall(r'points="([^"]*)"', drawn) for point in curve.split()], float
    )
    assert points[:, 0].min() >= 0.0
    assert points[:, 0].max() <= SIZE
    assert points[:, 1].min() >= TOP
    assert points[:, 1].max() <= TOP + SIZE
    assert "10 m" in drawn
    assert "not driven yet" in drawn

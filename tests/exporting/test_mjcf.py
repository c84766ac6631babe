"""The MuJoCo model, stepped by MuJoCo, drives the path of the calibrated robot."""

import importlib.util
from typing import Any

import numpy as np
import pytest

from cmr.exporting.carried import BY_TARGET, MJCF
from cmr.exporting.mjcf import mjcf
from cmr.exporting.robot import ExportedRobot
from cmr.model.catalogue import CATALOGUE, typical
from cmr.model.motion import Floats
from cmr.model.parameters import RobotParameters
from cmr.model.velocity_controller import VelocityController, motor_of
from tests.exporting.exported_robots import PAPER, driven_in_python, robot_with

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(importlib.util.find_spec("mujoco") is None, reason="mujoco is not installed"),
]
STEP, SECONDS = 0.01, 60.0
TIME = np.arange(0.0, SECONDS, STEP)
MOVES = (TIME % 9.0) >= 1.0
LEFT = np.where(MOVES, 0.45 * np.sin(0.9 * TIME) + 0.35 * np.sign(np.sin(0.5 * TIME)), 0.0)
RIGHT = np.where(MOVES, 0.5 * np.sin(0.7 * TIME + 1.0) + 0.3, 0.0)
# Shares of the path's length by which it may end up off: the reach of the whole model, and of the approximate effects.
REACH = 0.01


def driven_in_mujoco(robot: ExportedRobot, left: Floats, right: Floats) -> Floats:
    """Return x, y [m] and the heading [rad] after each step, (steps, 3)."""
    import mujoco

    model: Any = mujoco.MjModel.from_xml_string(mjcf(robot))
    data: Any = mujoco.MjData(model)
    poses = np.empty((len(left), 3))
    for number, command in enumerate(zip(left, right, strict=True)):
        data.ctrl[:] = command
        for _ in range(round(STEP / model.opt.timestep)):
            mujoco.mj_step(model, data)
        poses[number] = [data.joint(name).qpos[0] for name in ("x", "y", "theta")]
    return poses


def share_off(robot: ExportedRobot) -> float:
    """Return the largest distance between both paths as a share of their length."""
    expected, _ = driven_in_python(robot, (LEFT, RIGHT, np.full(len(TIME), STEP)))
    found = driven_in_mujoco(robot, LEFT, RIGHT)
    length = float(np.hypot(*np.diff(expected[:, :2], axis=0).T).sum())
    return float(np.max(np.hypot(*(found[:, :2] - expected[:, :2]).T))) / length


@pytest.mark.parametrize("effects", [(), *((name,) for name in BY_TARGET[MJCF])], ids="+".join)
def test_mujoco_drives_the_path_of_the_robot(effects: tuple[str, ...]) -> None:
    assert share_off(robot_with(effects)) < REACH


def test_effects_that_it_carries_exactly_go_together() -> None:
    names = ("motor_gain_asymmetry", "back_emf_asymmetry", "wheel_radius_asymmetry", "motor_coupling", "quadratic_drag")
    values = {name: size for effect in names for name, size in typical(CATALOGUE[effect]).items()}
    assert share_off(ExportedRobot(0, RobotParameters(*PAPER, effects=values))) < REACH


def test_a_robot_with_a_velocity_controller_takes_wheel_speeds() -> None:
    values = {"wheel_radius": 0.033, "base_width": 0.16, "response_time": 0.1, "top_wheel_speed": 6.67}
    parameters = RobotParameters.of(
        {"wheel_radius": 0.033, "base_width": 0.16, **motor_of(values)},
    )
    robot = ExportedRobot(0, parameters, VelocityController(0.033, 0.16, 6.67))
    expected, _ = driven_in_python(robot, (LEFT, RIGHT, np.full(len(TIME), STEP)))
    found = driven_in_mujoco(robot, 6.67 * LEFT, 6.67 * RIGHT)
    length = float(np.hypot(*np.diff(expected[:, :2], axis=0).T).sum())
    assert np.max(np.hypot(*(found[:, :2] - expected[:, :2]).T)) < REACH * length


def test_a_coupling_that_no_body_has_is_refused() -> None:
    parameters = RobotParameters(*PAPER, effects={"motor_coupling": 0.95})
    with pytest.raises(ValueError, match="motor_coupling"):
        mjcf(ExportedRobot(0, parameters))

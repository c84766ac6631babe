"""The MuJoCo model, stepped by MuJoCo, drives the path of the calibrated robot."""

import importlib.util
from pathlib import Path

import pytest

from cmr.exporting.carried import BY_TARGET, MJCF
from cmr.exporting.mjcf import mjcf
from cmr.exporting.proof import FAR, Proof, prove
from cmr.exporting.robot import ExportedRobot
from cmr.model.catalogue import CATALOGUE, typical
from cmr.model.parameters import RobotParameters
from cmr.model.velocity_controller import VelocityController
from tests.exporting.exported_robots import PAPER, SPEEDS, robot_with

pytestmark = pytest.mark.slow
needs_mujoco = pytest.mark.skipif(importlib.util.find_spec("mujoco") is None, reason="mujoco is not installed")


def proven(robot: ExportedRobot, folder: Path) -> Proof:
    path = folder / "robot.xml"
    path.write_text(mjcf(robot))
    return prove(robot, MJCF, path)


@needs_mujoco
@pytest.mark.parametrize("effects", [(), *((name,) for name in BY_TARGET[MJCF])], ids="+".join)
def test_mujoco_drives_the_path_of_the_robot(effects: tuple[str, ...], tmp_path: Path) -> None:
    proof = proven(robot_with(effects), tmp_path)
    assert proof.lost == 0.0
    assert proof.off < FAR * proof.length


@needs_mujoco
def test_effects_that_it_carries_go_together(tmp_path: Path) -> None:
    names = ("motor_gain_asymmetry", "back_emf_asymmetry", "wheel_radius_asymmetry", "motor_coupling", "quadratic_drag")
    values = {name: size for effect in names for name, size in typical(CATALOGUE[effect]).items()}
    assert proven(ExportedRobot(0, RobotParameters(*PAPER, effects=values)), tmp_path).holds


@needs_mujoco
def test_a_robot_with_a_velocity_controller_takes_wheel_speeds(tmp_path: Path) -> None:
    assert proven(ExportedRobot(0, SPEEDS, VelocityController(0.033, 0.16, 6.67)), tmp_path).holds


@needs_mujoco
def test_what_is_not_carried_counts_as_lost(tmp_path: Path) -> None:
    proof = proven(robot_with(("coulomb_friction", "turn_slip")), tmp_path)
    assert proof.lost > FAR * proof.length
    assert proof.holds


def test_a_coupling_that_no_body_has_is_refused() -> None:
    parameters = RobotParameters(*PAPER, effects={"motor_coupling": 0.95})
    with pytest.raises(ValueError, match="motor_coupling"):
        mjcf(ExportedRobot(0, parameters))

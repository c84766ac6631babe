"""The MuJoCo model, stepped by MuJoCo, drives the path of the calibrated robot."""

import importlib.util
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest

from cmr.exporting.carried import BY_TARGET, MJCF
from cmr.exporting.mjcf import LEAST_INERTIA, TIME_STEP, WHEEL_MASS, mjcf
from cmr.exporting.proof import FAR, RUN, STEP, Proof, prove
from cmr.exporting.robot import ExportedRobot
from cmr.model.parameters import RobotParameters
from cmr.model.velocity_controller import VelocityController
from tests.exporting.exported_robots import PAPER, SPEEDS, robot_with
from tests.support.lanes import further

pytestmark = pytest.mark.slow
CREEP = 1e-3  # rad/s
CARRIED = tuple(BY_TARGET[MJCF])
needs_mujoco = pytest.mark.skipif(importlib.util.find_spec("mujoco") is None, reason="mujoco is not installed")


def proven(robot: ExportedRobot, folder: Path) -> Proof:
    path = folder / "robot.xml"
    path.write_text(mjcf(robot))
    return prove(robot, MJCF, path)


@needs_mujoco
@pytest.mark.parametrize(
    "effects",
    [(), *further(*(((name,),) for name in CARRIED))],  # together, below; two sets of them are further ones
    ids="+".join,
)
def test_mujoco_drives_the_path_of_the_robot(effects: tuple[str, ...], tmp_path: Path) -> None:
    proof = proven(robot_with(effects), tmp_path)
    assert proof.lost == 0.0
    assert proof.off < FAR * proof.length


@needs_mujoco
@pytest.mark.parametrize(
    "effects",
    [
        ("motor_gain_asymmetry", "back_emf_asymmetry", "wheel_radius_asymmetry", "motor_coupling", "quadratic_drag"),
        ("command_delay", "electrical_lag", "saturation", "slope"),
        *further(
            (("electrical_lag", "saturation", "coulomb_friction", "wheel_radius_scale"),),
            (("electrical_lag", "current_limit", "quadratic_drag", "motor_gain_asymmetry"),),
        ),
    ],
    ids="+".join,
)
def test_effects_that_it_carries_go_together(effects: tuple[str, ...], tmp_path: Path) -> None:
    assert proven(robot_with(effects), tmp_path).holds


@needs_mujoco
def test_a_robot_with_a_velocity_controller_takes_wheel_speeds(tmp_path: Path) -> None:
    assert proven(ExportedRobot(0, SPEEDS, VelocityController(0.033, 0.16, 6.67)), tmp_path).holds


@needs_mujoco
def test_what_is_not_carried_counts_as_lost(tmp_path: Path) -> None:
    proof = proven(robot_with(("coulomb_friction", "turn_slip")), tmp_path)
    assert proof.lost > FAR * proof.length
    assert proof.holds


@pytest.mark.parametrize("unequal", [-0.04, 0.0, 0.1])
@pytest.mark.parametrize("coupling", [-0.3, 0.0, 0.5])
def test_both_sides_accelerate_and_couple_alike_however_unequal_the_wheels(coupling: float, unequal: float) -> None:
    """By the equations of motion of two wheels that roll: M = I_wheel,i + r_i^2 (m / 4 + J / b^2) on the diagonal."""
    effects = {"motor_coupling": coupling, "wheel_radius_asymmetry": unequal}
    model = ElementTree.fromstring(mjcf(ExportedRobot(0, RobotParameters(*PAPER, effects=effects))))
    *_, base_width = PAPER
    inertial = model.find("worldbody/body/inertial")
    assert inertial is not None
    mass = float(inertial.attrib["mass"]) + 2.0 * WHEEL_MASS
    yaw = float(inertial.attrib["diaginertia"].split()[0]) + 2.0 * WHEEL_MASS * (base_width / 2.0) ** 2
    wheels = [(float(attribute_of(wheel, "geom", "size")), float(attribute_of(wheel, "joint", "armature")))
              for wheel in model.findall("worldbody/body/body")]  # fmt: skip
    own = [armature + LEAST_INERTIA + r**2 * (mass / 4.0 + yaw / base_width**2) for r, armature in wheels]
    assert own[0] == pytest.approx(own[1], rel=1e-12)
    assert min(armature for _, armature in wheels) > 0.0
    between = wheels[0][0] * wheels[1][0] * (mass / 4.0 - yaw / base_width**2)
    assert between / own[0] == pytest.approx(coupling, abs=1e-12)


def attribute_of(body: ElementTree.Element, tag: str, name: str) -> str:
    found = body.find(tag)
    assert found is not None
    return found.attrib[name]


@needs_mujoco
@pytest.mark.parametrize("lag", [0.0, 0.03])
def test_a_voltage_lags_as_long_as_it_should(lag: float, tmp_path: Path) -> None:
    """A step response of two lags in a row: long after it, the angle is behind that of the final speed by their sum."""
    robot = ExportedRobot(0, RobotParameters(*PAPER, effects={"electrical_lag": lag} if lag else {}))
    path = tmp_path / "robot.xml"
    path.write_text(mjcf(robot))
    _, k2_over_k3, k1, _ = PAPER
    duty = np.full(300, 0.3)
    angle = float(RUN[MJCF](robot, path, duty, duty).readings[-1, 0])
    behind = STEP * len(duty) - angle / (duty[0] / k1)  # s
    assert behind - 1.0 / (k1 * k2_over_k3) == pytest.approx(lag, abs=0.2 * TIME_STEP)


@needs_mujoco
def test_sensors_say_what_is_so_when_they_are_read(tmp_path: Path) -> None:
    """Encoders that are late by L fall behind the heading by L times the turn rate; wheels that slip do so a little."""
    driven = proven(robot_with(()), tmp_path)
    radius, _, _, base_width = PAPER
    behind = driven.found[:, 2] - radius * (driven.readings[:, 1] - driven.readings[:, 0]) / base_width
    rate = np.diff(driven.readings[:, 2])
    late = float(np.sum(np.diff(behind) * rate) / np.sum(rate**2))  # s
    assert abs(late) < 0.5 * TIME_STEP


def test_a_coupling_that_no_body_has_is_refused() -> None:
    parameters = RobotParameters(*PAPER, effects={"motor_coupling": 0.95})
    with pytest.raises(ValueError, match="motor_coupling"):
        mjcf(ExportedRobot(0, parameters))


@needs_mujoco
@pytest.mark.parametrize("duty", [0.02, 0.033])
def test_friction_holds_a_wheel_that_the_motor_cannot_turn(duty: float, tmp_path: Path) -> None:
    """Friction of 4 rad/s^2 is more than these duties drive, 2.4 and 3.9 rad/s^2."""
    import mujoco

    path = tmp_path / "robot.xml"
    path.write_text(mjcf(robot_with(("coulomb_friction",))))
    model: Any = mujoco.MjModel.from_xml_path(str(path))
    data: Any = mujoco.MjData(model)
    data.ctrl[:] = duty
    mujoco.mj_step(model, data, nstep=1000)
    assert abs(data.joint("left").qvel[0]) < CREEP

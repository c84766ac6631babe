"""A ROS 2 robot turns as commanded, and its odometry agrees, once the exported parameters are pasted."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import yaml

from cmr.calibration import calibrate
from cmr.exporting.diff_drive import described, ros2_control
from cmr.exporting.robot import exported
from cmr.model.catalogue import effects_on
from cmr.parameters.file import ParameterFile, Value
from cmr.recordings.recording import Recorder
from tests.hidden_effects.robots import draw_robot
from tests.reference_plant import REALISTIC, Commands, drive
from tests.support.diff_drive_controller import DiffDriveController
from tests.support.emulated_drive import DEFAULT, NOMINAL, TRUTH, messages
from tests.support.lanes import further

pytestmark = pytest.mark.slow

PERIOD, TURNING, RATE = 0.02, 20.0, 0.6  # s; s of turning; rad/s
SECONDS = TURNING + 4.0
DESCRIBED = {"wheel_separation": 0.2, "wheel_radius": 0.033}  # as somebody measured it with a ruler
LEAST_BEFORE, MOST_AFTER = 0.05, 0.01  # of a turn
HELD = replace(REALISTIC, torque=0.0)  # a controller of each wheel holds its speed; the ground is as uneven as usual


def turn_errors(parameters: dict[str, Any], robot: dict[str, float], seed: int) -> tuple[float, float]:
    """Return by which share a turn is other than commanded, and other than the controller's odometry says.

    The wheels of the robot, which is the independent plant, follow speeds: each duty is what its motor holds a speed
    with.
    """
    controller = DiffDriveController(parameters)
    time = np.arange(0.0, SECONDS, PERIOD)
    omega = np.where(time < TURNING, RATE, 0.0)
    wheels = controller.wheel_speeds(np.zeros(len(time)), omega, PERIOD)
    commands = Commands(time, *(robot["k1"] * speed for speed in wheels))
    truth = drive(commands, robot, SECONDS, HELD, seed).truth
    turned = float(truth["theta"][-1])
    said = float(controller.odometry(truth["phi_left"], truth["phi_right"])[2][-1])
    return turned / (RATE * TURNING) - 1.0, said / turned - 1.0


@pytest.mark.parametrize("seed", [0, 1, *further(*range(2, 8))])
def test_after_the_paste_a_robot_turns_as_told_and_knows_it(seed: int) -> None:
    random = np.random.default_rng(seed)
    effects = {"wheel_radius_scale": random.uniform(-0.04, 0.04), "wheel_radius_asymmetry": random.uniform(-0.01, 0.01)}
    robot = draw_robot(random) | effects
    values = {name: Value(value) for name, value in robot.items()}
    file = ParameterFile(0, values, tuple(effect.name for effect in effects_on(effects)))
    before, after = turn_errors(DESCRIBED, robot, seed), turn_errors(pasted(file), robot, seed)
    assert max(map(abs, before)) > LEAST_BEFORE
    assert max(map(abs, after)) < MOST_AFTER


def pasted(file: ParameterFile) -> dict[str, Any]:
    """Return the parameters of the controller as exported from a file for the robot description."""
    known = exported(file)
    said = described(known, DESCRIBED["wheel_separation"], DESCRIBED["wheel_radius"])
    parameters: dict[str, Any] = yaml.safe_load(ros2_control(known, said))["diff_drive_controller"]["ros__parameters"]
    return parameters


@pytest.mark.further  # what is known of robots is pasted above
def test_a_figure_eight_calibrates_well_enough_for_the_paste() -> None:
    recorder = Recorder(0)
    for channel, message in messages(DEFAULT):
        recorder.handle(message.utime, channel, message)
    file = calibrate(recorder.recording(), NOMINAL).parameter_file({})
    before, after = turn_errors(DESCRIBED, TRUTH, 0), turn_errors(pasted(file), TRUTH, 0)
    assert max(map(abs, before)) > LEAST_BEFORE
    assert max(map(abs, after)) < MOST_AFTER


def test_the_emulated_controller_drives_the_circle_that_its_equations_say() -> None:
    controller = DiffDriveController({"wheel_separation": 0.3, "wheel_radius": 0.05})
    left, right = controller.wheel_speeds(np.array([0.2]), np.array([0.5]), PERIOD)
    assert (float(left[0]), float(right[0])) == pytest.approx((2.5, 5.5))
    time = np.linspace(0.0, 2.0 * math.pi / 0.5, 4001)
    x, y, theta = controller.odometry(2.5 * time, 5.5 * time)
    assert float(theta[-1]) == pytest.approx(2.0 * math.pi)
    assert float(np.max(y)) == pytest.approx(2.0 * 0.2 / 0.5, rel=1e-5)
    assert math.hypot(float(x[-1]), float(y[-1])) < 1e-5


def test_the_emulated_controller_keeps_its_limits() -> None:
    limits = {"linear": {"x": {"max_velocity": 0.4, "max_acceleration": 1.0}}}
    controller = DiffDriveController({"wheel_separation": 0.3, "wheel_radius": 0.05, **limits})
    left, right = controller.wheel_speeds(np.full(50, 1.0), np.zeros(50), PERIOD)
    assert np.array_equal(left, right)
    assert float(left[0]) == pytest.approx(PERIOD * 1.0 / 0.05)
    assert float(left[-1]) == pytest.approx(0.4 / 0.05)

"""Robots with a velocity controller inside follow the speeds that they are told, by the parameters of their files."""

import math

import numpy as np
import pytest

from cmr.model.catalogue import CATALOGUE
from cmr.model.command_kinds import DUTY
from cmr.model.motion import RobotState, drive
from cmr.model.velocity_controller import VelocityController, response_of
from cmr.parameters.file import ParameterFile, ParameterFileError, Value, parse

RESPONSE_TIME, SCALE, TOP, RADIUS, WIDTH, COMMAND_WIDTH = 0.3, 0.95, 8.0, 0.165, 1.1, 0.6
CONTROLLER = VelocityController(RADIUS, COMMAND_WIDTH, TOP)
ROBOT = ParameterFile(
    5,
    {
        "wheel_radius": Value(RADIUS),
        "base_width": Value(WIDTH),
        "response_time": Value(RESPONSE_TIME, 0.002),
        "speed_scale": Value(SCALE),
        "top_wheel_speed": Value(TOP),
        "command_base_width": Value(COMMAND_WIDTH),
    },
)


def with_values(**changed: float) -> ParameterFile:
    return ParameterFile(5, {**ROBOT.values, **{name: Value(value) for name, value in changed.items()}})


def without(*names: str) -> ParameterFile:
    return ParameterFile(5, {name: value for name, value in ROBOT.values.items() if name not in names})


def test_wheels_follow_a_commanded_body_speed_with_the_response_time() -> None:
    v, omega = 0.5, 0.4
    left, right = CONTROLLER.duties_of_body(np.full(100, v), np.full(100, omega))
    moved = drive(left, right, np.full(100, 0.01), ROBOT.robot_parameters, RobotState.at_rest())
    share = 1.0 - np.exp(-np.arange(101) * 0.01 / RESPONSE_TIME)
    for psi, sign in ((moved.psi_left, -1.0), (moved.psi_right, 1.0)):
        wanted = (v + sign * omega * COMMAND_WIDTH / 2.0) / RADIUS
        assert np.allclose(psi, SCALE * wanted * share, rtol=1e-9)
    # The ground turns it by its own width.
    angle = 1.0 - RESPONSE_TIME * (1.0 - math.exp(-1.0 / RESPONSE_TIME))
    assert moved.theta[-1] == pytest.approx(SCALE * omega * COMMAND_WIDTH / WIDTH * angle, rel=1e-9)


def test_commands_beyond_the_top_wheel_speed_are_cut_off() -> None:
    assert CONTROLLER.duties(2.0 * TOP, -3.0 * TOP) == (1.0, -1.0)


def test_duties_and_what_they_stand_for_are_two_ways_to_say_the_same() -> None:
    assert CONTROLLER.duties_of_body(*CONTROLLER.body_velocity(0.3, -0.2)) == pytest.approx((0.3, -0.2))
    assert CONTROLLER.duties(*CONTROLLER.wheel_speeds(0.3, -0.2)) == pytest.approx((0.3, -0.2))


def test_the_response_is_told_by_the_motor_that_it_stands_for() -> None:
    motor = ROBOT.robot_parameters
    told = response_of({"k2_over_k3": motor.k2_over_k3, "k1": motor.k1}, TOP)
    assert told == pytest.approx({"response_time": RESPONSE_TIME, "speed_scale": SCALE})


def test_a_parameter_file_says_what_kind_of_robot_it_is_of() -> None:
    assert parse(ROBOT.to_yaml()) == ROBOT
    assert ROBOT.has_velocity_controller
    assert ROBOT.velocity_controller == CONTROLLER
    assert without("command_base_width").velocity_controller == VelocityController(RADIUS, WIDTH, TOP)
    motors = ParameterFile(5, {"wheel_radius": Value(0.04), "k1": Value(0.05)})
    assert not motors.has_velocity_controller
    assert motors.velocity_controller is None


@pytest.mark.parametrize("name", ["response_time", "top_wheel_speed", "base_width"])
def test_what_is_missing_for_a_simulation_is_named(name: str) -> None:
    with pytest.raises(ParameterFileError, match=f"{name} is missing"):
        assert without(name).robot_parameters


def test_a_speed_scale_that_is_absent_is_one() -> None:
    assert without("speed_scale").robot_parameters.k1 == 1.0 / TOP


@pytest.mark.parametrize("name", ["k1", "k2_over_k3"])
def test_a_robot_has_a_velocity_controller_or_takes_duties(name: str) -> None:
    with pytest.raises(ParameterFileError, match="one or the other"):
        with_values(**{name: 1.0})


def test_a_limit_of_turns_counts_by_the_width_of_the_commands() -> None:
    limited = ParameterFile(5, {**ROBOT.values, "turn_rate_limit": Value(0.5)}, ("turn_rate_limit",))
    assert limited.robot_parameters.effects["turn_rate_limit_base_width"] == COMMAND_WIDTH


@pytest.mark.parametrize("name", ["saturation", "slew_limit", "current_limit"])
def test_limits_of_commanded_speeds_are_told_in_radians_per_second(name: str) -> None:
    effect = CATALOGUE[name]
    said = effect.sentence_of_speed({name: 0.5}, TOP, 30.0)
    assert f"{0.5 * TOP:.2f} rad/s" in said
    assert "motor" not in said
    assert "duty" not in said


def test_a_limit_of_acceleration_is_told_as_one() -> None:
    said = CATALOGUE["current_limit"].sentence_of_speed({"current_limit": 0.5}, TOP, 30.0)
    assert "at most 15.00 rad/s^2" in said


def test_what_a_velocity_controller_makes_up_for_is_not_told_otherwise() -> None:
    of_duty = [effect for effect in CATALOGUE.values() if effect.with_commands == (DUTY,)]
    assert len(of_duty) > 10
    assert not [effect.name for effect in of_duty if effect.cause_of_speed]

"""An emulated robot with a velocity controller obeys commands as cmr-driver does, and tells what it hides."""

import math
from pathlib import Path

import pytest

from cmr.calibration import calibrate
from cmr.diagnosis.diagnose import diagnose
from cmr.diagnosis.result import NO_EFFECT
from cmr.model.command_kinds import WHEEL_SPEED
from cmr.msg import motor_feedback_t
from robot_driver.command_gate import COMMAND_LIFETIME, LISTENING_TIME
from robot_driver.emulator.settings import Settings, SettingsError, load_settings
from tests.support.emulated_speed_robot import TURN, Bench, nominal_of, recorded

pytestmark = pytest.mark.waits

IDEAL = load_settings(ideal=True)
RADIUS, WIDTH = IDEAL.robot.wheel_radius, IDEAL.velocity_controller.command_base_width
RESPONSE = IDEAL.velocity_controller.response_time
HIDDEN = """
velocity_controller: {response_time: 0.22, speed_scale: 0.96, top_wheel_speed: 16.0}
robot: {base_width: 0.24}
effects: {command_delay: 0.07, pose_offset: 0.03, gyro_bias: 0.01}
"""
SETTLED = 10 * RESPONSE  # s; e^-10 is left


@pytest.fixture
def bench() -> Bench:
    bench = Bench(IDEAL, pose_rate=None)
    bench.wait(LISTENING_TIME + TURN)
    return bench


def hiding(folder: Path, text: str) -> Settings:
    path = folder / "robot.yaml"
    path.write_text(text)
    return load_settings(path)


def test_wheels_follow_the_velocity_with_the_response_time(bench: Bench) -> None:
    bench.drive(0.2, seconds=0.2)
    assert bench.speed == pytest.approx(0.2 / RADIUS * -math.expm1(-0.2 / RESPONSE), rel=1e-3)
    bench.drive(0.1, 0.8, seconds=SETTLED)
    left, right = bench.robot.plant.left.velocity, bench.robot.plant.right.velocity
    assert 0.5 * RADIUS * (left + right) == pytest.approx(0.1, rel=1e-3)
    assert RADIUS * (right - left) / WIDTH == pytest.approx(0.8, rel=1e-3)


def test_wheel_speeds_are_taken_as_they_are() -> None:
    bench = Bench(IDEAL, WHEEL_SPEED, pose_rate=None)
    bench.wait(LISTENING_TIME + TURN)
    for _ in range(100):
        bench.wheel_speeds(2.0, 3.0)
        bench.velocity(1.0)  # another kind, which it does not take
        bench.wait(0.02)
    assert bench.robot.plant.left.velocity == pytest.approx(2.0, rel=1e-3)
    assert bench.robot.plant.right.velocity == pytest.approx(3.0, rel=1e-3)


def test_what_is_too_fast_is_as_fast_as_it_can(bench: Bench) -> None:
    bench.drive(100.0, seconds=SETTLED)
    assert bench.speed == pytest.approx(IDEAL.velocity_controller.top_wheel_speed, rel=1e-3)


def test_a_command_holds_for_half_a_second(bench: Bench) -> None:
    bench.drive(0.2, seconds=SETTLED)
    bench.wait(COMMAND_LIFETIME - 0.03)
    assert bench.speed == pytest.approx(0.2 / RADIUS, rel=1e-3)
    assert not bench.status
    bench.wait(0.03 + SETTLED)
    assert bench.speed < 1e-3 * 0.2 / RADIUS
    assert bench.status == motor_feedback_t.STATUS_COMMAND_STALE


def test_what_was_decided_too_long_ago_or_is_no_number_moves_nothing(bench: Bench) -> None:
    for v, omega, age in ((0.2, 0.0, COMMAND_LIFETIME + 0.01), (math.nan, 0.0, 0.0), (0.2, math.inf, 0.0)):
        bench.velocity(v, omega, age=age)
        bench.wait(0.1)
    assert bench.speed == 0.0
    assert bench.robot.gate.rejected == {"old": 1, "not_finite": 2}
    assert "old 1" in " ".join(bench.robot.gate.remarks())


def test_nothing_moves_before_an_emergency_stop_would_have_been_heard() -> None:
    bench = Bench(IDEAL, pose_rate=None)
    bench.drive(0.2, seconds=LISTENING_TIME - 0.04)
    assert bench.speed == 0.0
    bench.drive(0.2, seconds=0.2)
    assert bench.speed > 0.0


def test_an_emergency_stop_stops_it_and_zero_must_come_before_it_moves_again(bench: Bench) -> None:
    bench.drive(0.2, seconds=0.5)
    bench.estop(True)
    bench.drive(0.2, seconds=SETTLED)
    assert bench.speed < 1e-2
    assert bench.status & motor_feedback_t.STATUS_ESTOP
    bench.estop(False)
    bench.drive(0.2, seconds=0.5)
    assert bench.speed < 1e-2
    bench.drive(0.0, seconds=0.02)
    bench.drive(0.2, seconds=0.5)
    assert bench.speed > 1.0


def test_calibration_finds_what_a_settings_file_hides(tmp_path: Path) -> None:
    settings = hiding(tmp_path, HIDDEN)
    known = {"base_width": 0.2, "response_time": 0.15}
    result = calibrate(recorded(settings, known=known), nominal_of(settings, **known))
    truth = {"response_time": 0.22, "speed_scale": 0.96, "base_width": 0.24}
    hidden = {"command_delay": 0.07, "pose_offset": 0.03, "gyro_bias": 0.01, "wheel_radius_asymmetry": 0.005}
    assert set(result.named) == set(hidden)
    found = {**result.reported, **result.effects}
    for name, value in {**truth, **hidden}.items():
        assert found[name].value == pytest.approx(value, abs=3.0 * found[name].std), name
        assert found[name].std < 0.1 * value, name


def test_a_robot_that_hides_nothing_has_nothing_found_not_even_by_the_beat_of_its_ticks() -> None:
    found = diagnose(recorded(IDEAL), nominal_of(IDEAL))
    assert found.verdict == NO_EFFECT
    assert not found.unexplained.present


def test_a_response_that_the_plant_cannot_follow_is_refused(tmp_path: Path) -> None:
    with pytest.raises(SettingsError, match=r"response_time must be greater than 0\.002 s"):
        hiding(tmp_path, "velocity_controller: {response_time: 0.001}")

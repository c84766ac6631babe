"""The emulated robot moves as physics says; every imperfection can be switched off without a trace."""

import dataclasses
import math
import subprocess
import sys
from typing import Any

import pytest

from cmr.plant.parameters import NEUTRAL, TYPICAL
from robot_driver.emulator.plant import STEP, Plant
from robot_driver.emulator.sensors import MotionCapture, YawGyro
from robot_driver.emulator.settings import Settings, load_settings
from tests.hidden_effects.laws.kinds import KINDS

pytestmark = pytest.mark.waits

IMPERFECTIONS = [
    "coulomb_friction",
    "static_friction",
    "battery_sag",
    "torque_noise",
    "command_delay",
    "turn_slip",
    "longitudinal_slip",
    "slip_noise",
    "encoder_quantisation",
    "gyro_bias",
    "gyro_noise",
    "pose_noise",
    "pose_latency",
]


def plain() -> Settings:
    settings = load_settings()
    off = {
        field.name: dataclasses.replace(getattr(settings.imperfections, field.name), enabled=False)
        for field in dataclasses.fields(settings.imperfections)
    }
    return dataclasses.replace(settings, imperfections=dataclasses.replace(settings.imperfections, **off), effects={})


def hiding(**effects: float) -> Settings:
    return dataclasses.replace(plain(), effects=effects)


def with_one(name: str, **changes: Any) -> Settings:
    settings = plain()
    changed = dataclasses.replace(getattr(settings.imperfections, name), **changes)
    return dataclasses.replace(settings, imperfections=dataclasses.replace(settings.imperfections, **{name: changed}))


def record(settings: Settings) -> list[Any]:
    """Return everything that can be observed during a drive with starts, turns, reversals and a rest."""
    plant = Plant(settings)
    gyro, capture = YawGyro(settings, plant), MotionCapture(settings, plant, 50.0)
    observed: list[Any] = []
    for index in range(200):
        time = (index + 1) * 0.0103  # no multiple of the step
        if index % 25 == 0:
            plant.command(*[(0.4, 0.6), (-0.5, 0.3), (0.0, 0.0), (0.02, -0.002)][index // 25 % 4])
        plant.advance(time)
        observed.append((plant.x, plant.y, plant.theta, plant.left.velocity, plant.right.velocity))
        observed.append((plant.encoder_counts(), plant.battery_voltage(), gyro.rate(0.0103), capture.wake(time)))
    return observed


def test_a_step_of_duty_gives_the_closed_form_speed_and_angle_to_second_order() -> None:
    settings = plain()
    gain = settings.robot.k2_over_k3
    damping = settings.robot.k1 * gain
    plant = Plant(settings)
    plant.command(0.5, 0.5)
    final = 0.5 * gain / damping
    for time in (0.01, 0.1, 0.25, 1.0):
        plant.advance(time)
        # Heun errs by (damping h)^3 / 6 of what is left to go in each step; in sum by no more than this.
        tolerance = final * (damping * STEP) ** 2 / 6.0
        assert plant.left.velocity == pytest.approx(final * (1.0 - math.exp(-damping * time)), abs=tolerance)
        angle = final * (time - (1.0 - math.exp(-damping * time)) / damping)
        assert plant.left.angle == pytest.approx(angle, abs=2.0 * tolerance / damping)


def test_a_constant_turn_is_a_circle_of_the_closed_form_radius() -> None:
    settings = plain()
    plant = Plant(settings)
    plant.command(0.4, 0.6)
    plant.advance(5.0)  # 30 time constants: steady
    x, y, theta, time = plant.x, plant.y, plant.theta, plant.time
    left, right = 0.4 / settings.robot.k1, 0.6 / settings.robot.k1
    rate = settings.robot.wheel_radius * (right - left) / settings.robot.base_width
    radius = settings.robot.base_width / 2.0 * (right + left) / (right - left)
    centre_x, centre_y = x - radius * math.sin(theta), y + radius * math.cos(theta)
    for _ in range(50):
        time += 0.1
        plant.advance(time)
        # Chord for arc: the radius is too small by (rate h)^2 / 24 of itself, 4e-8 here.
        assert math.hypot(plant.x - centre_x, plant.y - centre_y) == pytest.approx(radius, rel=1e-6)
    assert plant.theta - theta == pytest.approx(5.0 * rate, rel=1e-9)


def test_how_often_the_plant_is_asked_changes_the_motion_no_more_than_the_integrator_errs() -> None:
    often, seldom = Plant(plain()), Plant(plain())
    for plant in (often, seldom):
        plant.command(0.7, -0.2)
    for index in range(1, 3001):
        often.advance(index * 0.00037)
    seldom.advance(3000 * 0.00037)
    assert (often.x, often.y, often.theta) == pytest.approx((seldom.x, seldom.y, seldom.theta), abs=1e-4)


@pytest.mark.parametrize("name", ["coulomb_friction", "static_friction"])
def test_friction_holds_a_resting_wheel_below_break_away_and_lets_go_above(name: str) -> None:
    settings = with_one(name, enabled=True, size=2.0)
    break_away = 2.0 / settings.robot.k2_over_k3
    plant = Plant(settings)
    plant.command(0.99 * break_away, -0.99 * break_away)
    plant.advance(1.0)
    assert (plant.left.angle, plant.right.angle) == (0.0, 0.0)
    plant.command(1.01 * break_away, -1.01 * break_away)
    plant.advance(2.0)
    assert plant.left.angle > 0.0 > plant.right.angle


def test_friction_brings_a_rolling_wheel_to_a_complete_stop_after_the_closed_form_time() -> None:
    settings = with_one("coulomb_friction", enabled=True, size=4.0)
    gain = settings.robot.k2_over_k3
    damping = settings.robot.k1 * gain
    plant = Plant(settings)
    plant.command(0.5, 0.5)
    plant.advance(5.0)
    speed = (0.5 * gain - 4.0) / damping
    assert plant.left.velocity == pytest.approx(speed, rel=1e-6)
    plant.command(0.0, 0.0)
    stop = math.log(1.0 + speed * damping / 4.0) / damping
    plant.advance(5.0 + stop - 2 * STEP)
    assert plant.left.velocity > 0.0
    plant.advance(5.0 + stop + 2 * STEP)
    assert plant.left.velocity == 0.0


def test_noise_does_not_move_a_resting_robot() -> None:
    plant = Plant(load_settings())
    plant.advance(30.0)
    assert (plant.x, plant.y, plant.theta, plant.encoder_counts()) == (0.0, 0.0, 0.0, (0, 0))


def test_turn_slip_divides_the_rate_of_turn_by_the_grown_base_width() -> None:
    settings = with_one("turn_slip", enabled=True, size=0.03)
    plant = Plant(settings)
    plant.command(-0.3, 0.3)
    plant.advance(5.0)
    before = plant.theta
    plant.advance(6.0)
    rate = plant.theta - before
    ideal = settings.robot.wheel_radius * 0.6 / settings.robot.k1 / settings.robot.base_width
    assert rate * (1.0 + 0.03 * rate) == pytest.approx(ideal, rel=1e-6)


def test_battery_sag_takes_the_set_share_from_one_stalled_motor_at_full_duty() -> None:
    settings = with_one("battery_sag", enabled=True, size=0.25)
    plant = Plant(settings)
    plant.command(1.0, 0.0)
    assert plant.battery_voltage() == pytest.approx(settings.electrics.battery_voltage * 0.75)


def test_battery_drift_lowers_the_voltage_by_what_has_been_drawn() -> None:
    plant = Plant(hiding(battery_drift=0.5))
    plant.command(0.5, 0.5)
    voltages = [plant.battery_voltage()]
    for time in (1.0, 2.0):
        plant.advance(time)
        voltages.append(plant.battery_voltage())
    assert voltages[0] == plain().electrics.battery_voltage
    assert voltages[0] > voltages[1] > voltages[2] > 0.9 * voltages[0]


@pytest.mark.parametrize("effect", ["encoder_scale", "encoder_asymmetry", "encoder_miscount"])
def test_the_speeds_of_the_encoders_are_those_of_their_counts(effect: str) -> None:
    plant = Plant(hiding(**{effect: 0.1}))
    plant.command(0.9, 0.8)
    plant.advance(5.0)  # no wheel gains any more speed
    before = plant.encoder_counts()
    for step in range(1, 101):
        plant.advance(5.0 + 0.01 * step)
        after = plant.encoder_counts()
    counted = [later - earlier for earlier, later in zip(before, after, strict=True)]
    assert plant.encoder_speeds() == pytest.approx(counted, abs=1.0)
    true = [wheel.velocity * plain().robot.ticks_per_turn / (2.0 * math.pi) for wheel in (plant.left, plant.right)]
    assert all(abs(speed / exact - 1.0) > 0.05 for speed, exact in zip(plant.encoder_speeds(), true, strict=True))


def test_the_currents_are_those_of_unequal_motors() -> None:
    stall = plain().electrics.stall_current
    for effects, expected in (
        ({}, (stall, stall)),
        ({"motor_gain_asymmetry": 0.1}, (1.1 * stall, 0.9 * stall)),
        ({"saturation": 0.6}, (0.6 * stall, 0.6 * stall)),
        ({"current_limit": 0.3}, (0.3 * stall, 0.3 * stall)),
    ):
        plant = Plant(hiding(**effects))
        plant.command(1.0, 1.0)
        assert plant.motor_currents() == pytest.approx(expected)
    plant = Plant(hiding(back_emf_asymmetry=0.1))
    plant.left.velocity = plant.right.velocity = 10.0
    k1 = plain().robot.k1
    assert plant.motor_currents() == pytest.approx((-11.0 * k1 * stall, -9.0 * k1 * stall))


def test_command_delay_puts_the_same_motion_off() -> None:
    late, prompt = Plant(with_one("command_delay", enabled=True, size=0.03)), Plant(plain())
    for plant in (late, prompt):
        plant.command(0.5, 0.2)
    late.advance(1.03)
    prompt.advance(1.0)
    assert (late.x, late.y, late.theta) == pytest.approx((prompt.x, prompt.y, prompt.theta), abs=1e-9)


@pytest.mark.parametrize("name", IMPERFECTIONS)
def test_an_imperfection_of_size_zero_is_bit_for_bit_the_plain_robot(name: str) -> None:
    others: dict[str, dict[str, Any]] = {
        "encoder_quantisation": {"enabled": False},
        "pose_noise": {"enabled": True, "position": 0.0, "heading": 0.0},
    }
    zero = others.get(name, {"enabled": True, "size": 0.0})
    assert record(with_one(name, **zero)) == record(plain())


@pytest.mark.parametrize("name", IMPERFECTIONS)
def test_an_imperfection_that_is_on_changes_what_is_observed(name: str) -> None:
    assert record(with_one(name, enabled=True)) != record(plain())


@pytest.mark.parametrize("effect", TYPICAL)
def test_every_effect_of_the_catalogue_can_be_hidden(effect: str) -> None:
    sizes = dict(TYPICAL[effect])
    sizes.update({name: 0.5 for name in sizes if name.endswith("_change_time")})  # s; the drive is short
    sizes.update({name: 0.5 for name in ("saturation",) if name in sizes})  # below what is commanded
    sizes.update({name: 0.0 for name in ("surface_patch_x", "surface_patch_y") if name in sizes})
    assert record(hiding(**sizes)) != record(plain())


@pytest.mark.parametrize("kind", KINDS)
def test_physics_that_no_effect_describes_can_be_hidden(kind: str) -> None:
    sizes = {**KINDS[kind].sizes, **{name: 0.5 for name in KINDS[kind].sizes if name == "puncture_time"}}  # s
    sizes.update({name: 1.0 for name in sizes if name == "encoder_overspeed_from"})  # rad/s; the drive is slow
    sizes.update({name: 0.02 for name in sizes if name == "regeneration_limit"})
    sizes.update({name: 0.0 for name in sizes if name == "breakaway_skid_from"})
    assert record(hiding(**sizes)) != record(plain())


@pytest.mark.parametrize("effect", TYPICAL)
def test_an_effect_at_its_neutral_value_is_bit_for_bit_the_plain_robot(effect: str) -> None:
    neutral = {name: getattr(NEUTRAL, name) for name in TYPICAL[effect]}
    assert record(hiding(**neutral)) == record(plain())


@pytest.mark.parametrize("effect", ["gyro_latency", "gyro_scale", "gyro_drift", "clock_skew", "pose_latency"])
def test_the_sensors_err_by_what_is_hidden_in_them(effect: str) -> None:
    size = {"gyro_latency": 0.1, "clock_skew": 0.01}.get(effect, 0.05)
    settings = hiding(**{effect: size})
    plant = Plant(settings)
    gyro, capture = YawGyro(settings, plant), MotionCapture(settings, plant, 50.0)
    plant.command(-0.4, 0.4)
    thetas, rates = [0.0], []
    for number in range(1, 101):
        plant.advance(0.01 * number)
        thetas.append(plant.theta)
        rates.append(gyro.rate(0.01))
    pose = capture.wake(1.0)
    turned = {"gyro_latency": thetas[90] - thetas[89], "gyro_scale": (thetas[100] - thetas[99]) * 1.05}
    rate = turned.get(effect, thetas[100] - thetas[99]) / 0.01
    rate += size * 1.0 / 100.0 if effect == "gyro_drift" else 0.0
    assert rates[-1] == pytest.approx(rate, abs=1e-9)
    assert pose.time == pytest.approx({"clock_skew": 1.01, "pose_latency": 1.05}.get(effect, 1.0))


def test_of_the_commands_as_many_are_lost_as_is_set() -> None:
    lossy = Plant(hiding(command_loss=0.3))
    taken = 0
    for number in range(1000):
        duty = 0.3 + 1e-4 * number
        lossy.command(duty, duty)
        lossy.advance(0.01 * (number + 1))
        taken += lossy.left.duty == duty
    assert taken / 1000 == pytest.approx(0.7, abs=0.06)


def test_no_command_overtakes_another() -> None:
    plant, newest = Plant(hiding(command_jitter=0.05)), 0.0
    for number in range(500):
        duty = 1e-3 * (number + 1)
        plant.command(duty, duty)
        plant.advance(0.01 * (number + 1))
        assert newest <= plant.left.duty <= duty
        newest = plant.left.duty


def test_by_default_motors_and_wheels_differ_as_those_of_robots_do() -> None:
    parameters = Plant(load_settings()).parameters
    assert 0.02 <= parameters.motor_gain_asymmetry <= 0.03
    assert parameters.wheel_radius_asymmetry == 0.005


def test_the_list_of_imperfections_above_is_complete() -> None:
    assert [field.name for field in dataclasses.fields(load_settings().imperfections)] == IMPERFECTIONS


def test_the_same_seed_gives_the_same_drive_and_another_seed_another() -> None:
    assert record(load_settings()) == record(load_settings())
    assert record(load_settings()) != record(load_settings(seed=1))


def test_the_gyro_averages_over_its_period_and_the_sensors_see_the_truth_when_perfect() -> None:
    settings = plain()
    plant = Plant(settings)
    gyro, capture = YawGyro(settings, plant), MotionCapture(settings, plant, 50.0)
    plant.command(-0.4, 0.4)
    plant.advance(0.5)
    assert gyro.rate(0.5) == plant.theta / 0.5 > 0.0  # counter-clockwise is positive
    pose = capture.wake(0.5)
    assert (pose.x, pose.y) == (plant.x, plant.y)
    assert pose.theta == pytest.approx(math.remainder(plant.theta, 2.0 * math.pi))


def test_sensor_noise_has_the_set_size() -> None:
    settings = load_settings()
    plant = Plant(settings)
    gyro, capture = YawGyro(settings, plant), MotionCapture(settings, plant, 50.0)
    count = 4000
    rates = [gyro.rate(0.01) for _ in range(count)]
    xs = [capture.wake(0.0).x for _ in range(count)]
    mean = sum(rates) / count
    five_sigma = 5.0 / math.sqrt(count)
    assert mean == pytest.approx(0.002, abs=0.005 * five_sigma)
    assert math.sqrt(sum((rate - mean) ** 2 for rate in rates) / count) == pytest.approx(0.005, rel=five_sigma)
    assert math.sqrt(sum(x * x for x in xs) / count) == pytest.approx(0.003, rel=five_sigma)


def test_the_emulated_robot_shares_no_code_with_the_model_and_the_driver() -> None:
    modules = ("plant", "sensors", "roboclaw_device", "dsp3000_device", "engine")
    imports = "; ".join(f"import robot_driver.emulator.{module}" for module in modules)
    listing = "import sys; print('\\n'.join(sys.modules))"
    ended = subprocess.run([sys.executable, "-c", f"{imports}; {listing}"], capture_output=True, text=True, check=True)
    ours = {name for name in ended.stdout.split() if name.split(".")[0] in ("cmr", "robot_driver")}
    foreign = {name for name in ours if not name.startswith(("robot_driver.emulator", "cmr.plant"))}
    readers = {"cmr.documents", *(f"cmr.documents.{name}" for name in ("bounds", "declared", "document", "structure"))}
    readers |= {"cmr.files", "cmr.litter", "cmr.plain_text"}
    assert foreign <= {"robot_driver", "cmr", "cmr.priority", *readers}  # of which none moves

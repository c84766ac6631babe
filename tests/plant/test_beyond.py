"""Physics of the literature that no effect describes, against closed forms; each is absent at its neutral value."""

import math
from collections.abc import Mapping

import numpy as np
import pytest

from cmr.plant.parameters import NEUTRAL, RANGES
from cmr.recordings.signal import Floats
from tests.hidden_effects.laws.kinds import KINDS
from tests.reference_plant import Commands, drive, packets
from tests.reference_plant.drives import true_motion
from tests.reference_plant.manoeuvres import constant, reversals

pytestmark = pytest.mark.slow

TURN = Commands(np.zeros(1), np.array([0.3]), np.array([0.5]))
STRAIGHT = Commands(np.zeros(1), np.array([0.4]), np.array([0.4]))
LATE = 6.0  # s, after which motors have reached their speed to 1e-15
K1, R, B = NEUTRAL.k1, NEUTRAL.wheel_radius, NEUTRAL.base_width


def at(seconds: float, parameters: Mapping[str, float], commands: Commands = TURN) -> dict[str, float]:
    """The state at the end of a drive."""
    states = true_motion(commands, parameters, np.array([seconds]), step=1e-3)
    return {name: float(values[0]) for name, values in states.items()}


def balance(state: Mapping[str, float], side: str, duty: float) -> float:
    """What brakes one side at constant speed [rad/s^2]: what the motor gives."""
    return NEUTRAL.k2_over_k3 * (duty - K1 * state[f"psi_{side}"])


def test_every_parameter_of_a_kind_is_one_of_the_plant_and_typical_sizes_are_possible() -> None:
    for kind in KINDS.values():
        for name, size in kind.sizes.items():
            least, largest = RANGES[name]
            assert least <= size <= largest, name


def test_at_least_twenty_five_kinds_are_there_and_six_are_no_formula_of_the_grammar() -> None:
    assert len(KINDS) >= 25
    assert sum(not kind.in_grammar for kind in KINDS.values()) >= 6


@pytest.mark.parametrize("kind", KINDS)
def test_a_kind_of_size_zero_is_bit_for_bit_the_plain_robot(kind: str) -> None:
    constants = {
        name: size for name, size in KINDS[kind].sizes.items() if name != kind and name != "regeneration_limit"
    }
    commands = packets(reversals(0.5, (0.4,)), 6.0)
    plain, absent = (drive(commands, sizes, 6.0).recording for sizes in ({}, constants))
    for name, signal in plain.signals.items():
        for field, values in signal.fields.items():
            assert np.array_equal(values, absent.signals[name][field], equal_nan=True), (name, field)


def test_bridge_loss_takes_a_constant_duty_and_lets_no_current_flow_below_it() -> None:
    state = at(LATE, {"bridge_loss": 0.02, "coulomb_friction": 4.0})
    for side, duty in (("left", 0.3), ("right", 0.5)):
        assert balance(state, side, duty - 0.02) == pytest.approx(4.0, rel=1e-9)
    assert (
        at(1.0, {"bridge_loss": 0.02}, Commands(np.zeros(1), np.full(1, 0.019), np.full(1, 0.021)))["psi_left"] == 0.0
    )


def test_friction_of_bearings_oil_and_a_brake_is_that_of_its_formula_at_speed() -> None:
    for parameters, braking in (
        ({"bearing_drag": 1.2}, lambda psi: 1.2 * abs(psi) ** (2.0 / 3.0)),
        ({"boundary_lubrication": 3.0}, lambda psi: 3.0 * math.exp(-abs(psi) / 5.0)),
    ):
        state = at(LATE, parameters)
        for side, duty in (("left", 0.3), ("right", 0.5)):
            assert balance(state, side, duty) == pytest.approx(braking(state[f"psi_{side}"]), rel=1e-3)
    rubbed = at(LATE, {"brake_drag": 2.5})
    assert balance(rubbed, "left", 0.3) == pytest.approx(2.5, rel=1e-9)
    assert balance(rubbed, "right", 0.5) == pytest.approx(0.0, abs=1e-9)


def test_what_acts_against_a_turn_pushes_both_sides_apart_equally() -> None:
    coupled = at(LATE, {"cross_coupling": 0.12})
    difference = coupled["psi_right"] - coupled["psi_left"]
    assert difference == pytest.approx(0.2 / K1 / (1.0 + 2.0 * 0.12), rel=1e-9)
    scrubbed = at(LATE, {"turning_resistance": 2.0, "turning_resistance_rate": 0.5})
    w = R * (scrubbed["psi_right"] - scrubbed["psi_left"]) / B
    assert balance(scrubbed, "right", 0.5) == pytest.approx(2.0 * math.tanh(w / 0.5), rel=1e-9)
    assert balance(scrubbed, "left", 0.3) == pytest.approx(-2.0 * math.tanh(w / 0.5), rel=1e-9)


def test_a_mass_ahead_of_the_axle_couples_speed_and_turn_without_work() -> None:
    state = at(LATE, {"mass_ahead": 0.02})
    v, w = R * (state["psi_left"] + state["psi_right"]) / 2.0, R * (state["psi_right"] - state["psi_left"]) / B
    ahead = -(balance(state, "left", 0.3) + balance(state, "right", 0.5)) / 2.0
    turning = (balance(state, "right", 0.5) - balance(state, "left", 0.3)) / 2.0
    assert ahead == pytest.approx(0.02 * w * w / R, rel=1e-9)
    assert turning == pytest.approx(2.0 * 0.02 * v * w / (R * B), rel=1e-9)
    # m v dv/dt + I w dw/dt = 0 with I = m (b/2)^2.
    assert v * ahead * R == pytest.approx((B / 2.0) ** 2 * w * turning * 2.0 * R / B, rel=1e-9)


def test_gears_pass_a_share_of_the_torque_when_they_drive() -> None:
    state = at(LATE, {"gear_loss": 0.08, "quadratic_drag": 0.06})
    for side, duty in (("left", 0.3), ("right", 0.5)):
        drag = 0.06 * state[f"psi_{side}"] ** 2
        assert balance(state, side, duty) == pytest.approx(drag / (1.0 - 0.08), rel=1e-6)


def test_large_currents_and_warm_windings_give_less_torque() -> None:
    short = 1e-3  # s; the wheels hardly move
    plain = at(short, {})["psi_right"]
    assert at(short, {"armature_reaction": 0.3})["psi_right"] == pytest.approx(plain * (1.0 - 0.3 * 0.5), rel=1e-2)
    held = {"winding_heat": 1.0, "winding_heat_memory": 0.05, "k2_over_k3": 1e-3}
    warm = at(2.0, held)["domega_right"] / 1e-3  # a heavy wheel: the winding has all the heat of the whole effort
    assert warm == pytest.approx(0.5 * (1.0 - 0.5**2), rel=1e-3)


def test_a_battery_remembers_its_load() -> None:
    state = at(LATE, {"battery_relaxation": 0.3, "battery_relaxation_memory": 0.1})
    left, right = K1 * state["psi_left"], K1 * state["psi_right"]
    q = 0.3 * (0.3 - 0.8 * left) + 0.5 * (0.5 - 0.8 * right)
    assert (left, right) == pytest.approx((0.3 * (1.0 - 0.3 * q), 0.5 * (1.0 - 0.3 * q)), rel=1e-6)


def test_braking_is_limited_and_driving_is_not() -> None:
    commands = Commands(np.array([0.0, 2.0]), np.array([0.5, 0.0]), np.array([0.5, 0.0]))
    limited, free = (at(2.05, sizes, commands) for sizes in ({"regeneration_limit": 0.2}, {}))
    start = 0.5 / K1
    assert limited["psi_left"] == pytest.approx(start - 0.2 * NEUTRAL.k2_over_k3 * 0.05, rel=1e-5)
    assert free["psi_left"] < limited["psi_left"]
    assert at(0.5, {"regeneration_limit": 0.2}) == at(0.5, {})


def test_floors_and_tethers_pull_towards_their_place() -> None:
    sagging = true_motion(STRAIGHT, {"floor_sag": 1.5}, np.array([4.0]), start=(0.3, -0.2, 0.0), step=1e-3)
    x, psi, domega = (float(sagging[name][0]) for name in ("x", "psi_left", "domega_left"))
    assert domega == pytest.approx(NEUTRAL.k2_over_k3 * (0.4 - K1 * psi) - 1.5 * x, abs=0.02)
    reel = true_motion(STRAIGHT, {"reel_pull": 1.5, "reel_x": -50.0}, np.array([4.0]), step=1e-3)
    braking = NEUTRAL.k2_over_k3 * (0.4 - K1 * float(reel["psi_left"][0]))
    assert braking == pytest.approx(1.5, rel=1e-2)


def test_a_liquid_swings_at_its_frequency_and_slows_the_start() -> None:
    times = np.arange(400) * 0.01
    sizes = {"slosh": 0.1, "slosh_frequency": 1.2, "slosh_damping": 0.02}
    error = (
        true_motion(STRAIGHT, sizes, times, step=1e-3)["psi_left"]
        - true_motion(STRAIGHT, {}, times, step=1e-3)["psi_left"]
    )
    assert error[5] < 0.0
    turns = np.flatnonzero(np.diff(np.sign(error[20:])))
    assert np.mean(np.diff(turns)) * 0.01 == pytest.approx(0.5 / 1.2, rel=0.05)


def test_ways_over_the_ground_follow_their_formulas() -> None:
    plain = at(LATE, {})
    v, w = R * (plain["psi_left"] + plain["psi_right"]) / 2.0, plain["w"]
    assert at(LATE, {"understeer": 0.25})["w"] == pytest.approx(w / (1.0 + 0.25 * v * v), rel=1e-9)
    curvature = (0.5 + 0.3) / (0.5 - 0.3)
    wide = 1.0 + 0.12 / (1.0 + 0.7 * math.sqrt(curvature))
    assert at(LATE, {"curvature_slip": 0.12, "curvature_slip_scale": 0.7})["w"] == pytest.approx(w / wide, rel=1e-9)
    flat = {"puncture": 0.02, "puncture_time": 3.0}
    assert at(LATE, flat)["w"] == pytest.approx(w + 0.02 * R * plain["psi_left"] / B, rel=1e-9)
    assert at(2.9, flat) == at(2.9, {})


def test_drift_by_carpets_and_sliding_tyres_is_that_of_the_way() -> None:
    plain = at(LATE, {}, STRAIGHT)
    carpet = at(LATE, {"carpet_drift": 0.04, "carpet_drift_direction": 1.1}, STRAIGHT)
    assert carpet["x"] == pytest.approx(plain["x"] * (1.0 + 0.04 * math.cos(1.1)), rel=1e-9)
    assert carpet["y"] == pytest.approx(plain["x"] * 0.04 * math.sin(1.1), rel=1e-9)
    spot = {"slippery_spot": 0.1, "slippery_spot_x": 0.5, "slippery_spot_radius": 0.3}
    # 0.6 m of floor take 1 / 0.9 as much rolling.
    assert at(LATE, spot, STRAIGHT)["x"] == pytest.approx(plain["x"] - 0.6 * (1.0 / 0.9 - 1.0), abs=2e-3)
    calm, sliding = ({"breakaway_skid": 0.2, "breakaway_skid_from": limit} for limit in (10.0, 0.0))
    assert at(LATE, calm) == at(LATE, {})
    assert at(LATE, sliding) == pytest.approx(at(LATE, {"lateral_skid": 0.2}), rel=1e-12)


def errors_of(parameters: Mapping[str, float]) -> tuple[Mapping[str, Floats], Mapping[str, Floats], Floats]:
    """What gyro and poses (unwrapped) say wrongly, and the truth at the moments of the gyro."""
    driven = drive(packets(constant(0.3, 0.5), 10.0), parameters, 10.0)
    true, seen = driven.truth, driven.recording
    poses = {name: seen.poses[name] - true[name][::4] for name in ("x", "y")}
    poses["theta"] = np.unwrap(seen.poses["theta"]) - true["theta"][::4]
    return (
        {name: true[name] for name in ("x", "y", "theta", "w", "psi_left", "psi_right")},
        poses,
        seen.gyro["yaw_rate"] - true["w"],
    )


def test_gyros_err_by_their_formulas() -> None:
    time = np.arange(1001) * 0.01
    for sizes in (
        {"gyro_asymmetry": 0.01},
        {"gyro_vibration": 0.06},
        {"gyro_warm_up": 0.02, "gyro_warm_up_memory": 4.0},
        {"gyro_field": 0.01, "gyro_field_direction": 0.8},
        {"lidar_imbalance": 0.01, "lidar_imbalance_frequency": 5.5, "lidar_imbalance_phase": 0.3},
    ):
        true, _, error = errors_of(sizes)
        v = R * (true["psi_left"] + true["psi_right"]) / 2.0
        expected = {
            "gyro_asymmetry": 0.01 * np.abs(true["w"]),
            "gyro_vibration": 0.06 * v**2,
            "gyro_warm_up": 0.02 * np.exp(-time / 4.0),
            "gyro_field": 0.01 * np.cos(true["theta"] - 0.8),
            "lidar_imbalance": 0.01 * np.sin(2.0 * math.pi * 5.5 * time + 0.3),
        }
        assert error == pytest.approx(expected[next(iter(sizes))], abs=1e-12)


def test_poses_err_by_their_formulas() -> None:
    true, poses, _ = errors_of({"body_roll": 0.03})
    v = R * (true["psi_left"] + true["psi_right"]) / 2.0
    lean = (0.03 * v * true["w"])[::4]
    assert poses["x"] == pytest.approx(lean * np.sin(true["theta"][::4]), abs=1e-12)
    assert poses["y"] == pytest.approx(-lean * np.cos(true["theta"][::4]), abs=1e-12)
    true, poses, _ = errors_of({"pixel_aspect": 0.01})
    assert poses["x"] == pytest.approx(0.01 * true["x"][::4], abs=1e-12)
    assert poses["y"] == pytest.approx(0.0, abs=1e-12)
    true, poses, _ = errors_of({"compass_deviation": 0.02, "compass_deviation_direction": 0.4})
    assert poses["theta"] == pytest.approx(0.02 * np.cos(true["theta"][::4] - 0.4), abs=1e-12)


def test_an_encoder_loses_what_comes_too_fast() -> None:
    driven = drive(packets(constant(0.2, 0.8), 10.0), {"encoder_overspeed": 0.1, "encoder_overspeed_from": 7.0}, 10.0)
    for side, duty in (("left", 0.2), ("right", 0.8)):
        psi = duty / K1
        counted = driven.recording.wheels[f"psi_{side}"][-1]
        assert counted == pytest.approx(psi - 0.1 * max(0.0, psi - 7.0), rel=1e-6)

"""The reference plant against closed forms, and against itself at other steps: what checks the model must be right."""

import math
from collections.abc import Mapping

import numpy as np
import pytest

from cmr.calibration import calibrate
from cmr.plant import sensors
from cmr.plant.parameters import plant_parameters
from cmr.recordings.signal import Floats
from tests.reference_plant import NEUTRAL, REALISTIC, TYPICAL, Commands, Noise, drive, packets, recording
from tests.reference_plant.drives import Pose, arrivals, true_motion, utime
from tests.reference_plant.manoeuvres import (
    RICH_DRIVE_SECONDS,
    Manoeuvre,
    constant,
    figure_eight,
    reversals,
    rich_drive,
)
from tests.reference_plant.steering import steered

pytestmark = pytest.mark.slow

RATE = NEUTRAL.k1 * NEUTRAL.k2_over_k3  # 1/s, one over the motor's time constant
SENSORS = ("encoder", "gyro", "pose", "clock")
OF_MOTION = [name for name in TYPICAL if not name.startswith(SENSORS)]
CONSTANT = Commands(np.zeros(1), np.array([0.3]), np.array([0.5]))
COAST_AFTER = 2.0  # s


def every(period: float, seconds: float) -> Floats:
    """Times from 0 to `seconds` [s]."""
    return np.arange(round(seconds / period) + 1, dtype=np.float64) * period


def after(seconds: float, parameters: Mapping[str, float], commands: Commands = CONSTANT) -> dict[str, float]:
    """The state at the end of a drive."""
    states = true_motion(commands, parameters, np.array([seconds]), step=1e-4)
    return {name: float(values[0]) for name, values in states.items()}


def ground_speed_difference(state: Mapping[str, float]) -> float:
    return NEUTRAL.wheel_radius * (state["psi_right"] - state["psi_left"])


def test_wheel_speeds_are_the_solution_of_the_papers_motor_equation() -> None:
    times = np.array([0.01, 0.1, 0.5])
    states = true_motion(CONSTANT, {}, times)
    # Heun's method errs by (rate h)^2 / 6 of the speed: 7e-10 at steps of 10 us.
    expected = 0.3 / NEUTRAL.k1 * -np.expm1(-RATE * times)
    assert states["psi_left"] == pytest.approx(expected, rel=1e-8)


def test_a_controller_brings_wheels_to_the_speed_asked_for_with_its_response_time() -> None:
    times = np.array([0.05, 0.3, 1.5])
    robot = {"controller_response_time": 0.3, "controller_scale": 0.9, "battery_sag": 0.2}
    states = true_motion(CONSTANT, robot, times, step=1e-4)
    expected = 0.9 * 0.3 / NEUTRAL.k1 * -np.expm1(-times / 0.3)
    assert states["psi_left"] == pytest.approx(expected, rel=1e-7)


def test_a_controller_accelerates_no_faster_than_its_limit() -> None:
    robot = {"controller_response_time": 0.02, "controller_acceleration": 3.0}
    times = np.array([0.4, 1.0])
    states = true_motion(CONSTANT, robot, times, step=1e-4)
    assert states["psi_left"] == pytest.approx(3.0 * times, rel=1e-7)


def test_constant_wheel_speeds_drive_a_circle_of_the_radius_that_geometry_demands() -> None:
    times = every(0.2, 15.0)[25:]  # 32 time constants after the start
    states = true_motion(CONSTANT, {}, times, step=1e-4)
    x, y, theta = states["x"], states["y"], states["theta"]
    radius = NEUTRAL.base_width / 2.0 * (0.5 + 0.3) / (0.5 - 0.3)
    centre_x, centre_y = x - radius * np.sin(theta), y + radius * np.cos(theta)
    assert np.ptp(centre_x) < 1e-7
    assert np.ptp(centre_y) < 1e-7


@pytest.mark.parametrize("effect", OF_MOTION)
@pytest.mark.parametrize("manoeuvre", [figure_eight(10.0, 1), reversals(0.5, (0.8,))], ids=["eight", "reversals"])
def test_five_times_the_step_changes_the_path_by_less_than_ten_micrometres(effect: str, manoeuvre: Manoeuvre) -> None:
    sizes = {name: 4.1 if name.endswith("_time") else size for name, size in TYPICAL[effect].items()}
    commands = packets(manoeuvre, 10.0)
    times = every(0.01, 10.0)
    fine, coarse = (true_motion(commands, sizes, times, step=step) for step in (2e-5, 1e-4))
    # Of second order where smooth; a kink met within a step costs at most its jump times the square of the step.
    assert np.hypot(fine["x"] - coarse["x"], fine["y"] - coarse["y"]).max() < 1e-5


def test_battery_sag_lowers_the_final_speed_by_its_equation() -> None:
    state = after(6.0, {"battery_sag": 0.2})
    left, right = NEUTRAL.k1 * state["psi_left"], NEUTRAL.k1 * state["psi_right"]
    q = 0.3 * (0.3 - 0.8 * left) + 0.5 * (0.5 - 0.8 * right)
    assert (left, right) == pytest.approx((0.3 * (1.0 - 0.2 * q), 0.5 * (1.0 - 0.2 * q)), rel=1e-9)


def test_turn_slip_widens_the_base_by_the_turn_rate_it_leaves() -> None:
    state = after(6.0, {"turn_slip": 0.03})
    wanted = ground_speed_difference(state) / NEUTRAL.base_width
    assert state["w"] * (1.0 + 0.03 * state["w"]) == pytest.approx(wanted, rel=1e-12)


def test_coupled_motors_share_their_acceleration_from_rest() -> None:
    state = after(1e-4, {"motor_coupling": 0.15}, Commands(np.zeros(1), np.array([0.5]), np.array([0.5])))
    # domega = a u - c domega on both sides.
    assert state["domega_left"] == pytest.approx(NEUTRAL.k2_over_k3 * 0.5 / 1.15, rel=1e-3)


@pytest.mark.parametrize(("share", "moves"), [(0.999, False), (1.001, True)])
def test_a_wheel_sets_off_when_the_motor_exceeds_the_break_away_friction(share: float, moves: bool) -> None:
    duty = np.array([share * (4.0 + 14.0) / NEUTRAL.k2_over_k3])
    state = after(3.0, {"coulomb_friction": 4.0, "static_friction": 14.0}, Commands(np.zeros(1), duty, duty))
    assert (state["x"] > 0.0) == moves


def test_a_coasting_wheel_comes_to_rest_when_friction_has_eaten_its_speed_and_stays() -> None:
    commands = Commands(np.array([0.0, COAST_AFTER]), np.array([0.5, 0.0]), np.array([0.5, 0.0]))
    times = every(0.01, 4.0)
    states = true_motion(commands, {"coulomb_friction": 4.0}, times)
    before = states["psi_left"][times == COAST_AFTER][0]
    # psi(t) = (psi_0 + c / rate) e^(-rate t) - c / rate until it is 0.
    coasted = times - COAST_AFTER
    expected = (before + 4.0 / RATE) * np.exp(-RATE * coasted) - 4.0 / RATE
    moving = (coasted >= 0.0) & (expected > 0.0)
    assert states["psi_left"][moving] == pytest.approx(expected[moving], abs=1e-7)
    assert not states["psi_left"][(coasted > 0.0) & ~moving].any()


def test_backlash_takes_the_whole_gap_out_of_a_reversal() -> None:
    time, duty = np.array([0.0, 2.0, 4.0]), np.array([0.5, -0.5, 0.5])
    states = true_motion(Commands(time, duty, duty), {"backlash": 0.12}, np.array([2.0, 4.0]), step=1e-4)
    shaft = np.diff(states["phi_left"])[0]
    wheel = np.diff(states["x"])[0] / NEUTRAL.wheel_radius
    # Between 2 s and 4 s the shaft turned on, stopped and came back: the wheel lags by the gap on the way back.
    assert wheel - shaft == pytest.approx(0.12, abs=1e-9)


def test_late_packets_come_in_order_within_the_jitter_and_lost_ones_never() -> None:
    sent = every(0.02, 40.0)
    p = plant_parameters({"command_delay": 0.03, "command_jitter": 0.04, "command_loss": 0.2})
    arrival, number = arrivals(p, sent, np.random.default_rng(5))
    assert np.all(np.diff(arrival) > 0.0)
    assert np.all(np.diff(number) > 0)
    delays = arrival - sent[number]
    assert delays.min() >= 0.03 - 1e-9
    assert delays.max() <= 0.07 + 1e-9
    assert len(arrival) < 0.85 * len(sent)


def test_a_late_pose_on_a_fast_clock_is_where_the_robot_was() -> None:
    sizes = {"pose_latency": 0.04, "clock_skew": 5e-4, "pose_offset": 0.1, "pose_offset_lateral": -0.03}
    driven = drive(packets(constant(0.3, 0.5), 10.0), sizes, 10.0)
    poses = driven.recording.poses
    when = np.maximum(poses.seconds / 1.0005 - 0.04, 0.0)
    states = true_motion(packets(constant(0.3, 0.5), 10.0), {}, when, step=1e-3)
    place = states["x"] + 1j * states["y"] + (0.1 - 0.03j) * np.exp(1j * states["theta"])
    assert poses["x"] == pytest.approx(place.real, abs=1e-9)
    assert poses["y"] == pytest.approx(place.imag, abs=1e-9)


def test_a_filter_shows_a_circle_smaller_and_turned_back() -> None:
    """A first-order filter of T makes the turn w smaller by 1 / sqrt(1 + (w T)^2) and late by atan(w T)."""
    time = np.linspace(0.0, 5.0, 5001)
    x = sensors.filtered(time, np.cos(3.0 * time), 0.2)[3000:]  # what it began with is gone by then
    expected = np.cos(3.0 * time[3000:] - math.atan(0.6)) / math.hypot(1.0, 0.6)
    assert x == pytest.approx(expected, abs=1e-5)  # the chord of a step is 1e-6 inside of the arc


def test_a_coarse_encoder_counts_whole_steps_and_is_never_a_step_off() -> None:
    sizes = {"encoder_quantisation": 48.0}
    driven = drive(packets(constant(0.3, 0.5), 5.0), sizes, 5.0, Noise(ticks_per_turn=480.0))
    count = driven.recording.wheels["ticks_left"]
    assert np.all(np.remainder(count, 10.0) == 0.0)
    behind = driven.truth["phi_left"] / (2.0 * math.pi) * 480.0 - count
    # It began somewhere between two edges.
    assert -10.0 < behind.min() <= 0.0 < behind.max() < 10.0
    assert np.ptp(behind) < 10.0


def test_the_same_seed_gives_the_same_drive_and_another_seed_another() -> None:
    commands = packets(figure_eight(10.0, 1), 10.0)
    first, again, other = (recording(commands, {}, 10.0, REALISTIC, seed) for seed in (3, 3, 4))
    assert np.array_equal(first.poses["x"], again.poses["x"])
    assert np.array_equal(first.gyro["yaw_rate"], again.gyro["yaw_rate"])
    assert not np.array_equal(first.poses["x"], other.poses["x"])


def test_the_noise_of_the_poses_has_the_size_and_the_memory_asked_for() -> None:
    noise = Noise(position=0.005, pose_time=0.1)
    x = recording(packets(constant(0.0, 0.0), 1000.0), {}, 1000.0, noise).poses["x"]
    neighbours = np.corrcoef(x[1:], x[:-1])[0, 1]
    # 25,000 samples of which some 5,000 are independent: 1 % of the size, 0.01 of the correlation.
    assert x.std() == pytest.approx(0.005, rel=0.04)
    assert neighbours == pytest.approx(math.exp(-0.04 / 0.1), abs=0.04)


def test_a_quiet_figure_eight_calibrates_to_the_truth() -> None:
    estimates = calibrate(recording(packets(figure_eight(40.0, 2), 40.0), {}, 40.0)).estimates
    for name in ("k2_over_k3", "k1", "base_width"):
        # An average over what the drive may hide is less exact than the data.
        assert estimates[name].value == pytest.approx(getattr(NEUTRAL, name), rel=5e-4), name
        assert abs(estimates[name].value - getattr(NEUTRAL, name)) < estimates[name].std, name


def test_the_rich_drive_rests_at_both_ends_and_uses_both_directions_at_every_speed() -> None:
    commands = packets(rich_drive(), RICH_DRIVE_SECONDS)
    for rest in (commands.time < 2.9, commands.time > RICH_DRIVE_SECONDS - 2.9):
        assert not commands.left[rest].any()
        assert not commands.right[rest].any()
    for duty in (commands.left, commands.right):
        assert (duty.min(), duty.max()) == pytest.approx((-0.9, 0.9))
    assert not np.any(np.abs(np.concatenate([commands.left, commands.right])) > 1.0)


def test_the_motion_under_a_pilots_commands_is_the_one_that_the_pilot_saw() -> None:
    seen: list[tuple[float, Pose]] = []

    def pilot(time: float, pose: Pose) -> tuple[float, float]:
        seen.append((time, pose))
        return 0.3 + 0.1 * math.cos(time), 0.4 - 0.2 * pose[2]

    sizes = {**TYPICAL["command_jitter"], **TYPICAL["command_loss"], "traction_loss": 0.5}
    noise = Noise(torque=0.3, slip=0.003)
    commands = steered(pilot, sizes, 20.0, noise, seed=4)
    driven = drive(commands, sizes, 20.0, noise, seed=4)
    at_poses = dict(zip(driven.truth.utime.tolist(), driven.truth["x"], strict=True))
    for time, pose in seen:
        assert pose[0] == pytest.approx(at_poses[int(utime(np.array([time]))[0])], abs=1e-12)


def test_a_pilot_sees_the_robot_where_it_was_a_latency_ago() -> None:
    seen: list[float] = []

    def pilot(_time: float, pose: Pose) -> tuple[float, float]:
        seen.append(pose[0])
        return 0.5, 0.5

    steered(pilot, {"pose_latency": 0.4}, 5.0)
    late = np.array(seen)
    seen.clear()
    steered(pilot, {}, 5.0)
    assert late[10:] == pytest.approx(np.array(seen)[:-10], abs=1e-9)


def test_motors_of_cubic_pull_and_those_that_are_weak_in_reverse_reach_the_speeds_of_their_laws() -> None:
    cubic = after(6.0, {"cubic_motor": 0.35})
    expected = [duty * (0.65 + 0.35 * duty**2) / NEUTRAL.k1 for duty in (0.3, 0.5)]
    assert (cubic["psi_left"], cubic["psi_right"]) == pytest.approx(expected, rel=1e-9)
    backward = Commands(np.zeros(1), np.array([-0.3]), np.array([0.5]))
    weak = after(6.0, {"weak_reverse": 0.12}, backward)
    expected = [-0.3 * 0.88 / NEUTRAL.k1, 0.5 / NEUTRAL.k1]
    assert (weak["psi_left"], weak["psi_right"]) == pytest.approx(expected, rel=1e-9)


def test_a_motor_that_coasts_slows_down_at_the_share_of_the_rate_that_is_left() -> None:
    commands = Commands(np.array([0.0, COAST_AFTER]), np.array([0.5, 0.0]), np.array([0.5, 0.0]))
    free, braked = (after(COAST_AFTER + 0.1, {"coasting": share}, commands) for share in (0.6, 0.0))
    start = 0.5 / NEUTRAL.k1
    assert free["psi_left"] == pytest.approx(start * math.exp(-0.4 * RATE * 0.1), rel=1e-4)
    assert braked["psi_left"] == pytest.approx(start * math.exp(-RATE * 0.1), rel=1e-4)


def test_torque_that_ripples_leaves_the_mean_speed_and_swings_four_times_a_turn() -> None:
    times = every(0.005, 10.0)[1000:]
    psi = true_motion(CONSTANT, {"torque_ripple": 0.3}, times, step=1e-3)["psi_right"]
    assert psi.mean() == pytest.approx(0.5 / NEUTRAL.k1, rel=0.02)
    crossings = np.count_nonzero(np.diff(np.sign(psi - psi.mean())) > 0)
    assert crossings == pytest.approx(4.0 * psi.mean() / (2.0 * math.pi) * 5.0, abs=1.5)


def test_the_wind_blows_a_moving_robot_aside_and_none_that_stands() -> None:
    straight = Commands(np.zeros(1), np.array([0.3]), np.array([0.3]))
    wind = {"side_wind": 0.03, "side_wind_direction": 1.2}
    blown, calm = after(6.0, wind, straight), after(6.0, {}, straight)
    # It acts once the robot is fast enough, within the first tenths of a second.
    assert blown["y"] == pytest.approx(0.03 * math.sin(1.2) * 6.0, rel=0.02)
    assert blown["x"] == pytest.approx(calm["x"], rel=1e-9)
    assert after(6.0, wind, Commands(np.zeros(1), np.zeros(1), np.zeros(1)))["y"] == 0.0


def test_a_caster_pushes_once_for_each_reversal_and_to_either_side_in_turn() -> None:
    time, duty = every(2.0, 8.0), np.array([0.3, -0.3, 0.3, -0.3, 0.3])
    headings = true_motion(Commands(time, duty, duty), {"caster_flip": 0.35}, time[1:] + 1.9, step=1e-3)["theta"]
    # A half sine of half a second and 0.35 rad/s.
    push = 0.35 * 0.5 * 2.0 / math.pi
    assert np.abs(headings[:-1]) == pytest.approx([push, 0.0, push], abs=1e-3)


def test_a_cambered_floor_turns_the_robot_by_its_place() -> None:
    straight = Commands(np.zeros(1), np.array([0.3]), np.array([0.3]))
    states = true_motion(straight, {"floor_camber": 0.25}, np.array([5.0]), start=(0.0, 0.375, 0.0), step=1e-3)
    # A quarter of a wave from the crest, the floor turns the robot by nearly 0.25 rad in each metre.
    assert states["theta"][0] / states["x"][0] == pytest.approx(0.25, rel=0.2)


def test_a_wheel_that_loses_traction_keeps_its_speed_and_carries_less() -> None:
    straight = packets(constant(0.3, 0.3), 30.0)
    lost, held = (drive(straight, {"traction_loss": rate}, 30.0).truth for rate in (0.3, 0.0))
    assert lost["phi_left"][-1] == pytest.approx(held["phi_left"][-1], rel=1e-9)
    way = [np.sum(np.hypot(np.diff(truth["x"]), np.diff(truth["y"]))) for truth in (lost, held)]
    # 0.3 times in a second, for 0.4 s, of 0.15 of the speed; some losses are cut short by the end.
    assert 0.003 < 1.0 - way[0] / way[1] < 0.03


def test_an_encoder_that_misses_counts_does_so_at_speed_only() -> None:
    slow, fast = (packets(constant(duty, duty), 10.0) for duty in (0.2, 0.9))
    for commands, missed in ((slow, 0.0), (fast, 0.08)):
        driven = drive(commands, {"encoder_miscount": 0.08}, 10.0)
        ticks, turned = driven.recording.wheels["ticks_left"], driven.truth["phi_left"] / (2.0 * math.pi) * 480.0
        share = 1.0 - (ticks[-1] - ticks[500]) / (turned[-1] - turned[500])
        assert share == pytest.approx(missed, abs=1e-6)


def test_a_gyro_in_a_magnetic_field_errs_with_twice_the_heading_and_a_warped_heading_with_the_place() -> None:
    commands = packets(constant(0.3, 0.5), 10.0)
    driven = drive(commands, {"gyro_magnetism": 0.03, "pose_heading_warp": 0.035}, 10.0)
    error = driven.recording.gyro["yaw_rate"] - driven.truth["w"]
    assert error == pytest.approx(0.03 * np.sin(2.0 * driven.truth["theta"]), abs=1e-9)
    poses = driven.recording.poses
    turned = np.unwrap(poses["theta"]) - driven.truth["theta"][::4]
    assert turned == pytest.approx(0.035 * np.sin(2.0 * math.pi * poses["x"] / 1.5), abs=1e-9)


def test_friction_that_sets_in_smoothly_holds_nothing_and_is_as_large_at_speed() -> None:
    push = Commands(np.zeros(1), np.array([0.01]), np.array([0.5]))
    smooth, dry = (after(6.0, {"coulomb_friction": 4.0, "friction_smoothing": size}, push) for size in (0.05, 0.0))
    assert dry["psi_left"] == 0.0
    assert 0.0 < smooth["psi_left"] < 0.05
    assert smooth["psi_right"] == pytest.approx(dry["psi_right"], rel=1e-9)


def test_friction_with_a_bump_is_larger_at_low_speed() -> None:
    sizes = {"coulomb_friction": 4.0, "friction_bump": 0.2, "viscous_friction": 0.4}
    state = after(8.0, sizes)
    for psi, duty in ((state["psi_left"], 0.3), (state["psi_right"], 0.5)):
        friction = 4.0 * (1.0 + 0.2 * math.exp(-psi / 2.0)) + 0.4 * psi
        assert NEUTRAL.k2_over_k3 * (duty - NEUTRAL.k1 * psi) == pytest.approx(friction, rel=1e-6)

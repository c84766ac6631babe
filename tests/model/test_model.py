"""The robot model against closed forms, invariants and an integrator that shares nothing with it."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from cmr.model.body import arc, forward, turn, wheels, wrap
from cmr.model.motion import RobotState, drive, roll, step
from cmr.model.motor import duty_for_speed, wheel_acceleration, wheel_angle_after, wheel_speed_after
from cmr.model.parameters import RobotParameters

ROBOT = RobotParameters(wheel_radius=0.04, k2_over_k3=118.0, k1=0.054, base_width=0.161)
duties = st.floats(-1.0, 1.0)
speeds = st.floats(-20.0, 20.0)


def figure_eight_duties(seconds: float, dt: float) -> tuple[np.ndarray, np.ndarray]:
    """A drive through both lobes at some 0.3 m/s, as duties."""
    t = np.arange(0.0, seconds, dt)
    turning = 0.09 * np.sin(2.0 * np.pi * t / 20.0)
    return 0.42 - turning, 0.42 + turning


def reference_end(left: float, right: float, start: RobotState, seconds: float) -> np.ndarray:
    """x, y, theta, psi_left, psi_right after constant duties, by SciPy's integrator on the paper's equations."""

    def rates(_t: float, s: np.ndarray) -> list[float]:
        gain, k1 = ROBOT.k2_over_k3, ROBOT.k1
        speed = ROBOT.wheel_radius * (s[3] + s[4]) / 2.0
        yaw_rate = ROBOT.wheel_radius * (s[4] - s[3]) / ROBOT.base_width
        acceleration = [gain * left - k1 * gain * s[3], gain * right - k1 * gain * s[4]]
        return [speed * np.cos(s[2]), speed * np.sin(s[2]), yaw_rate, *acceleration]

    return np.asarray(solve_ivp(rates, (0.0, seconds), start[:5], rtol=1e-12, atol=1e-13).y[:, -1])


@given(speeds, duties, st.floats(0.0, 2.0))
def test_wheel_speed_and_angle_are_the_exact_solution_of_the_motor_equation(psi: float, duty: float, t: float) -> None:
    gain, k1 = ROBOT.k2_over_k3, ROBOT.k1
    final, rate = duty / k1, k1 * gain
    assert wheel_speed_after(psi, duty, ROBOT, t) == pytest.approx(final + (psi - final) * np.exp(-rate * t), abs=1e-12)
    # The angle satisfies the integrated equation: change of speed = gain (duty t - k1 angle).
    change = wheel_speed_after(psi, duty, ROBOT, t) - psi
    assert gain * (duty * t - k1 * wheel_angle_after(psi, duty, ROBOT, t)) == pytest.approx(change, abs=1e-9)


@given(speeds)
def test_the_duty_that_holds_a_speed_leaves_no_acceleration(psi: float) -> None:
    assert wheel_acceleration(psi, duty_for_speed(psi, ROBOT), ROBOT) == pytest.approx(0.0, abs=1e-12)


@given(st.floats(-2.0, 2.0), st.floats(-5.0, 5.0))
def test_wheel_speeds_for_a_body_motion_give_that_motion(speed: float, yaw_rate: float) -> None:
    left, right = wheels(speed, yaw_rate, ROBOT)
    assert forward(left, right, ROBOT) == pytest.approx(speed, abs=1e-12)
    assert turn(left, right, ROBOT) == pytest.approx(yaw_rate, abs=1e-11)


@given(st.floats(-100.0, 100.0))
def test_wrapped_angles_stay_the_same_direction_within_a_half_turn(angle: float) -> None:
    wrapped = wrap(angle)
    assert -np.pi < wrapped <= np.pi
    assert np.exp(1j * wrapped) == pytest.approx(np.exp(1j * angle), abs=1e-12)


@settings(max_examples=30, deadline=None)
@given(duties, duties, speeds, speeds, st.floats(-3.0, 3.0))
def test_one_step_of_10_ms_agrees_with_an_independent_integrator(
    left: float, right: float, psi_left: float, psi_right: float, theta: float
) -> None:
    start = RobotState(0.5, -0.3, theta, psi_left, psi_right, 0.0, 0.0)
    ours = np.array(step(start, left, right, ROBOT, 0.01)[:5])
    reference = reference_end(left, right, start, 0.01)
    ours[2] = reference[2] + wrap(ours[2] - reference[2])
    # Two-point Gauss: error h^5/4320 times the fourth derivative of speed times direction, 1e-9 m at these speeds.
    assert ours == pytest.approx(reference, abs=1e-8)


def test_a_figure_eight_of_a_minute_in_10_ms_steps_stays_within_1e7_m_of_the_truth() -> None:
    left, right = figure_eight_duties(60.0, 0.01)
    coarse = drive(left, right, np.full(len(left), 0.01), ROBOT, RobotState.at_rest())
    parts = 20
    fine = drive(
        np.repeat(left, parts),
        np.repeat(right, parts),
        np.full(len(left) * parts, 0.01 / parts),
        ROBOT,
        RobotState.at_rest(),
    )
    error = np.hypot(coarse.x - fine.x[::parts], coarse.y - fine.y[::parts])
    assert error.max() < 1e-7


def test_constant_duty_drives_the_circle_that_geometry_demands() -> None:
    seconds = 10.0
    left, right = 0.3, 0.4
    start = RobotState(0.0, 0.0, 0.0, left / ROBOT.k1, right / ROBOT.k1, 0.0, 0.0)  # at final speed from the start
    spans = np.full(1000, seconds / 1000)
    path = drive(np.full(1000, left), np.full(1000, right), spans, ROBOT, start)
    radius = ROBOT.base_width / 2.0 * (right + left) / (right - left)
    assert np.hypot(path.x, path.y - radius) == pytest.approx(radius, abs=1e-8)
    assert path.theta[-1] == pytest.approx(ROBOT.wheel_radius * (right - left) / ROBOT.k1 / ROBOT.base_width * seconds)


@given(duties, duties)
@settings(max_examples=20, deadline=None)
def test_mirrored_commands_drive_the_mirrored_path(left: float, right: float) -> None:
    spans = np.full(50, 0.02)
    path = drive(np.full(50, left), np.full(50, right), spans, ROBOT, RobotState.at_rest())
    mirrored = drive(np.full(50, right), np.full(50, left), spans, ROBOT, RobotState.at_rest())
    assert mirrored.x == pytest.approx(path.x, abs=1e-12)
    assert mirrored.y == pytest.approx(-path.y, abs=1e-12)
    assert mirrored.theta == pytest.approx(-path.theta, abs=1e-12)


def test_a_drive_is_the_sum_of_its_steps() -> None:
    left, right = figure_eight_duties(5.0, 0.013)
    spans = np.full(len(left), 0.013)
    start = RobotState(1.0, 2.0, 0.3, 4.0, -2.0, 0.0, 0.0)
    path = drive(left, right, spans, ROBOT, start)
    state = start
    for u, v in zip(left, right, strict=True):
        state = step(state, u, v, ROBOT, 0.013)
    end = (path.x[-1], path.y[-1], wrap(path.theta[-1]), path.psi_left[-1], path.psi_right[-1])
    assert np.array(state[:5]) == pytest.approx(np.array(end), abs=1e-11)


def test_many_robots_in_one_step_move_exactly_as_each_alone() -> None:
    random = np.random.default_rng(1)
    count = 40
    states = RobotState(*random.normal(size=(7, count)))
    parameters = RobotParameters(*(np.array([*ROBOT])[:, np.newaxis] * random.uniform(0.5, 1.5, (4, count))))
    left, right = random.uniform(-1.0, 1.0, (2, count))
    together = np.array(step(states, left, right, parameters, 0.01))
    for i in range(count):
        alone = step(
            RobotState(*np.array(states)[:, i]),
            left[i],
            right[i],
            RobotParameters(*np.array([*parameters])[:, i]),
            0.01,
        )
        assert together[:, i] == pytest.approx(np.array(alone), rel=1e-14, abs=1e-14)


def test_a_grid_of_candidates_drives_as_each_candidate_alone() -> None:
    left, right = figure_eight_duties(3.0, 0.01)
    spans = np.full(len(left), 0.01)
    gains, k1s, widths = np.array([80.0, 118.0]), np.array([[0.04], [0.054]]), np.array([0.1, 0.161])
    # Two axes of candidates at once: k1 down, base width (with its gain) across.
    grid = drive(left, right, spans, RobotParameters(0.04, gains, k1s, widths), RobotState.at_rest())
    assert grid.x.shape == (len(left) + 1, 2, 2)
    for i in range(2):
        for j in range(2):
            one = drive(left, right, spans, RobotParameters(0.04, gains[j], k1s[i, 0], widths[j]), RobotState.at_rest())
            assert grid.x[:, i, j] == pytest.approx(one.x, abs=1e-12)
            assert grid.theta[:, i, j] == pytest.approx(one.theta, abs=1e-12)


def test_following_the_wheels_gives_the_path_that_turned_them() -> None:
    left, right = figure_eight_duties(20.0, 0.01)
    driven = drive(left, right, np.full(len(left), 0.01), ROBOT, RobotState.at_rest())
    rolled = roll(driven.angle_left, driven.angle_right, ROBOT, RobotState.at_rest())
    assert rolled.theta == pytest.approx(driven.theta, abs=1e-12)
    # Within 10 ms the ratio of the wheel speeds hardly changes, so chords of arcs are right to a micrometre a step.
    assert np.hypot(rolled.x - driven.x, rolled.y - driven.y).max() < 1e-4


@given(st.floats(-3.0, 3.0), st.floats(-2.0, 2.0))
def test_an_arc_without_turn_is_a_straight_line(theta: float, length: float) -> None:
    assert arc(theta, length, 0.0) == pytest.approx((length * np.cos(theta), length * np.sin(theta)), abs=1e-15)


@pytest.mark.parametrize("count", [1, 3, 4, 15, 16, 17, 50])
def test_any_number_of_candidates_drives_as_each_alone_over_spans_of_any_length(count: int) -> None:
    random = np.random.default_rng(count)
    left, right = random.uniform(-1.0, 1.0, (2, 60))
    spans = random.uniform(1e-4, 0.3, 60)
    widths, starts = random.uniform(0.1, 0.2, count), random.normal(size=count)
    start = RobotState(starts, 0.0, starts, starts, 0.0, 0.0, 0.0)
    together = drive(left, right, spans, RobotParameters(0.04, 118.0, 0.054, widths), start)
    for i in {0, count // 2, count - 1}:
        here = RobotState(starts[i], 0.0, starts[i], starts[i], 0.0, 0.0, 0.0)
        alone = drive(left, right, spans, RobotParameters(0.04, 118.0, 0.054, widths[i]), here)
        for many, one in zip(together, alone, strict=True):
            assert many[:, i] == pytest.approx(one, abs=1e-12)


def test_only_the_borders_asked_for_are_returned_and_they_are_the_same() -> None:
    left, right = figure_eight_duties(3.0, 0.01)
    spans = np.full(len(left), 0.01)
    whole = drive(left, right, spans, ROBOT, RobotState.at_rest())
    at = [0, 1, 17, 250]
    for chosen, full in zip(drive(left, right, spans, ROBOT, RobotState.at_rest(), at=at), whole, strict=True):
        assert np.array_equal(chosen, full[at])


def test_a_span_of_seconds_is_integrated_as_finely_as_many_short_ones() -> None:
    one = drive([0.2], [0.6], [4.0], ROBOT, RobotState.at_rest())
    many = drive(np.full(4000, 0.2), np.full(4000, 0.6), np.full(4000, 1e-3), ROBOT, RobotState.at_rest())
    # 160 parts of 25 ms: 40 times what 10 ms err, some nanometres a second at 0.3 m/s.
    assert (one.x[-1], one.y[-1]) == pytest.approx((many.x[-1], many.y[-1]), abs=2e-6)
    assert one.theta[-1] == pytest.approx(many.theta[-1], abs=1e-10)


def test_fast_motors_and_slow_ones_are_exact_alike() -> None:
    for gain, k1 in ((5.0, 0.01), (118.0, 0.054), (4000.0, 0.054), (1e5, 1.0)):
        robot = ROBOT._replace(k2_over_k3=gain, k1=k1)
        path = drive(np.full(20, 0.5), np.full(20, 0.5), np.full(20, 0.01), robot, RobotState.at_rest())
        t = np.arange(21, dtype=np.float64) * 0.01
        assert path.psi_left == pytest.approx(wheel_speed_after(0.0, 0.5, robot, t), rel=1e-12)
        assert path.angle_left == pytest.approx(wheel_angle_after(0.0, 0.5, robot, t), rel=1e-10, abs=1e-12)

"""A fleet: many robots by one call move as each alone would, whatever comes, goes or changes meanwhile."""

import numpy as np
import pytest

from cmr.model.catalogue import CATALOGUE, typical, with_effects
from cmr.model.effect import Effect
from cmr.model.fleet import Fleet
from cmr.model.motion import RobotState, drive
from cmr.model.parameters import RobotParameters

ROBOT = RobotParameters(wheel_radius=0.04, k2_over_k3=118.0, k1=0.054, base_width=0.161)
DT = 0.01
MOTION = [effect for effect in CATALOGUE.values() if not effect.is_sensor]
CERTAIN = [effect for effect in MOTION if effect.name not in ("command_jitter", "command_loss")]


def commands(steps: int) -> np.ndarray:
    return np.random.default_rng(4).uniform(-0.7, 0.7, (2, steps))


def alone(parameters: RobotParameters, duties: np.ndarray, start: RobotState | None = None) -> RobotState:
    path = drive(duties[0], duties[1], np.full(duties.shape[1], DT), parameters, start or RobotState.at_rest())
    x, y, theta, psi_left, psi_right = (values[-1] for values in path[:5])
    return RobotState(x, y, theta, psi_left, psi_right, np.nan, np.nan)


def test_robots_of_all_kinds_in_one_fleet_move_as_each_alone() -> None:
    kinds = [ROBOT, *(with_effects(ROBOT, typical(effect)) for effect in CERTAIN), ROBOT._replace(base_width=0.1)]
    fleet = Fleet(DT)
    for parameters in kinds:
        fleet.add(RobotState.at_rest(), parameters)
    duties = commands(150)
    for left, right in duties.T:
        fleet.command(slice(0, len(kinds)), left, right)
        fleet.advance()
    states = fleet.states()
    for index, parameters in enumerate(kinds):
        expected = alone(parameters, duties)
        assert (states.x[index], states.y[index]) == pytest.approx((expected.x, expected.y), abs=1e-11)
        assert states.psi_left[index] == pytest.approx(expected.psi_left, abs=1e-9)


def test_robots_without_effects_do_not_notice_those_with_effects() -> None:
    mixed, plain = Fleet(DT), Fleet(DT)
    for fleet in (mixed, plain):
        fleet.add(RobotState.at_rest(np.zeros(5)), ROBOT)
    mixed.add(RobotState.at_rest(), with_effects(ROBOT, {"coulomb_friction": 4.0}))
    for left, right in commands(50).T:
        for fleet in (mixed, plain):
            fleet.command(np.arange(5), left, right)
            fleet.advance()
    for together, by_themselves in zip(mixed.states(np.arange(5)), plain.states(), strict=True):
        assert np.array_equal(together, by_themselves)


@pytest.mark.parametrize("effect", MOTION, ids=lambda effect: effect.name)
def test_neutral_values_move_a_robot_bit_for_bit_as_if_they_were_absent(effect: Effect) -> None:
    fleet = Fleet(DT)
    neutral = {parameter.name: parameter.neutral for parameter in effect.parameters}
    fleet.add(RobotState.at_rest(), ROBOT)
    fleet.add(RobotState.at_rest(), with_effects(ROBOT, neutral))
    for left, right in commands(20).T:
        fleet.command(np.arange(2), left, right)
        fleet.advance()
    for values in fleet.states():
        assert values[0] == values[1]


def test_heat_and_backlash_survive_when_other_robots_come_and_parameters_change() -> None:
    warm = with_effects(ROBOT, {"motor_heating": 0.5, "backlash": 0.3, "electrical_lag": 0.05})
    disturbed, left_alone = Fleet(DT), Fleet(DT)
    for fleet in (disturbed, left_alone):
        fleet.add(RobotState.at_rest(), warm)
    for step, (left, right) in enumerate(commands(120).T):
        for fleet in (disturbed, left_alone):
            fleet.command(0, left, right)
            fleet.advance()
        if step == 40:
            disturbed.add(RobotState.at_rest(), ROBOT)
        if step == 60:
            disturbed.add(RobotState.at_rest(), warm)
        if step == 80:
            disturbed.set_parameters(1, warm)
    for together, by_itself in zip(disturbed.states(0), left_alone.states(0), strict=True):
        assert together == by_itself


def test_parameters_change_the_motion_and_not_the_state() -> None:
    fleet = Fleet(DT)
    fleet.add(RobotState.at_rest(1.0, 2.0, 0.5), ROBOT)
    fleet.command(0, 0.5, 0.4)
    fleet.advance(100)
    before = fleet.states(0)
    for parameters in (with_effects(ROBOT, {"lateral_skid": 0.1}), ROBOT):
        fleet.set_parameters(0, parameters)
        after = fleet.states(0)
        assert after[:5] == before[:5]
        fleet.advance()
        assert fleet.states(0).x != before.x
        before = fleet.states(0)


def test_a_robot_put_elsewhere_starts_anew() -> None:
    shaky = with_effects(ROBOT, {"surface_change_k1": 0.5, "surface_change_time": 0.5, "slew_limit": 2.0})
    fleet = Fleet(DT)
    fleet.add(RobotState.at_rest(), shaky)
    fleet.command(0, 0.6, 0.6)
    fleet.advance(200)
    fleet.place(0, RobotState.at_rest(3.0, -1.0, 0.2))
    duties = np.full((2, 80), 0.6)
    fleet.advance(80)
    expected = alone(shaky, duties, RobotState.at_rest(3.0, -1.0, 0.2))
    assert (fleet.states(0).x, fleet.states(0).y) == pytest.approx((expected.x, expected.y), abs=1e-11)


def test_commands_arrive_late_by_exactly_the_delay() -> None:
    fleet = Fleet(DT)
    fleet.add(RobotState.at_rest(), with_effects(ROBOT, {"command_delay": 0.2}))
    fleet.add(RobotState.at_rest(), ROBOT)
    fleet.command(np.arange(2), 0.5, 0.4)
    fleet.advance(20)
    assert fleet.states(0).x == pytest.approx(0.0, abs=1e-15)  # the last step's end is late by a rounding error
    delayed_start = fleet.states(1)
    assert delayed_start.x > 0.0
    fleet.advance(20)
    assert fleet.states(0).x == pytest.approx(delayed_start.x, abs=1e-10)


def test_lost_and_jittering_commands_are_the_same_for_the_same_seed_only() -> None:
    unsteady = with_effects(ROBOT, {"command_loss": 0.3, "command_jitter": 0.04})

    def end(seed: int) -> float:
        fleet = Fleet(DT, seed)
        fleet.add(RobotState.at_rest(np.zeros(2)), unsteady)
        for left, right in commands(100).T:
            fleet.command(np.arange(2), left, right)
            fleet.advance()
        first, second = fleet.states().x
        assert first != second  # each robot has luck of its own
        return float(first)

    assert end(1) == end(1)
    assert end(1) != end(2)


def test_a_share_of_the_commands_as_stated_is_lost() -> None:
    # Alternating commands: each one lost leaves the robot with the opposite one for a step.
    fleet, robots, steps, loss = Fleet(DT), 200, 200, 0.2
    fleet.add(RobotState.at_rest(np.zeros(robots)), with_effects(ROBOT, {"command_loss": loss}))
    held = 0
    for step in range(steps):
        sign = 1.0 if step % 2 else -1.0
        before = fleet.states().psi_left
        fleet.command(np.arange(robots), 0.5 * sign, 0.5 * sign)
        fleet.advance()
        held += int(np.count_nonzero((fleet.states().psi_left - before) * sign < 0.0))
    trials = robots * steps
    # A lost command after an even number of lost ones holds the wrong sign: p / (1 + p) of the time. 5 sigma.
    expected = loss / (1.0 + loss)
    assert abs(held / trials - expected) < 5.0 * np.sqrt(expected * (1.0 - expected) / trials) + 1e-3


def test_headings_stay_exact_after_thousands_of_turns() -> None:
    fleet = Fleet(DT)
    turns = 10_000
    fleet.add(RobotState.at_rest(0.0, 0.0, np.array([0.3, 0.3 + turns * 2.0 * np.pi])), ROBOT)
    fleet.command(np.arange(2), 0.5, 0.45)
    fleet.advance(200)
    states = fleet.states()
    # The larger heading itself is known to half an ulp of 6e4, 4e-12 rad.
    assert states.x[1] == pytest.approx(states.x[0], abs=1e-10)
    assert states.theta[1] == pytest.approx(states.theta[0], abs=1e-8)


def test_absurd_turn_rates_do_not_spoil_the_step() -> None:
    spinning = ROBOT._replace(base_width=2e-3)  # 360 rad/s at full speed: 3.6 rad in a step
    fleet = Fleet(DT)
    fleet.add(RobotState.at_rest(), spinning)
    fleet.command(0, -1.0, 1.0)
    fleet.advance(100)
    state = fleet.states(0)
    fine = drive(-np.ones(10_000), np.ones(10_000), np.full(10_000, 1e-4), spinning, RobotState.at_rest())
    assert (state.x, state.y) == pytest.approx((fine.x[-1], fine.y[-1]), abs=1e-6)
    assert state.psi_right == pytest.approx(fine.psi_right[-1], rel=1e-9)


def test_an_unknown_effect_is_refused_by_name() -> None:
    with pytest.raises(KeyError, match="wheel_wobbel"):
        Fleet(DT).add(RobotState.at_rest(), with_effects(ROBOT, {"wheel_wobbel": 0.1}))

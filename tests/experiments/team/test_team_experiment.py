"""Experiments with teams: as live, but without hardware, and the same again for the same seed."""

import dataclasses
import math
from pathlib import Path

import numpy as np
import pytest

from cmr.commands.scenarios import parse
from cmr.experiments.team.experiment import ExperimentError, TeamRun, run
from cmr.experiments.team.hidden import HiddenRobot, Laboratory
from cmr.experiments.team.plant import Plant
from cmr.experiments.team.roles import Roles
from cmr.model.parameters import RobotParameters
from robot_driver.emulator import plant as emulated
from robot_driver.emulator.settings import Settings, load_settings
from tests.support.small_teams import BELIEVED, NUMBERS, line_of_three

LABORATORY = Laboratory(NUMBERS, seed=5)
EXACT = Laboratory(NUMBERS, size=0.0)  # real robots are just as believed
IMPERFECT = {"coulomb_friction": 5.0, "static_friction": 1.0, "command_delay": 0.03}
IMPERFECT |= {"turn_slip": 0.01, "longitudinal_slip": 0.002}


def same(a: TeamRun, b: TeamRun) -> bool:
    arrays = zip((a.time, a.x, a.y, a.theta), (b.time, b.x, b.y, b.theta), strict=True)
    return all(one.tobytes() == other.tobytes() for one, other in arrays) and a.metrics == b.metrics


def emulated_settings() -> Settings:
    """The emulator with the imperfections that both plants have, without noise."""
    settings = load_settings().ideal()
    sized = {
        name: dataclasses.replace(getattr(settings.imperfections, name), enabled=True, size=size)
        for name, size in IMPERFECT.items()
    }
    return dataclasses.replace(settings, imperfections=dataclasses.replace(settings.imperfections, **sized))


def test_the_plant_of_teams_goes_where_the_emulator_goes() -> None:
    other = emulated.Plant(emulated_settings())
    plant = Plant([HiddenRobot(**IMPERFECT)], np.zeros((3, 1)), [(0,)])
    for k in range(200):
        duties = 0.6 * math.sin(0.06 * k) + 0.1, 0.6 * math.sin(0.04 * k)
        other.command(*duties)
        plant.command([duties])
        other.advance(0.02 * (k + 1))
        plant.advance(0.02 * (k + 1))
    assert plant.poses[:, 0].tolist() == [other.x, other.y, other.theta]
    x, y, _ = plant.poses[:, 0]
    assert math.hypot(x, y) > 0.1


@pytest.mark.slow
def test_the_same_seed_gives_the_same_result_to_the_last_bit(tmp_path: Path) -> None:
    scenario = line_of_three(tmp_path, 4.0)
    roles = Roles(BELIEVED, (0, 1), LABORATORY)
    first = run(scenario, roles, 3)
    assert same(first, run(scenario, roles, 3))
    assert not same(first, run(scenario, roles, 4))


def test_a_team_reaches_its_goal_and_the_experiment_ends_there(tmp_path: Path) -> None:
    result = run(line_of_three(tmp_path, 30.0), Roles(BELIEVED, (0,), EXACT), 1)
    assert result.time[-1] == pytest.approx(result.metrics["time_to_goal"])
    assert 5.0 < result.time[-1] < 9.0
    assert math.hypot(result.x[-1, 0] - 1.2, result.y[-1, 0] - 0.6) <= 0.1
    assert result.metrics["formation_error"] < 0.25  # a follower at 0.3 m/s is 0.2 m further behind than its gap
    assert result.metrics["minimum_separation"] > 0.2


def test_robots_of_a_laboratory_differ_from_what_is_believed_and_from_one_another() -> None:
    one, other = LABORATORY.robot(0), LABORATORY.robot(1)
    assert one == LABORATORY.robot(0)
    assert one.k2_over_k3 != other.k2_over_k3
    assert one.k2_over_k3 / NUMBERS["k2_over_k3"] == pytest.approx(1.3, rel=0.2)
    assert EXACT.robot(0) == HiddenRobot(**NUMBERS)


def test_virtual_robots_move_by_their_own_parameters_and_steer_by_what_is_believed(tmp_path: Path) -> None:
    scenario = line_of_three(tmp_path)
    faster = RobotParameters.of({**NUMBERS, "k1": 0.8 * NUMBERS["k1"]})
    usual = run(scenario, Roles(BELIEVED, (2,), EXACT), 1)
    changed = run(scenario, Roles(BELIEVED, (2,), EXACT, {0: faster}), 1)
    assert changed.metrics["time_to_goal"] < 0.9 * usual.metrics["time_to_goal"]


def test_a_robot_that_nobody_commands_is_named(tmp_path: Path) -> None:
    scenario = line_of_three(tmp_path)
    idle = dataclasses.replace(scenario.robots[1], behaviour=None)
    with pytest.raises(ExperimentError, match="Robot 1 has no behaviour"):
        run(dataclasses.replace(scenario, robots=(scenario.robots[0], idle)), Roles(BELIEVED, (0,), EXACT), 1)
    lost = dataclasses.replace(scenario.robots[0], start=None)
    with pytest.raises(ExperimentError, match="Robot 0 has no start"):
        run(dataclasses.replace(scenario, robots=(lost,)), Roles(BELIEVED, (0,), EXACT), 1)


def test_a_way_that_ends_where_it_began_is_not_at_its_end_before_it_was_driven(tmp_path: Path) -> None:
    BELIEVED.save(tmp_path / "robot_0.yaml")
    robot = "{id: 0, kind: virtual, behaviour: waypoints, waypoints: [[0, 0], [0.6, 0], [0.6, 0.4], [0, 0]]}"
    text = f"duration: 30\nparameters: robot_0.yaml\nends_when: waypoints_reached\nrobots:\n  - {robot}\n"
    result = run(parse(text, folder=tmp_path), Roles(BELIEVED, (), EXACT), 1)
    assert 5.0 < result.time[-1] < 15.0  # 1.7 m at 0.3 m/s
    assert result.metrics["time_to_goal"] == pytest.approx(result.time[-1])
    assert result.metrics["distance_driven"] > 1.4
    assert result.waypoints_reached

"""What a team is scored by follows from its scenario, live as without a bus."""

import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from cmr.commands.scenarios import load
from cmr.experiments.live.measuring import measure
from cmr.experiments.live.report import metrics_in_words, metrics_of
from cmr.experiments.live.watch import TeamWatch
from cmr.experiments.scenario import Scenario
from cmr.experiments.scenario.reading import shipped
from cmr.experiments.team.metrics import UNITS, Bond
from cmr.experiments.team.plan import BehaviourPlan, RobotPlan
from cmr.experiments.team.scoring import bonds_of, scores, ways_of
from cmr.model.motion import RobotState
from cmr.world.view import VIRTUAL, Robot, world_messages

EPOCH = 1_700_000_000_000_000
STEP = 100_000  # us
SPEED = 0.5  # m/s


def columns_of(scenario: Scenario) -> dict[int, int]:
    return {robot.robot_id: column for column, robot in enumerate(scenario.robots)}


def test_followers_are_to_keep_their_gap_on_the_path_of_their_leader() -> None:
    bonds = bonds_of(load(shipped()["line"]), columns_of(load(shipped()["line"])))
    assert bonds == [Bond(k + 1, k, 0.5) for k in range(5)]


def test_robots_in_a_formation_are_to_keep_the_distance_of_their_places_and_no_path() -> None:
    scenario = load(shipped()["formation"])
    bonds = bonds_of(scenario, columns_of(scenario))
    assert [bond.robot for bond in bonds] == [1, 2, 3, 4, 5, 6]
    assert {bond.leader for bond in bonds} == {0}
    assert [bond.distance for bond in bonds] == pytest.approx([0.6, 0.6, 1.2, 1.2, 1.8, 1.8])
    assert not any(bond.follows for bond in bonds)


def test_robots_that_nobody_leads_are_bound_to_nobody() -> None:
    plans = [RobotPlan(k, "virtual", BehaviourPlan("formation", {"leader": "-1"})) for k in range(3)]
    assert bonds_of(Scenario("team", 10.0, (*plans, RobotPlan(9, "virtual"))), dict.fromkeys(range(10), 0)) == []


def test_only_what_is_asked_for_is_measured_and_what_means_nothing_is_no_number() -> None:
    scenario = load(shipped()["crossing"])
    x = np.zeros((2, len(scenario.robots)))
    found = scores(scenario, list(columns_of(scenario)), np.array([0.0, 1.0]), x, x, ["path_spread", "time_to_goal"])
    assert list(found) == ["path_spread", "time_to_goal"]
    assert math.isnan(found["path_spread"])
    assert found["time_to_goal"] == 1.0
    assert ways_of(scenario, columns_of(scenario))[0] == ((2.8, -0.25),)


def watched(scenario: Scenario, moments: int, away: range) -> TeamWatch:
    """A leader that drives along x, and a follower, 0.7 m behind it, that is away at some moments."""
    watch = TeamWatch(scenario)
    for k in range(moments):
        utime = EPOCH + k * STEP
        x = SPEED * STEP * 1e-6 * k
        robots = [Robot(utime, 5, VIRTUAL, RobotState(x, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0))]
        if k not in away:
            robots.append(Robot(utime, 2, VIRTUAL, RobotState(x - 0.7, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)))
        for message in world_messages(utime, robots):
            watch.handle(utime, "WORLD_STATE", message)
        if k == 0:
            watch.begin()
    return watch


def team(metrics: tuple[str, ...] = tuple(UNITS)) -> Scenario:
    leader = RobotPlan(5, "virtual", BehaviourPlan("waypoints"), waypoints=((1.02, 0.0),))
    follower = RobotPlan(2, "virtual", BehaviourPlan("follow", {"leader": "5", "gap": "0.5"}))
    return Scenario("two", 10.0, (leader, follower), metrics=metrics)


def live(scenario: Scenario, moments: int = 100, away: range = range(0)) -> Any:
    """What `metrics_of` looks at of a live run."""
    return SimpleNamespace(watch=watched(scenario, moments, away), scenario=scenario)


def test_a_live_run_is_measured_by_the_metrics_of_its_scenario() -> None:
    found = metrics_of(live(team()))
    assert found["formation_error"] == pytest.approx(0.2)
    assert found["time_to_goal"] == pytest.approx(1.9)
    assert found["minimum_separation"] == pytest.approx(0.7)
    assert found["path_spread"] < 0.3
    document: Any = {"metrics": found, "waypoints_reached": True, "unreliable": ""}
    assert metrics_in_words(document).startswith("formation error 0.2 m, time to goal 1.9 s, ")
    assert "time to goal over 1.9 s, " in metrics_in_words(document | {"waypoints_reached": False})
    assert list(metrics_of(live(team(("time_to_goal",))))) == ["time_to_goal"]


def test_moments_without_a_robot_do_not_count_once_it_is_no_longer_in_the_world() -> None:
    found = metrics_of(live(team(), away=range(30, 90)))
    assert 0.2 < found["formation_error"] < 0.35  # of the second for which it is still taken to be where it was
    assert found["time_to_goal"] == pytest.approx(1.9)


def test_a_run_that_never_began_has_nothing_to_measure() -> None:
    assert metrics_of(live(team(), 0)).keys() <= {"distance_driven"}


def test_a_long_run_is_measured_at_a_bounded_number_of_moments() -> None:
    found = measure(team(), watched(team(), 100, range(0)), ["formation_error"], most_moments=10)
    assert found["formation_error"] == pytest.approx(0.2)


def test_a_goal_counts_from_when_the_robot_was_there_in_a_live_run_of_any_length(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("cmr.experiments.live.track.MOST_MOMENTS", 4)  # as after an hour: places are kept seconds apart
    found = measure(team(), watched(team(), 100, range(0)), ["time_to_goal"], most_moments=10)
    assert found["time_to_goal"] == pytest.approx(1.9)


def test_a_goal_that_is_not_reached_yet_takes_the_time_until_now() -> None:
    assert measure(team(), watched(team(), 16, range(0)), ["time_to_goal"])["time_to_goal"] == pytest.approx(1.5)
